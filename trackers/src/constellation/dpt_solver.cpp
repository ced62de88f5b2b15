// The solvers of Dpt's systems, compiled here alone.

#include <asterism/solver/energy/covariance.hpp>
#include <asterism/solver/method/ida.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/trackers/constellation/spring_solvers.hpp>

#include "solver_workspace.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

template ASTERISM_API Summary detail::Compiled::solve(Ida<DptSystem>&, const DptSystem&, DptSystem::Points&);
template ASTERISM_API Summary detail::Compiled::solve(Newton<DptSystem>&, const DptSystem&,
                                                      DptSystem::Points&);
template ASTERISM_API Covariance<DptSystem> covariance(const DptSystem&, const DptSystem::Points&);

struct detail::DptSolvers {
  Ida<DptSystem> ida;
  Newton<DptSystem> newton;
};
template class detail::SolverWorkspace<detail::DptSolvers>;

void detail::set_anchor(DptSystem& system, int node, const Eigen::Matrix2d& information) {
  system.set_anchor_information(node, information);
}

Summary DptSolver::solve(const DptSystem& system, DptSystem::Points& x, SpringSolver by,
                         const SolverOptions& options) {
  const auto solve_with = [&](auto& solver) {
    solver.options = options;
    return solver.solve(system, x);
  };
  return by == SpringSolver::Newton ? solve_with((*workspace_).newton) : solve_with((*workspace_).ida);
}

std::optional<Eigen::Matrix3d> propagated_covariance(const DptSystem& system, const DptSystem::Points& x,
                                                     const DptJacobian& jacobian) {
  const auto parts = covariance(system, x);
  if (!parts) return std::nullopt;
  return jacobian * parts.matrix * jacobian.transpose();
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
