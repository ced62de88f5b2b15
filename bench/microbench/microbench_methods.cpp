// The time of an iteration of each method: of solves that stop after a fixed number of iterations, before any
// of their systems converges, divided by that number. A solve's own costs are included, spread over its
// iterations: validation, alignment, a factorisation if the method factors once, and the final check. Also
// the time of a system in a batch on one thread, with each instruction set that the machine has.
#include <algorithm>
#include <asterism/solver.hpp>
#include <asterism/solver/batch/batch_newton.hpp>
#include <asterism/solver/batch/simd.hpp>
#include <asterism/solver/batch/spring_batch.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/solver/terms/from_springs.hpp>
#include <cstddef>
#include <string>
#include <type_traits>
#include <vector>

#include "microbench.hpp"
#include "microbench_flops.hpp"

namespace asterism::bench {

namespace {

// Operations of the kernels that the summary counts; additions, scalings and products of vectors in between
// are left out, except where they are most of the work.

template <typename System>
double flops_of(const Ida<System>&, const System& system, const Summary& summary) {
  return summary.gradient_evaluations * flops::gradient(system) +
         summary.factorizations * flops::dense_cholesky(system) +
         summary.linear_solves * flops::dense_cholesky_solve(system);
}

template <typename System>
double flops_of(const Newton<System>&, const System& system, const Summary& summary) {
  const double order = System::kDim * system.nodes();
  return summary.gradient_evaluations * flops::newton_assembly(system) +
         summary.factorizations * flops::ldlt(order) + summary.linear_solves * flops::ldlt_solve(order);
}

template <typename System>
double flops_of(const NonlinearCg<System>&, const System& system, const Summary& summary) {
  return summary.gradient_evaluations * flops::energy_and_gradient(system);
}

template <typename System>
double flops_of(const Lbfgs<System>&, const System& system, const Summary& summary) {
  // Two products with the steps and two with the changes of gradient, up to six of each.
  double pairs = 0;
  for (int i = 0; i < summary.iterations; ++i) pairs += std::min(i, 6);
  return summary.gradient_evaluations * flops::energy_and_gradient(system) +
         summary.factorizations * flops::dense_cholesky(system) +
         summary.linear_solves * flops::dense_cholesky_solve(system) +
         pairs * 4 * 2 * System::kDim * system.nodes();
}

// Operations of the sparse methods are not counted.
template <typename Solver, typename System>
double flops_of(const Solver&, const System&, const Summary&) {
  return 0;
}

template <typename System>
struct Samples {
  std::vector<testing::RandomSystem<System>> systems;
  double flops = 0;  // per iteration, the mean over the systems
};

// Systems whose solve does not end before the given iterations; none if fewer than one in a hundred is such.
template <typename Solver, typename System>
Samples<System> samples(Solver& solver, Linking linking, int nodes) {
  const std::size_t count = nodes <= 16 ? 64 : nodes <= 1000 ? 8 : 1;
  Samples<System> result;
  for (int index = 0; result.systems.size() < count; ++index) {
    if (index == 100 * static_cast<int>(count)) return {};
    auto sample = make_system<System>(linking, nodes, index);
    auto x = sample.start;
    const Summary summary = solver.solve(sample.system, x);
    if (summary.status != Status::MaxIterations) continue;
    result.flops +=
        flops_of(solver, sample.system, summary) / summary.iterations / static_cast<double>(count);
    result.systems.push_back(std::move(sample));
  }
  return result;
}

template <typename Solver, typename System>
void iterations(benchmark::State& state, Linking linking, int nodes, int count) {
  Solver solver;
  solver.options.tolerance = 0;
  solver.options.max_iterations = count;
  const auto [systems, flops] = samples<Solver, System>(solver, linking, nodes);
  if (systems.empty()) return state.SkipWithError("it converges within fewer iterations");
  std::size_t next = 0;
  typename System::Points x;
  const auto solve = [&, &all = systems] {
    const auto& [system, start] = all[next];
    next = next + 1 == all.size() ? 0 : next + 1;
    x = start;
    benchmark::DoNotOptimize(solver.solve(system, x).iterations);
  };
  measure<typename System::Scalar>(state, flops, instructions_of_springs(systems[0].system), solve, count);
}

template <typename Solver, typename System>
void add(const std::string& method, Linking linking, int nodes, int count) {
  benchmark::RegisterBenchmark(name_of<System>(method, linking, nodes).c_str(), [=](benchmark::State& state) {
    iterations<Solver, System>(state, linking, nodes, count);
  });
}

// The numbers of iterations are too small for the methods to converge from most starts.
template <typename System>
void add_newton(int nodes) {
  add<Newton<System>, System>("newton", Linking::Full, nodes, 3);
}

template <typename System>
void add_ida(int nodes) {
  add<Ida<System>, System>("ida", Linking::Full, nodes, 20);
}

// A method for systems of terms.
struct ByTerms {
  explicit ByTerms(const char* method) : solver(system_solver<Dynamic>(method)) {}

