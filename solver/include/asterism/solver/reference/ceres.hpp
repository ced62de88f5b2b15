#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/spring_element.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/any_solver.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/session.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <cmath>
#include <functional>
#include <span>
#include <string_view>
#include <type_traits>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace reference {

/// The method of Ceres.
enum class CeresMethod {
  LevenbergMarquardtDense,   ///< DENSE_NORMAL_CHOLESKY
  LevenbergMarquardtSparse,  ///< SPARSE_NORMAL_CHOLESKY with Ceres's default library
  Lbfgs,                     ///< line search (Wolfe, cubic interpolation), LBFGS of rank 20, Ceres's default
  NonlinearCg,  ///< line search (Wolfe, cubic interpolation), NONLINEAR_CONJUGATE_GRADIENT, Polak-Ribiere
};

namespace detail {

/// A system as the compiled half of the adapter sees it: its springs in double.
struct CeresProblem {
  int dim = 0;
  int nodes = 0;
  std::span<const Link> links;
  const double* anchors = nullptr;  // dim x nodes
  const double* anchor_stiffness = nullptr;
  const double* rest_length = nullptr;
  const double* rest_offset = nullptr;  // dim x links, or none
  const double* link_stiffness = nullptr;
  std::function<bool(int node)> is_fixed;
  /// Replaces d = x_i - x_j - m_ij (dim) by the direction of spring `link`, and returns its length.
  std::function<double(const Link& link, double* d)> spring;
  /// Whether to end at x (dim x nodes), after this many iterations.
  std::function<bool(const double* x, int iteration)> done;
};

/// Minimises from x and writes the result to x. Adds Ceres's counts and message to `summary`.
ASTERISM_API Status minimise(const CeresProblem& problem, CeresMethod method, int max_iterations, double* x,
                             Summary& summary);

}  // namespace detail

/// Version of the Ceres that was compiled with, such as "2.1.0".
ASTERISM_API const char* ceres_version();

/// Ceres as a reference for the library's own solvers: residuals sqrt(k_i) (x_i - a_i) and sqrt(k_ij) (r_ij -
/// mu_ij) with analytic Jacobians, in double whatever the system's scalar. Ceres's own tolerances are off: it
/// is stopped by the same rule as every other solver, and its verdict is recomputed. Silent; Ceres's message
/// is in Summary::message. glog's level is raised for the process while solving, as Ceres 2.1 offers no other
/// way to stop its warnings.
///
/// Iterations are Ceres's successful and unsuccessful steps. Needs target asterism::ceres.
template <typename System, CeresMethod kMethod = CeresMethod::LevenbergMarquardtSparse>
class Ceres {
  static_assert(std::is_same_v<typename System::Model, Springs>, "least squares of springs alone");

 public:
  using Points = typename System::Points;

  SolverOptions options;

  Ceres() = default;
  /// For type deduction: Ceres(system).solve(system, x).
  explicit Ceres(const System&, const SolverOptions& o = {}) : options(o) {}

  static constexpr std::string_view name() {
    switch (kMethod) {
      case CeresMethod::LevenbergMarquardtDense:
        return "Ceres, Levenberg-Marquardt, dense Cholesky";
      case CeresMethod::LevenbergMarquardtSparse:
        return "Ceres, Levenberg-Marquardt, sparse Cholesky";
      case CeresMethod::Lbfgs:
        return "Ceres, L-BFGS";
      case CeresMethod::NonlinearCg:
        return "Ceres, nonlinear CG";
    }
    return "Ceres";
  }

  /// Moves x (Dim x N), the start, to a stationary point of the energy. Statuses other than Converged:
  /// MaxIterations, InvalidInput, OutOfMemory, NumericalFailure if Ceres fails, and NoProgress if it
  /// gives up.
  Summary solve(const System& given, Points& x) {
    if constexpr (System::kMaxNodes == Eigen::Dynamic) {
      if (!session_.fits(given)) {  // see asterism::detail::Compiled
        session_ = {};
        trial_ = gradient_ = Points();
      }
    }
    // A sum of squares has no place for loads.
    if (given.has_loads()) return asterism::detail::refused(name(), asterism::detail::kNoLoads);
    return session_.run(name(), options, given, x, [&](const System& system, Summary& summary) {
      constexpr int kDim = System::kDim;
      using Scalar = typename System::Scalar;
      if constexpr (kMethod ==
                    CeresMethod::LevenbergMarquardtDense) {  // its dense Jacobian and normal matrix
        const double size = double{kDim} * system.nodes();
        asterism::detail::require_memory(sizeof(double) * size * (2 * size + system.link_count() + size));
      }

      SpringSystem<double, kDim> copy(Topology<>::from_links(system.nodes(), system.links()));
      // Ceres has thresholds of its own in the units that it is given, so it is given a system of unit size.
      // Powers of two, for the scaling to be exact.
      const double unit = power_of_two(session_.length());
      const double stiffness = power_of_two(session_.node_stiffness().maxCoeff());
      copy.anchors = system.anchors.template cast<double>() / unit;
      copy.anchor_stiffness = system.anchor_stiffness.template cast<double>() / stiffness;
      copy.rest_length = system.rest_length.template cast<double>() / unit;
      copy.rest_offset = system.rest_offset.template cast<double>() / unit;
      copy.link_stiffness = system.link_stiffness.template cast<double>() / stiffness;
      typename SpringSystem<double, kDim>::Points nodes = x.template cast<double>() / unit;

      detail::CeresProblem problem;
      problem.dim = kDim;
      problem.nodes = copy.nodes();
      problem.links = copy.links();
      problem.anchors = copy.anchors.data();
      problem.anchor_stiffness = copy.anchor_stiffness.data();
      problem.rest_length = copy.rest_length.data();
      problem.rest_offset = copy.has_offsets() ? copy.rest_offset.data() : nullptr;
      problem.link_stiffness = copy.link_stiffness.data();
      problem.is_fixed = [&system](int node) { return system.is_fixed(node); };
      problem.spring = [&copy](const Link& link, double* d) {
        Eigen::Map<Eigen::Matrix<double, kDim, 1>> difference(d);
        const auto spring = asterism::detail::spring(copy, link, difference);
        difference = spring.direction;
        return spring.length;
      };
      problem.done = [&](const double* at, int iteration) {
        trial_ = (unit * Eigen::Map<const decltype(nodes)>(at, kDim, system.nodes())).template cast<Scalar>();
        asterism::detail::evaluate<false>(system, trial_, gradient_);
        return session_.done(trial_, gradient_, iteration);
      };
      const Status status = detail::minimise(problem, kMethod, options.max_iterations, nodes.data(), summary);
      x = (unit * nodes).template cast<Scalar>();
      return status;
    });
  }

 private:
  static double power_of_two(double value) { return value > 0 ? std::ldexp(1.0, std::ilogb(value)) : 1.0; }

  Session<System> session_;
  Points trial_;
  Points gradient_;
};

/// Adds "ceres-dense", "ceres-sparse", "ceres-lbfgs" and "ceres-cg".
template <typename System>
void add_ceres(SolverRegistry<System>& registry) {
  registry.template add<Ceres<System, CeresMethod::LevenbergMarquardtDense>>("ceres-dense");
  registry.template add<Ceres<System, CeresMethod::LevenbergMarquardtSparse>>("ceres-sparse");
  registry.template add<Ceres<System, CeresMethod::Lbfgs>>("ceres-lbfgs");
  registry.template add<Ceres<System, CeresMethod::NonlinearCg>>("ceres-cg");
}

}  // namespace reference
}  // namespace ASTERISM_ABI
}  // namespace asterism
