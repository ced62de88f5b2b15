// The solvers of Dpt's systems, compiled only here.

#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/energy/covariance.hpp>
#include <asterism/solver/method/make_solver.hpp>
#include <asterism/trackers/constellation/spring_solvers.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

template ASTERISM_API Summary detail::Compiled::solve(Ida<DptSystem>&, const DptSystem&, DptSystem::Points&);
template ASTERISM_API Summary detail::Compiled::solve(Newton<DptSystem>&, const DptSystem&,
                                                      DptSystem::Points&);
template ASTERISM_API SolverRegistry<DptSystem> solver_registry();
template ASTERISM_API Covariance<DptSystem> covariance(const DptSystem&, const DptSystem::Points&);

void detail::set_anchor(DptSystem& system, int node, const Eigen::Matrix2d& information) {
  system.set_anchor_information(node, information);
}

DptSolver::DptSolver(const SolverDescription& description)
    : description_(description), solver_(solver_registry<DptSystem>().make(description)) {}

std::optional<Eigen::Matrix3d> propagated_covariance(const DptSystem& system, const DptSystem::Points& x,
                                                     const DptJacobian& jacobian) {
  const auto parts = covariance(system, x);
  if (!parts) return std::nullopt;
  return jacobian * parts.matrix * jacobian.transpose();
}

bool is_certified(const DptSystem& system, const DptSystem::Points& x) {
  return certify(system, x).certified();
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
