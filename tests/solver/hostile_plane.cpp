// The types in asterism::solver_compiled, the batch, and the adapters of other libraries.
#include <asterism/solver/batch/batch_newton.hpp>
#include <asterism/solver/batch/spring_batch.hpp>
#include <asterism/solver/run/summary.hpp>

#include "by_terms.hpp"
#include "hostile_solvers.hpp"

#ifdef ASTERISM_TEST_CHOLMOD
#include <asterism/solver/method/cholmod.hpp>
#endif
#ifdef ASTERISM_TEST_CERES
#include <asterism/solver/reference/ceres.hpp>
#endif
#ifdef ASTERISM_TEST_LBFGS
#include <asterism/solver/reference/liblbfgs.hpp>
#endif

namespace asterism::hostile {

namespace {

using Plane = SpringSystem<double, 2>;
using Space = SpringSystem<double, 3>;
using FourParts = SpringSystem<double, 2, 4>;

// A few nodes of the search tree are enough for this test.
struct ShortSearch : BranchAndBound<Plane> {
  ShortSearch() { options.max_nodes = 20; }
};

using Adapters = std::tuple<
#ifdef ASTERISM_TEST_CHOLMOD
    Ida<Plane, CholmodCholesky<Plane>>, testing::CholmodNewton<Plane>,
#endif
#ifdef ASTERISM_TEST_LBFGS
    reference::Liblbfgs<Plane>,
#endif
    testing::MultiStart<Plane>>;

// Those that refuse loads.
using WithoutLoads = std::tuple<
#ifdef ASTERISM_TEST_CERES
    reference::Ceres<Plane>,
#endif
    testing::Staircase<Plane>, ShortSearch>;

// The batch has neither fixed nodes, offsets, loads nor grounded components, and reports only status and
// energy.
void solve_batch(const Problem& problem, std::vector<Attempt>& attempts) {
  const auto system = system_of<Plane>(problem);
  if (system.defect() || system.has_offsets() || system.has_loads() || !problem.fixed.empty() ||
      problem.hold_floating)
    return;
  constexpr int kLanes = 3;
  SpringBatch<double, 2> batch(system.topology(), kLanes);
  const Plane::Points start = problem.start;
  for (int s = 0; s < kLanes; ++s) batch.set(s, system, start);
  BatchNewton solver(batch);
  solver.options.tolerance = kTolerance;
  solver.options.max_iterations = kIterations;
  solver.options.align = problem.align;
  solver.solve(batch);
  Summary summary;
  summary.solver = "batch";
  summary.status = batch.status(kLanes - 1);
  summary.message = to_string(summary.status);
  summary.final_energy = batch.final_energy(kLanes - 1);
  const Plane::Points x = batch.points(kLanes - 1);
  const auto bytes = sizeof(double) * static_cast<std::size_t>(start.size());
  attempts.push_back({"batch", summary, x, std::memcmp(x.data(), start.data(), bytes) == 0});
}

}  // namespace

void solve_plane(const Problem& problem, std::vector<Attempt>& attempts) {
  static CommonSolvers<Plane> common;
  static SparseSolvers<Plane> sparse;
  static TermSolvers<Plane> dividing;
  static Adapters adapters;
  static WithoutLoads without_loads;
  static CommonSolvers<FourParts> four_parts;
  solve_with<Plane>(common, problem, attempts);
  solve_with<Plane>(sparse, problem, attempts);
  solve_with<Plane>(dividing, problem, attempts);
  solve_with<Plane>(adapters, problem, attempts);
  if (problem.loads.size() == 0) solve_with<Plane>(without_loads, problem, attempts);
  solve_batch(problem, attempts);
  // FourParts stores at most one link per pair.
  if (problem.nodes() != 4 || problem.links.size() > 6) return;
  const auto first = attempts.size();
  solve_with<FourParts>(four_parts, problem, attempts);
  for (auto a = first; a < attempts.size(); ++a) attempts[a].solver += ", 4 nodes";
}

void solve_space(const Problem& problem, std::vector<Attempt>& attempts) {
  static CommonSolvers<Space> common;
  static SparseSolvers<Space> sparse;
  static TermSolvers<Space> dividing;
  solve_with<Space>(common, problem, attempts);
  solve_with<Space>(sparse, problem, attempts);
  solve_with<Space>(dividing, problem, attempts);
}

}  // namespace asterism::hostile
