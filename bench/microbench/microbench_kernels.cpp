// The kernels of which the methods' iterations consist. A call's result is not the next one's input: calls
// overlap as far as the processor allows, so times measure throughput, not latency.
#include <asterism/solver.hpp>
#include <string>
#include <type_traits>

#include "microbench.hpp"
#include "microbench_flops.hpp"

#ifdef ASTERISM_BENCH_CHOLMOD
#include <asterism/solver/method/cholmod.hpp>
#endif

namespace asterism::bench {

namespace {

using benchmark::DoNotOptimize;

template <typename System>
void energy_kernel(benchmark::State& state, const testing::RandomSystem<System>& sample) {
  const System& system = sample.system;
  const auto& x = sample.start;
  measure<typename System::Scalar>(state, flops::energy(system), instructions_of_springs(system),
                                   [&] { DoNotOptimize(energy(system, x)); });
}

template <typename System>
void gradient_kernel(benchmark::State& state, const testing::RandomSystem<System>& sample) {
  const System& system = sample.system;
  const auto& x = sample.start;
  typename System::Points gradient;
  measure<typename System::Scalar>(state, flops::energy_and_gradient(system), instructions_of_springs(system),
                                   [&] {
                                     DoNotOptimize(energy_and_gradient(system, x, gradient));
                                     DoNotOptimize(gradient.data());
                                   });
}

/// The dense matrix.
template <typename System>
void hessian_kernel(benchmark::State& state, const testing::RandomSystem<System>& sample) {
  const System& system = sample.system;
  const auto& x = sample.start;
  measure<typename System::Scalar>(state, flops::hessian(system), Simd::Portable, [&] {
    auto matrix = hessian(system, x);
    DoNotOptimize(matrix.data());
  });
}

/// From triplets, with the pattern.
template <typename System>
void sparse_hessian_kernel(benchmark::State& state, const testing::RandomSystem<System>& sample) {
  const System& system = sample.system;
  const auto& x = sample.start;
  measure<typename System::Scalar>(state, flops::hessian(system), Simd::Portable, [&] {
    auto matrix = sparse_hessian(system, x);
    DoNotOptimize(matrix.valuePtr());
  });
}

// Newton's matrix at the start, as in its first iteration: positive definite.
template <typename System>
struct NewtonStart {
  explicit NewtonStart(const testing::RandomSystem<System>& sample) {
    typename System::NodeVector stiffness;
    asterism::detail::node_stiffness(sample.system, stiffness);
    matrix.reset(stiffness);
    matrix.assemble(sample.system, sample.start, true, gradient);
    DoNotOptimize(this);
  }
  int order() const { return static_cast<int>(gradient.size()); }

