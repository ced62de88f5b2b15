#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/linear/jacobi_metric.hpp>
#include <asterism/solver/method/lbfgs.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/run/compiled.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#ifdef ASTERISM_SOLVER_COMPILED
#include <asterism/solver/terms/from_springs.hpp>
#endif
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string_view>
#include <type_traits>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The default: the method that is fastest for a system of this size, linking and strength of anchors.
///
///   up to 8 nodes, or 12 in the plane               Newton
///   up to 48 nodes, or 32 in space, links at the
///   start near rest, or all nodes on a line or, in
///   space, a plane                                  Newton
///   up to 12 nodes, few links a node                Newton
///   more, a third of all pairs linked or more       Lbfgs from the factored K_dyn
///   few links a node, up to 1000 nodes              "newton-cg", see system_methods
///   few links a node, more nodes                    "schwarz"
///   the same, weak anchors                          "newton-cg" up to 30,000 nodes, "schwarz-direct"
///                                                   up to 300,000, "schwarz" beyond
///   a floppy system on weak anchors                 "newton-sparse" from 100 to 30,000 nodes
///
/// Links are near rest if their strain, (r - mu) / mu, is at most a quarter in the root mean square, as where
/// a tracker starts from the placement in the frame before: Newton then needs few iterations. Header-only or
/// in float, where Newton is without wide vectors, the bounds are 8 and 16 nodes.
///
/// Anchors are weak if most of them have less than 5e-5 of the stiffness that the links of a node have on
/// average, so also where few nodes have an anchor, however stiff. A system with fewer links than
/// coordinates, such as a cloth, is floppy: its links cannot hold its shape (Maxwell 1864), and anchors are
/// weak there below 5e-3.
///
/// The methods in quotation marks are there with asterism::solver_compiled, for systems in double whose model
/// is made of terms, see to_system; elsewhere, Lbfgs with JacobiMetric takes their place.
///
/// The bounds are measured: `asterism-bench crossovers` prints the table. Summary::solver names the method.
/// If a matrix cannot be factored, "newton-cg" or that method continues. All methods start with
/// rigid_alignment.
///
/// Sparse methods use as many threads as ThreadedOptions::threads says, and dense ones one.
///
/// An object holds its workspace: reuse it to solve without allocation, one thread at a time. Sparse methods
/// use the heap; fixed and bounded sizes take dense ones, which do not.
template <typename System>
class Auto {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  ThreadedOptions options;

  Auto() = default;
  /// For type deduction: Auto(system).solve(system, x).
  explicit Auto(const System&, const ThreadedOptions& o = {}) : options(o) {}

  static constexpr std::string_view name() { return "auto"; }

  /// Moves x (Dim x N), the start, to a stationary point of the energy. Statuses as for the method that is
  /// chosen.
  Summary solve(const System& system, Points& x) { return detail::Compiled::solve(*this, system, x); }

 private:
  friend detail::Compiled;

  Summary run(const System& system, Points& x);

  static constexpr bool kVectors = detail::kIsCompiled && std::is_same_v<Scalar, double>;
  static constexpr int kFew = 8;
  static constexpr int kCoordinates = System::kDim == 1 ? 2 : System::kDim;  // Newton's time grows with them
  static constexpr int kNewton = kVectors ? 24 / kCoordinates : kFew;
  static constexpr int kNewtonNearRest = kVectors ? 96 / kCoordinates : 16;
  static constexpr int kNewtonOfFewLinks = 12;
  static constexpr Scalar kNearRest = Scalar(0.25);
  static constexpr int kSmallSparse = 1000;
  static constexpr int kMediumSparse = 30000;
  static constexpr int kFactored = 300000;  // beyond, a factor of the Hessian takes too long
  static constexpr int kSmallFloppy = 100;
  static constexpr Scalar kWeak = Scalar(5e-5);
  static constexpr Scalar kWeakForFloppy = Scalar(5e-3);
  static constexpr bool kHeap = System::kMaxNodes == Eigen::Dynamic;
  static constexpr bool kHasMore = kHeap || System::kMaxNodes > kFew;

  struct Nothing {
    AlignedOptions options;
    Summary solve(const System&, Points&) { return {}; }
  };
  template <bool kWanted, typename Solver>
  using If = std::conditional_t<kWanted, Solver, Nothing>;

  // Whether most nodes have an anchor of less than this share of the stiffness that the links of a node have
  // on average. The values may be bad ones, which the method refuses.
  static bool has_weak_anchors(const System& system, Scalar share) {
    const Scalar links = 2 * system.link_stiffness.sum() / static_cast<Scalar>(system.nodes());
    return 2 * (system.anchor_stiffness.array() < share * links).count() > system.nodes();
  }

