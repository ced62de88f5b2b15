// The library's solvers by their names, and variants of them from the literature.
#include <asterism/solver/method/make_solver.hpp>

#include "../comparison_solvers.hpp"
#include "../laboratory.hpp"

#ifdef ASTERISM_BENCH_CHOLMOD
#include <asterism/solver/method/cholmod.hpp>
#endif

namespace asterism::bench {
namespace {

const std::string kOurs = "Asterism " ASTERISM_VERSION;

const SolverRegistry<System>& registry() {
  static const SolverRegistry<System> all = [] {
    SolverRegistry<System> made = solver_registry<System>();
    made.add<Lbfgs<System, SparseCholesky<System>>>("lbfgs-cholesky");
    made.add<AndersonIda<System>>("ida-anderson");
    made.add<ChebyshevIda<System>>("ida-chebyshev");
#ifdef ASTERISM_BENCH_CHOLMOD
    add_cholmod(made);
#endif
    return made;
  }();
  return all;
}

// With `compiled_for_four`, problems of four nodes get a solver compiled for four, as a user would do.
SolverEntry entry(const std::string& name, int dense_nodes, int sparse_nodes,
                  bool compiled_for_four = false) {
  const auto make = [name, compiled_for_four](int nodes) -> std::unique_ptr<Runner> {
    if (compiled_for_four && nodes == 4)
      return std::make_unique<RunnerOf<FourNodes>>(make_solver<FourNodes>(name));
    return std::make_unique<RunnerOf<System>>(registry().make(name));
  };
  return {name, std::string(registry().make(name).name()), kOurs, dense_nodes, sparse_nodes, make};
}

std::unique_ptr<Runner> make_relaxed(int) {
  return std::make_unique<RunnerOf<System>>(registry().make("ida", {{"relaxation", 1.7}}));
}

// For solvers whose own name does not tell the method.
SolverEntry titled(SolverEntry made, const std::string& title) {
  made.title = title;
  return made;
}

constexpr bool kForFour = true;
const Registration kAll[] = {
    Registration(entry("auto", 1000, 1000000, kForFour)),
    Registration(entry("ida", 1000, 0, kForFour)),
    Registration(entry("ida-sparse", 0, 10000)),
    Registration(entry("ida-anderson", 1000, 0)),
    Registration(entry("ida-chebyshev", 1000, 0)),
    Registration({"ida-relaxed", "IDA, over-relaxed by 1.7", kOurs, 1000, 0, make_relaxed}),
    Registration(entry("lbfgs", 1000, 0, kForFour)),
    Registration(entry("lbfgs-jacobi", 1000, 100000)),
    Registration(entry("lbfgs-cholesky", 0, 10000)),
    Registration(titled(entry("multi-start", 200, 10000), "auto from 8 starts")),
    Registration(titled(entry("staircase", 200, 10000, kForFour), "auto and the staircase")),
    Registration(titled(entry("branch-and-bound", 8, 0, kForFour), "the staircase and branch and bound")),
    Registration(entry("ncg", 1000, 10000)),
    Registration(entry("ncg-forward", 64, 0)),
    Registration(entry("ncg-central", 64, 0)),
    Registration(entry("newton", 64, 0, kForFour)),
    Registration(entry("newton-cg", 400, 100000)),
    Registration(entry("newton-sparse", 100, 100000)),
    Registration(entry("schwarz", 0, 1000000)),
    Registration(entry("schwarz-direct", 0, 1000000)),
#ifdef ASTERISM_BENCH_CHOLMOD
    Registration(entry("ida-cholmod", 0, 10000)),
#endif
};

}  // namespace
}  // namespace asterism::bench
