#pragma once

#include <asterism/solver/detail/compiled.hpp>
#include <asterism/solver/problem/model.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/run/any_solver.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/summary.hpp>
#include <memory>
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

/// The solvers' workspace, which is not part of a tracker's value: a copy has its own.
template <typename Solvers>
class ASTERISM_API SolverWorkspace {
 public:
  SolverWorkspace();
  SolverWorkspace(const SolverWorkspace&);
  SolverWorkspace& operator=(const SolverWorkspace&) { return *this; }
  ~SolverWorkspace();
  Solvers& operator*() const { return *solvers_; }

 private:
  std::unique_ptr<Solvers> solvers_;
};

struct ASTERISM_API ElasticSolvers;
extern template class ASTERISM_API SolverWorkspace<ElasticSolvers>;

/// SpringSystem::set_anchor_information, compiled once for these systems as their solvers are.
ASTERISM_API void set_anchor(DptSystem& system, int node, const Eigen::Matrix2d& information);
ASTERISM_API void set_anchor(ElasticSystem& system, int node, const Eigen::Matrix2d& information);
template <typename System>
ASTERISM_API void set_anchor(System& system, int node, const Eigen::Matrix2d& information) {
  system.set_anchor_information(node, information);
}

}  // namespace detail

/// The solver of Dpt's systems that a description names. A copy has a workspace of its own.
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
  Summary solve(const DptSystem& system, DptSystem::Points& x) { return solver_.solve(system, x); }

 private:
  SolverDescription description_;
  AnySolver<DptSystem> solver_;
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

/// The solver of ElasticConstellation's systems, Auto. Components that no anchor holds stay where they are.
class ASTERISM_API ElasticSolver {
 public:
  /// Moves x (2 x N), the start, to a stationary point of the energy; statuses are those of Auto.
  Summary solve(const ElasticSystem& system, ElasticSystem::Points& x, const SolverOptions& options);

 private:
  detail::SolverWorkspace<detail::ElasticSolvers> workspace_;
};

// What takes a compiler tens of seconds is compiled once, in dpt_solver.cpp and elastic_solver.cpp, as
// asterism::solver_compiled has it for its systems, and only declared for all that include this header. The
// solvers' classes need not be complete for that.

/// @cond

template <typename System>
class DenseCholesky;
template <typename System, typename Factorization>
class Ida;
template <typename System>
class Newton;
template <typename System>
class Auto;
template <typename System>
SolverRegistry<System> solver_registry();
template <typename System>
struct Covariance;
template <typename System>
Covariance<System> covariance(const System& system, const typename System::Points& x);

extern template ASTERISM_API SolverRegistry<DptSystem> solver_registry();
extern template ASTERISM_API Summary detail::Compiled::solve(Ida<DptSystem, DenseCholesky<DptSystem>>&,
                                                             const DptSystem&, DptSystem::Points&);
extern template ASTERISM_API Summary detail::Compiled::solve(Newton<DptSystem>&, const DptSystem&,
                                                             DptSystem::Points&);
extern template ASTERISM_API Covariance<DptSystem> covariance(const DptSystem&, const DptSystem::Points&);
extern template ASTERISM_API Summary detail::Compiled::solve(Auto<ElasticSystem>&, const ElasticSystem&,
                                                             ElasticSystem::Points&);

/// @endcond

}  // namespace ASTERISM_ABI
}  // namespace asterism