  // Whether the strain of the links at x is small, in the mean by stiffness. The values may be bad ones.
  static bool is_near_rest(const System& system, const Points& x) {
    if (x.cols() != system.nodes() || system.rest_length.size() != system.link_count() ||
        system.link_stiffness.size() != system.link_count() ||
        (system.has_offsets() && system.rest_offset.cols() != system.link_count()))
      return false;
    Scalar stretched = 0, at_rest = 0;
    int l = 0;
    for (const Link& link : system.links()) {
      const Scalar k = system.link_stiffness[l], mu = system.rest_length[l];
      const Scalar stretch = detail::link_difference(system, l, link, x).norm() - mu;
      stretched += k * stretch * stretch;
      at_rest += k * mu * mu;
      if (system.has_offsets()) at_rest += k * system.rest_offset.col(l).squaredNorm();
      ++l;
    }
    return stretched <= kNearRest * kNearRest * at_rest;
  }

  // Whether the nodes lie on one line, or in one plane in space: where anchors do as well, or there are none,
  // only Newton leaves it.
  static bool is_flat(const Points& x) {
    if (x.cols() == 0) return true;  // which is refused
    const Points from_centre = x.colwise() - x.rowwise().mean();
    const auto spread = (from_centre * from_centre.transpose()).eval();
    const Scalar least = std::max(Scalar(1e-12), 64 * std::numeric_limits<Scalar>::epsilon());
    return !(spread.determinant() > least * std::pow(spread.trace(), Scalar(System::kDim)));
  }

  // The solve of a system with few links a node.
  Summary solve_sparse(const System& system, Points& x) requires(kHeap) {
    const int n = system.nodes();
    const bool is_floppy = system.link_count() < std::int64_t{System::kDim} * n;
    if (is_floppy && has_weak_anchors(system, kWeakForFloppy) && n >= kSmallFloppy && n <= kMediumSparse) {
      return solve_by_terms("newton", system, x);
    } else if (n > kSmallSparse) {
      if (!has_weak_anchors(system, kWeak) || n > kFactored) return solve_by_terms("schwarz", system, x);
      if (n > kMediumSparse) return solve_by_terms("schwarz-direct", system, x);
    }
    return solve_by_terms("newton-cg", system, x);
  }

  Summary solve_by_terms([[maybe_unused]] std::string_view method, const System& system, Points& x) {
#ifdef ASTERISM_SOLVER_COMPILED
    if constexpr (std::is_same_v<Scalar, double> && detail::has_terms<System>()) {
      if (method.starts_with("schwarz"))
        return detail::solve_by_terms(method, {{"threads", options.threads}}, options, system, x);
      return detail::solve_by_terms(method, {}, options, system, x);
    }
#endif
    return solve_by(jacobi_lbfgs_, system, x);
  }

  template <typename Solver>
  Summary solve_by(Solver& solver, const System& system, Points& x) {
    static_cast<AlignedOptions&>(solver.options) = options;
    if constexpr (requires { solver.options.threads; }) solver.options.threads = options.threads;
    return solver.solve(system, x);
  }

  Newton<System> newton_;
  If<kHasMore, Lbfgs<System>> lbfgs_;
  If<kHasMore, Lbfgs<System, JacobiMetric<System>>> jacobi_lbfgs_;
};

template <typename System>
Summary Auto<System>::run(const System& system, Points& x) {
  if (options.threads < 0) return detail::refused(name(), options.problem());  // not all methods have threads
  const int n = system.nodes();
  if (n <= kNewton) return solve_by(newton_, system, x);
  if constexpr (kHasMore) {
    const std::int64_t pairs = std::int64_t{n} * (n - 1) / 2;
    const bool is_dense = 3 * std::int64_t{system.link_count()} > pairs;
    const bool is_small = n <= (is_dense ? kNewtonNearRest : kNewtonOfFewLinks);
    if (is_small && (!is_dense || is_near_rest(system, x) || is_flat(x))) return solve_by(newton_, system, x);
    if (!kHeap || is_dense) {
      const Summary summary = solve_by(lbfgs_, system, x);
      if (summary.status != Status::NumericalFailure) return summary;
    } else if constexpr (kHeap) {
      return solve_sparse(system, x);
    }
    if constexpr (kHeap) return solve_by_terms("newton-cg", system, x);
    return solve_by(jacobi_lbfgs_, system, x);
  } else {
    return solve_by(newton_, system, x);
  }
}

/// One solve by Auto with a workspace of its own; see Auto::solve. For repeated solves, keep an Auto.
template <typename System>
Summary solve(const System& system, typename System::Points& x, const ThreadedOptions& options = {}) {
  return Auto<System>(system, options).solve(system, x);
}

ASTERISM_COMPILED_SOLVER(Auto)
ASTERISM_COMPILED_SOLVE(solve, ThreadedOptions)

}  // namespace ASTERISM_ABI
}  // namespace asterism
