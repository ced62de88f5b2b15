// Solvers on the random systems of the paper's Sec. 3.2.1, per size, to one stopping rule. Time is per solve;
// counters give the mean iterations and time an iteration, and the share of solves that converged.
#include <asterism/solver.hpp>

#ifdef ASTERISM_BENCH_CHOLMOD
#include <asterism/solver/cholmod.hpp>
#endif
#ifdef ASTERISM_BENCH_CERES
#include <asterism/solver/ceres.hpp>
#endif

#include <benchmark/benchmark.h>

#include <cstddef>
#include <string>
#include <vector>

#include "../tests/solver/random_system.hpp"
#include "../tests/solver/sparse_system.hpp"

namespace {

using namespace asterism;

// Within reach of methods that compare energies.
constexpr SolverOptions kOptions{.tolerance = 1e-6, .max_iterations = 10000};

template <typename Solver, typename System>
void solve(benchmark::State& state) {
  const int n = static_cast<int>(state.range(0));
  asterism::testing::Rng rng(1);
  std::vector<asterism::testing::RandomSystem<System>> samples;
  for (int i = 0; i < (n <= 16 ? 100 : 10); ++i) {
    samples.push_back(asterism::testing::random_system<System>(rng, System::TopologyType::full(n)));
  }

  Solver solver;
  solver.options = kOptions;
  double iterations = 0;
  double converged = 0;
  std::size_t next = 0;
  for (auto _ : state) {
    const auto& [system, start] = samples[next];
    next = (next + 1) % samples.size();
    auto x = start;
    const Summary summary = solver.solve(system, x);
    benchmark::DoNotOptimize(x.data());
    iterations += summary.iterations;
    converged += summary.status == Status::Converged;
  }
  state.SetLabel(std::string(Solver::name()));
  state.counters["iterations"] = benchmark::Counter(iterations, benchmark::Counter::kAvgIterations);
  state.counters["converged"] = benchmark::Counter(converged, benchmark::Counter::kAvgIterations);
  state.counters["per_iteration"] =
      benchmark::Counter(iterations, benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

using Fixed4 = SpringSystem<double, 2, 4>;
using Fixed4f = SpringSystem<float, 2, 4>;
using Bounded = SpringSystem<double, 2, Eigen::Dynamic, 16>;
using Dynamic = SpringSystem<double, 2>;

BENCHMARK(solve<Ida<Fixed4>, Fixed4>)->Name("ida/fixed")->Arg(4);
BENCHMARK(solve<Ida<Fixed4f>, Fixed4f>)->Name("ida/fixed_float")->Arg(4);
BENCHMARK(solve<Ida<Bounded>, Bounded>)->Name("ida/bounded_16")->Arg(4)->Arg(9)->Arg(16);
BENCHMARK(solve<Ida<Dynamic>, Dynamic>)
    ->Name("ida/dynamic")
    ->Arg(4)
    ->Arg(9)
    ->Arg(16)
    ->Arg(36)
    ->Arg(64)
    ->Arg(100);
BENCHMARK(solve<NonlinearCg<Fixed4>, Fixed4>)->Name("ncg/fixed")->Arg(4);
BENCHMARK(solve<NonlinearCg<Dynamic>, Dynamic>)
    ->Name("ncg/dynamic")
    ->Arg(4)
    ->Arg(9)
    ->Arg(16)
    ->Arg(36)
    ->Arg(64)
    ->Arg(100);
BENCHMARK(solve<Newton<Fixed4>, Fixed4>)->Name("newton/fixed")->Arg(4);
BENCHMARK(solve<Newton<Fixed4f>, Fixed4f>)->Name("newton/fixed_float")->Arg(4);
BENCHMARK(solve<Newton<Bounded>, Bounded>)->Name("newton/bounded_16")->Arg(4)->Arg(9)->Arg(16);
BENCHMARK(solve<Newton<Dynamic>, Dynamic>)->Name("newton/dynamic")->Arg(4)->Arg(9)->Arg(16)->Arg(36);
#ifdef ASTERISM_BENCH_CHOLMOD
BENCHMARK(solve<CholmodIda<Dynamic>, Dynamic>)->Name("ida/cholmod")->Arg(36)->Arg(100);
#endif
#ifdef ASTERISM_BENCH_CERES
using reference::CeresMethod;
template <CeresMethod kMethod>
using Ceres = reference::Ceres<Dynamic, kMethod>;
BENCHMARK(solve<Ceres<CeresMethod::LevenbergMarquardtDense>, Dynamic>)
    ->Name("ceres/lm_dense")
    ->Arg(4)
    ->Arg(16)
    ->Arg(36);
BENCHMARK(solve<Ceres<CeresMethod::LevenbergMarquardtSparse>, Dynamic>)
    ->Name("ceres/lm_sparse")
    ->Arg(4)
    ->Arg(16)
    ->Arg(36);
BENCHMARK(solve<Ceres<CeresMethod::NonlinearCg>, Dynamic>)->Name("ceres/ncg")->Arg(4)->Arg(16)->Arg(36);
#endif

template <template <typename> typename Policy>
using LbfgsWith = Lbfgs<Dynamic, Policy<Dynamic>>;
template <template <typename> typename Policy>
using NewtonCgWith = NewtonCg<Dynamic, Policy<Dynamic>>;

BENCHMARK(solve<Lbfgs<Fixed4>, Fixed4>)->Name("lbfgs/fixed")->Arg(4);
BENCHMARK(solve<Lbfgs<Dynamic>, Dynamic>)
    ->Name("lbfgs/dynamic")
    ->Arg(4)
    ->Arg(16)
    ->Arg(36)
    ->Arg(64)
    ->Arg(100)
    ->Arg(200);
BENCHMARK(solve<NewtonCg<Fixed4>, Fixed4>)->Name("newton_cg/fixed")->Arg(4);
BENCHMARK(solve<NewtonCgWith<DenseCholesky>, Dynamic>)
    ->Name("newton_cg/dynamic")
    ->Arg(4)
    ->Arg(16)
    ->Arg(36)
    ->Arg(64)
    ->Arg(100)
    ->Arg(200);
BENCHMARK(solve<Ida<Dynamic>, Dynamic>)->Name("ida/dynamic")->Arg(200);

// Large systems of local links.
template <typename Solver>
void solve_sparse(benchmark::State& state) {
  const auto [system, start] = asterism::testing::sparse_system<Dynamic>(1, static_cast<int>(state.range(0)));
  Summary summary;
  for (auto _ : state) {
    Solver solver;
    solver.options = kOptions;
    auto x = start;
    summary = solver.solve(system, x);
    benchmark::DoNotOptimize(x.data());
  }
  state.SetLabel(std::string(Solver::name()));
  state.counters["iterations"] = summary.iterations;
  state.counters["converged"] = summary.status == Status::Converged;
  state.counters["energy"] = summary.final_energy;
}

#define ASTERISM_SPARSE(solver, name) \
  BENCHMARK(solve_sparse<solver>)->Name(name)->Arg(10000)->Arg(100000)->Unit(benchmark::kMillisecond)
ASTERISM_SPARSE(LbfgsWith<JacobiMetric>, "lbfgs/sparse_jacobi");
ASTERISM_SPARSE(LbfgsWith<SparseCholesky>, "lbfgs/sparse");
ASTERISM_SPARSE(NewtonCg<Dynamic>, "newton_cg/sparse_jacobi");
#ifdef ASTERISM_BENCH_CHOLMOD
ASTERISM_SPARSE(LbfgsWith<CholmodCholesky>, "lbfgs/sparse_cholmod");
ASTERISM_SPARSE(CholmodIda<Dynamic>, "ida/sparse_cholmod");
#endif

}  // namespace

BENCHMARK_MAIN();
