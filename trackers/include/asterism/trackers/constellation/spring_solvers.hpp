#pragma once

#include <asterism/solver/problem/model.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/run/any_solver.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/summary.hpp>
#include <functional>
#include <optional>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Dpt's spring system: up to 16 parts, which need no heap, on Gaussian anchors.
using DptSystem =
    SpringSystem<double, 2, Eigen::Dynamic, 16, Model<Hooke, Quadratic, AnchorShape::Anisotropic>>;

/// ElasticConstellation's spring system: any number of parts, on robust anchors.
using ElasticSystem = SpringSystem<double, 2, Eigen::Dynamic, Eigen::Dynamic,
                                   Model<Hooke, GemanMcClure, AnchorShape::Anisotropic>>;

namespace detail {

/// SpringSystem::set_anchor_information, compiled once for these systems as their solvers are.
ASTERISM_API void set_anchor(DptSystem& system, int node, const Eigen::Matrix2d& information);
ASTERISM_API void set_anchor(ElasticSystem& system, int node, const Eigen::Matrix2d& information);
template <typename System>
ASTERISM_API void set_anchor(System& system, int node, const Eigen::Matrix2d& information) {
  system.set_anchor_information(node, information);
}

}  // namespace detail

/// The solver of Dpt's systems that a description names: "ida" (the paper's) and "newton", which need no
/// heap, or another of system_methods(). A copy has a workspace of its own.
class ASTERISM_API DptSolver {
 public:
  /// Throws std::invalid_argument for an unknown name or option, and for a value that an option cannot have.
  explicit DptSolver(const SolverDescription& description);
  DptSolver(const DptSolver& other) : DptSolver(other.description_) {}
  DptSolver& operator=(const DptSolver& other) { return *this = DptSolver(other); }
  DptSolver(DptSolver&&) = default;
  DptSolver& operator=(DptSolver&&) = default;
  ~DptSolver() = default;

  /// Moves x (2 x N), the start, to a stationary point of the energy; statuses are the solver's.
  Summary solve(const DptSystem& system, DptSystem::Points& x) { return solve_(system, x); }

 private:
  SolverDescription description_;
  std::function<Summary(const DptSystem&, DptSystem::Points&)> solve_;
};

/// A 3 x 2N matrix.
using DptJacobian =
    Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::ColMajor, 3, DptSystem::kDim * DptSystem::kMaxNodes>;

/// The covariance of three quantities of a placement x that a DptSolver has found, by their derivatives
/// (coordinate d of part i is column 2 i + d): J Sigma J^T with Laplace's covariance Sigma of x. Empty if x
/// is not a strict minimum.
ASTERISM_API std::optional<Eigen::Matrix3d> propagated_covariance(const DptSystem& system,
                                                                  const DptSystem::Points& x,
                                                                  const DptJacobian& jacobian);

/// Whether a placement x that a DptSolver has found is proven to be the global minimum (certify).
ASTERISM_API bool is_certified(const DptSystem& system, const DptSystem::Points& x);

/// Moves x (2 x N), the start, to a stationary point of the energy, as a system of terms. Components that no
/// anchor holds stay where they are.
ASTERISM_API Summary solve_elastic(const ElasticSystem& system, ElasticSystem::Points& x,
                                   const SolverOptions& options);

}  // namespace ASTERISM_ABI
}  // namespace asterism