  asterism::detail::NewtonMatrix<System> matrix;
  typename System::Points gradient;
};

/// Energy, gradient and Hessian into Newton's packed matrix.
template <typename System>
void newton_assembly_kernel(benchmark::State& state, const testing::RandomSystem<System>& sample) {
  const System& system = sample.system;
  const auto& x = sample.start;
  NewtonStart<System> start(sample);
  measure<typename System::Scalar>(state, flops::newton_assembly(system), Simd::Portable, [&] {
    DoNotOptimize(start.matrix.assemble(system, x, true, start.gradient));
  });
}

/// L D L^T of that matrix, with the copy that it overwrites.
template <typename System>
void newton_factorization_kernel(benchmark::State& state, const testing::RandomSystem<System>& sample) {
  const NewtonStart<System> start(sample);
  auto matrix = start.matrix;
  DoNotOptimize(&matrix);
  measure<typename System::Scalar>(state, flops::ldlt(start.order()), Simd::Portable, [&] {
    matrix = start.matrix;
    DoNotOptimize(matrix.factorize());
  });
}

/// The step from the factors.
template <typename System>
void newton_substitution_kernel(benchmark::State& state, const testing::RandomSystem<System>& sample) {
  NewtonStart<System> start(sample);
  start.matrix.factorize();
  typename System::Points step;
  measure<typename System::Scalar>(state, flops::ldlt_solve(start.order()), Simd::Portable, [&] {
    DoNotOptimize(start.matrix.solve(step));
    DoNotOptimize(step.data());
  });
}

/// K_dyn assembled and factored by a policy of Ida; sparse ones keep their ordering.
template <typename System, typename Factorization>
void factorization_kernel(benchmark::State& state, const testing::RandomSystem<System>& sample) {
  constexpr bool kIsDense = std::is_same_v<Factorization, DenseCholesky<System>>;
  Factorization factorization;
  factorization.factorize(sample.system);
  DoNotOptimize(&factorization);
  // The operations of sparse factors depend on the ordering, which the policies do not expose.
  const double operations = kIsDense ? flops::dense_cholesky(sample.system) : 0;
  measure<typename System::Scalar>(state, operations, Simd::Portable,
                                   [&] { DoNotOptimize(factorization.factorize(sample.system)); });
}

/// x - K_dyn^-1 g from the factors or, for few nodes, the inverse.
template <typename System, typename Factorization>
void substitution_kernel(benchmark::State& state, const testing::RandomSystem<System>& sample) {
  constexpr bool kIsDense = std::is_same_v<Factorization, DenseCholesky<System>>;
  Factorization factorization;
  factorization.factorize(sample.system);
  DoNotOptimize(&factorization);
  const typename System::Points g = gradient(sample.system, sample.start);
  typename System::Points x = sample.start;
  const double operations = kIsDense ? flops::dense_cholesky_solve(sample.system) : 0;
  measure<typename System::Scalar>(state, operations, Simd::Portable, [&] {
    factorization.descend(g, x);
    DoNotOptimize(x.data());
  });
}

template <typename System>
void alignment_kernel(benchmark::State& state, const testing::RandomSystem<System>& sample) {
  const System& system = sample.system;
  const auto& x = sample.start;
  measure<typename System::Scalar>(state, flops::alignment(system), Simd::Portable, [&] {
    auto aligned = rigid_alignment(system, x);
    DoNotOptimize(aligned.data());
  });
}

template <typename System>
using Kernel = void (*)(benchmark::State&, const testing::RandomSystem<System>&);

// Runs on a random system whose address escapes; otherwise the compiler could hoist constant work out of the
// loop.
template <typename System>
void add(const std::string& kernel, Linking linking, int nodes, Kernel<System> run) {
  const std::string name = name_of<System>(kernel, linking, nodes);
  benchmark::RegisterBenchmark(name.c_str(), [=](benchmark::State& state) {
    const auto sample = make_system<System>(linking, nodes, 1);
    DoNotOptimize(&sample);
    run(state, sample);
  });
}

// The kernels of fully linked systems that any method evaluates.
template <typename System>
void add_evaluations(int nodes) {
  add<System>("energy", Linking::Full, nodes, energy_kernel<System>);
  add<System>("energy_and_gradient", Linking::Full, nodes, gradient_kernel<System>);
  add<System>("alignment", Linking::Full, nodes, alignment_kernel<System>);
}

template <typename System>
void add_newton(int nodes) {
  add<System>("newton_assembly", Linking::Full, nodes, newton_assembly_kernel<System>);
  add<System>("newton_factorization", Linking::Full, nodes, newton_factorization_kernel<System>);
  add<System>("newton_substitution", Linking::Full, nodes, newton_substitution_kernel<System>);
}

template <typename System>
void add_matrices(int nodes) {
  using Cholesky = DenseCholesky<System>;
  add<System>("hessian", Linking::Full, nodes, hessian_kernel<System>);
  add<System>("cholesky_factorization", Linking::Full, nodes, factorization_kernel<System, Cholesky>);
  add<System>("cholesky_substitution", Linking::Full, nodes, substitution_kernel<System, Cholesky>);
}

}  // namespace

void add_kernels() {
  add_evaluations<Fixed>(4);
  add_evaluations<FixedFloat>(4);
  add_evaluations<FixedSpace>(4);
  for (const int nodes : {4, 16, 64, 256}) add_evaluations<Dynamic>(nodes);
  for (const int nodes : {16, 64}) add_evaluations<DynamicFloat>(nodes);
  for (const int nodes : {16, 64}) add_evaluations<DynamicSpace>(nodes);

  add_newton<Fixed>(4);
  add_newton<FixedFloat>(4);
  add_newton<FixedSpace>(4);
  for (const int nodes : {4, 16, 64}) add_newton<Dynamic>(nodes);

  add_matrices<Fixed>(4);
  for (const int nodes : {4, 16, 64, 256}) add_matrices<Dynamic>(nodes);

  const auto add_sparse = [](const std::string& kernel, Kernel<Dynamic> run) {
    add<Dynamic>(kernel, Linking::Nearest, 10000, run);
  };
  add_sparse("energy", energy_kernel<Dynamic>);
  add_sparse("energy_and_gradient", gradient_kernel<Dynamic>);
  add_sparse("hessian", sparse_hessian_kernel<Dynamic>);
  add_sparse("cholesky_factorization", factorization_kernel<Dynamic, SparseCholesky<Dynamic>>);
  add_sparse("cholesky_substitution", substitution_kernel<Dynamic, SparseCholesky<Dynamic>>);
#ifdef ASTERISM_BENCH_CHOLMOD
  add_sparse("cholmod_factorization", factorization_kernel<Dynamic, CholmodCholesky<Dynamic>>);
  add_sparse("cholmod_substitution", substitution_kernel<Dynamic, CholmodCholesky<Dynamic>>);
#endif
  add_sparse("alignment", alignment_kernel<Dynamic>);
}

}  // namespace asterism::bench