  AlignedOptions options;
  AnySolver<Dynamic> solver;

  Summary solve(const Dynamic& system, Dynamic::Points& x) {
    static_cast<AlignedOptions&>(solver.options()) = options;
    return solver.solve(system, x);
  }
};
struct TruncatedNewton : ByTerms {
  TruncatedNewton() : ByTerms("newton-cg") {}
};
struct Direct : ByTerms {
  Direct() : ByTerms("newton") {}
};
struct Divided : ByTerms {
  Divided() : ByTerms("schwarz") {}
};

constexpr int kSystems = 4096;

// Solves to the tolerance with which batches are used, from a start that is restored each time.
template <typename Batch>
void batch_solve(benchmark::State& state, Simd instructions, int nodes) {
  using System = typename Batch::System;
  const auto topology = System::TopologyType::full(nodes);
  Batch batch(topology, kSystems);
  for (int s = 0; s < kSystems; ++s) {
    const auto sample = make_system<System>(Linking::Full, nodes, s);
    batch.set(s, sample.system, sample.start);
  }
  std::vector<Eigen::Array<typename Batch::Scalar, Eigen::Dynamic, 1>> starts;
  for (int i = 0; i < nodes; ++i) {
    for (int d = 0; d < Batch::kDim; ++d) starts.emplace_back(batch.x(i, d));
  }
  BatchNewton<Batch> solver;
  solver.options.tolerance = 1e-6;
  solver.simd = instructions;
  const auto solve = [&] {
    auto start = starts.begin();
    for (int i = 0; i < nodes; ++i) {
      for (int d = 0; d < Batch::kDim; ++d) batch.x(i, d) = *start++;
    }
    benchmark::DoNotOptimize(solver.solve(batch).converged);
  };

  // The start and each iteration take at least one evaluation, factorisation and solve; rejected steps are
  // not counted.
  solve();
  const System system(topology);
  const double order = Batch::kDim * nodes;
  double evaluations = 0;
  for (int s = 0; s < kSystems; ++s) evaluations += (1 + batch.iterations(s)) / static_cast<double>(kSystems);
  const double flops =
      evaluations * (flops::newton_assembly(system) + flops::ldlt(order) + flops::ldlt_solve(order));
  measure<typename Batch::Scalar>(state, flops, instructions, solve, kSystems);
  state.counters["evaluations"] = evaluations;
}

template <typename Batch>
void add_batch(int nodes) {
  for (const Simd instructions : available_simd()) {
    const std::string kernel = "batch_newton/" + std::string(to_string(instructions));
    benchmark::RegisterBenchmark(
        name_of<typename Batch::System>(kernel, Linking::Full, nodes).c_str(),
        [=](benchmark::State& state) { batch_solve<Batch>(state, instructions, nodes); });
  }
}

}  // namespace

void add_methods() {
  add_newton<Fixed>(4);
  add_newton<FixedFloat>(4);
  add_newton<FixedSpace>(4);
  add_ida<Fixed>(4);
  for (const int nodes : {4, 16, 64}) {
    add_newton<Dynamic>(nodes);
    add_ida<Dynamic>(nodes);
    add<Lbfgs<Dynamic>, Dynamic>("lbfgs", Linking::Full, nodes, 8);
    add<NonlinearCg<Dynamic>, Dynamic>("nonlinear_cg", Linking::Full, nodes, 8);
  }
  constexpr int kMany = 10000;
  add<TruncatedNewton, Dynamic>("newton_cg", Linking::Nearest, kMany, 5);
  add<Direct, Dynamic>("sparse_newton", Linking::Nearest, kMany, 5);
  add<Divided, Dynamic>("schwarz", Linking::Nearest, kMany, 2);

  add_batch<SpringBatch<double, 2, 4>>(4);
  add_batch<SpringBatch<float, 2, 4>>(4);
  add_batch<SpringBatch<double, 3, 4>>(4);
}

}  // namespace asterism::bench
