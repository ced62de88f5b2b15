// The solver of ElasticConstellation's systems, compiled only here.

#include <asterism/solver/method/auto.hpp>
#include <asterism/trackers/constellation/spring_solvers.hpp>

#include "solver_workspace.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

template ASTERISM_API Summary detail::Compiled::solve(Auto<ElasticSystem>&, const ElasticSystem&,
                                                      ElasticSystem::Points&);

struct detail::ElasticSolvers {
  Auto<ElasticSystem> solver;
};
template class detail::SolverWorkspace<detail::ElasticSolvers>;

void detail::set_anchor(ElasticSystem& system, int node, const Eigen::Matrix2d& information) {
  system.set_anchor_information(node, information);
}

Summary ElasticSolver::solve(const ElasticSystem& system, ElasticSystem::Points& x,
                             const SolverOptions& options) {
  Auto<ElasticSystem>& solver = (*workspace_).solver;
  solver.options = options;
  solver.options.ground_components = true;  // parts without an anchor stay in place
  return solver.solve(system, x);
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
