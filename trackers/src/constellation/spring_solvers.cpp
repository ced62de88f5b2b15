// The solvers of the trackers' systems, compiled only here.

#include <algorithm>
#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/energy/covariance.hpp>
#include <asterism/solver/method/ida.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/terms/from_springs.hpp>
#include <asterism/solver/terms/registry.hpp>
#include <asterism/solver/terms/solve.hpp>
#include <asterism/trackers/constellation/spring_solvers.hpp>
#include <memory>

namespace asterism {
inline namespace ASTERISM_ABI {

void detail::set_anchor(DptSystem& system, int node, const Eigen::Matrix2d& information) {
  system.set_anchor_information(node, information);
}
void detail::set_anchor(ElasticSystem& system, int node, const Eigen::Matrix2d& information) {
  system.set_anchor_information(node, information);
}

DptSolver::DptSolver(const SolverDescription& description) : description_(description) {
  SolverRegistry<DptSystem> own;
  own.set_certifier(kept_certifier<DptSystem>());
  own.add<Ida<DptSystem>>("ida");
  own.add<Newton<DptSystem>>("newton");
  own.add<Newton<DptSystem>>("auto");
  const std::vector<std::string> names = own.names();
  if (std::find(names.begin(), names.end(), description.name) != names.end()) {
    const auto solver = std::make_shared<AnySolver<DptSystem>>(own.make(description));
    solve_ = [solver](const DptSystem& system, DptSystem::Points& x) { return solver->solve(system, x); };
    return;
  }
  const auto solver = std::make_shared<AnySolver<System>>(system_solvers().make(description));
  solve_ = [solver](const DptSystem& system, DptSystem::Points& x) {
    Eigen::MatrixXd placement = x;
    const Summary summary = solver->solve(to_system(system), placement);
    x = placement;
    return summary;
  };
}

std::optional<Eigen::Matrix3d> propagated_covariance(const DptSystem& system, const DptSystem::Points& x,
                                                     const DptJacobian& jacobian) {
  const auto parts = covariance(system, x);
  if (!parts) return std::nullopt;
  return jacobian * parts.matrix * jacobian.transpose();
}

bool is_certified(const DptSystem& system, const DptSystem::Points& x) {
  return certify(system, x).certified();
}

Summary solve_elastic(const ElasticSystem& system, ElasticSystem::Points& x, const SolverOptions& options) {
  AlignedOptions grounded(options);
  grounded.hold_floating = true;
  Eigen::MatrixXd placement = x;
  const Summary summary = solve(to_system(system), placement, grounded);
  x = placement;
  return summary;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
