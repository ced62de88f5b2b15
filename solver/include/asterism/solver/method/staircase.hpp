#pragma once

#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <asterism/solver/detail/cast_system.hpp>
#include <asterism/solver/detail/compiled.hpp>
#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/memory.hpp>
#include <asterism/solver/detail/minoriser.hpp>
#include <asterism/solver/detail/saddle.hpp>
#include <asterism/solver/detail/scratch.hpp>
#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/method/newton_cg.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/run/iteration.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <chrono>
#include <new>
#include <optional>
#include <string_view>
#include <type_traits>
#include <utility>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace detail {

/// Whether Staircase can solve systems of this type.
template <typename System>
constexpr bool is_liftable() {
  return !System::kAnisotropic && !System::kHasTriples && !System::kAnisotropicLinks &&
         has_minoriser<typename System::Model::LinkPotential>();
}

// Where systems in the plane and in space, of all scalars and sizes, are lifted to.
using TwiceLiftedPlane = SpringSystem<double, 5>;
using LiftedSpace = SpringSystem<double, 4>;
using TwiceLiftedSpace = SpringSystem<double, 6>;

/// The same system in kExtra more dimensions: anchors stay where they are, nodes may leave. Its least energy
/// is no higher, and it has fewer minima. In double, of any number of nodes, so that systems of all sizes and
/// scalars share its solver.
template <typename System, int kExtra>
class Lift {
 public:
  using Lifted =
      SpringSystem<double, System::kDim + kExtra, Eigen::Dynamic, Eigen::Dynamic, typename System::Model>;
  using Points = typename Lifted::Points;

  /// Moves `points`, of fewer rows, down from where they are: first along the direction v of negative
  /// curvature in the first dimension that they lack, then to a minimum. False where rounding leaves no way
  /// down. Adds to `total` what it took, and raises its lower bound by what is proven at the minimum.
  bool descend(const System& system, const Eigen::VectorXd& v, double curvature, const SolverOptions& options,
               const IterationCallback& on_iteration, Eigen::MatrixXd& points, Summary& total) {
    lifted_.emplace(cast_system<Lifted>(system));
    x_.setZero(Lifted::kDim, points.cols());
    x_.topRows(points.rows()) = points;
    direction_.setZero(Lifted::kDim, points.cols());
    direction_.row(points.rows()) = v.transpose();
    const double t = step_off_saddle(*lifted_, x_, energy(*lifted_, x_), characteristic_length(*lifted_, x_),
                                     curvature * v.squaredNorm(), direction_, trial_, total);
    if (t == 0) return false;
    x_ += t * direction_;
    solver_.options = options;
    solver_.options.align = false;
    solver_.options.gap = 0;
    solver_.options.on_iteration = on_iteration;
    const Summary summary = solver_.solve(*lifted_, x_);
    if (summary.status == Status::OutOfMemory) raise(std::bad_alloc());
    total.add_work(summary);
    if (!summary.usable() || summary.status == Status::Interrupted) return false;
    points = x_;
    total.lower_bound = std::max(total.lower_bound, prover_.stretched_bound(*lifted_, x_));
    return true;
  }

  /// Prover::negative_direction at the minimum.
  double negative_direction(Eigen::VectorXd& v) { return prover_.negative_direction(*lifted_, x_, v); }

 private:
  std::optional<Lifted> lifted_;
  NewtonCg<Lifted> solver_;
  Prover<Lifted, SparseFactor<double>> prover_;
  Points x_, direction_, trial_;
};

}  // namespace detail

/// The global minimum, or an interval that holds its energy: the Riemannian staircase of Boumal (2015), which
/// CORA climbs for range-aided SLAM (Papalia et al. 2023).
///
/// `Solver` finds a minimum x. If certify does not prove it to be the lowest, W has a negative direction v,
/// and W is the Hessian of E in a dimension that x does not use: the same system with one more dimension
/// descends along v to a minimum, which is no higher than any in Dim dimensions if W is positive
/// semi-definite there; if it is not, two more dimensions are added. Its energy, as far as it is proven
/// despite rounding, is a lower bound of E. Without their last coordinates, its nodes are another start for
/// `Solver`.
///
/// The lower of both minima is returned. Summary::lower_bound is the lower end of the interval and
/// final_energy the upper; if their distance is within SolverOptions::gap (1e-6 if that is 0), the message
/// says that this is the global minimum. For robust anchors the only lower bound is 0. Uses the heap; an
/// object holds its workspace, one thread at a time. Staircase does not support anisotropic anchors, loads,
/// and links that certify does not support.
template <typename System, typename Solver>
requires(detail::is_liftable<System>()) class Staircase {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  /// The options of `Solver`.
  std::decay_t<decltype(std::declval<Solver&>().options)> options;

  /// As options.on_iteration, which is not called there, for the iterations in more dimensions: x has more
  /// rows than a point of the system, and the energy is below that of the system.
  IterationCallback on_lifted_iteration = {};

  static constexpr std::string_view name() { return "staircase"; }

  /// Moves x (Dim x N) to the lowest minimum found. The Summary is that of the solve that found it, except
  /// that iterations, evaluations, linear solves, factorisations and time are totals, and the initial energy
  /// is that of the given x. Statuses are those of `Solver`.
  Summary solve(const System& system, Points& x) { return detail::Compiled::solve(*this, system, x); }

 private:
  friend detail::Compiled;

  Summary run(const System& system, Points& x);

  void climb(const System& system, Points& x, Summary& best) {
    certifier_.options.gap = options.gap > 0 ? options.gap : CertifyOptions().gap;
    if (is_proven(system, x, best)) return;
    if (nodes_ != system.nodes() || links_ != system.link_count()) first_.anew(), second_.anew();
    nodes_ = system.nodes();
    links_ = system.link_count();
    Eigen::VectorXd v;
    Eigen::MatrixXd lifted = x.template cast<double>();
    double curvature = certifier_.negative_direction(system, x, v);
    auto& first = first_.get();
    if (!(curvature < 0) || !first.descend(system, v, curvature, options, on_lifted_iteration, lifted, best))
      return;
    if (ends_with(system, lifted, x, best)) return;
    curvature = first.negative_direction(v);
    if (!(curvature < 0) ||
        !second_.get().descend(system, v, curvature, options, on_lifted_iteration, lifted, best))
      return;
    ends_with(system, lifted, x, best);
  }

  // Takes the minimum below the lifted points if it is lower. Whether nothing is left to be found.
  bool ends_with(const System& system, const Eigen::MatrixXd& lifted, Points& x, Summary& best) {
    Points trial = lifted.topRows(System::kDim).template cast<Scalar>();
    Summary summary = solver_.solve(system, trial);
    if (summary.status == Status::OutOfMemory) detail::raise(std::bad_alloc());
    const bool is_lower = summary.usable() && summary.final_energy < best.final_energy;
    if (is_lower) {
      x = trial;
      summary.initial_energy = best.initial_energy;
      summary.lower_bound = best.lower_bound;
      std::swap(summary, best);
    }
    best.add_work(summary);
    if (summary.status == Status::Interrupted || best.status == Status::Interrupted) return true;
    return is_lower ? is_proven(system, x, best) : says_so(best);
  }

  bool is_proven(const System& system, const Points& x, Summary& best) {
    const Certificate certificate = certifier_.certify(system, x);
    if (certificate.proof != Proof::NotApplicable)
      best.lower_bound = std::max(best.lower_bound, certificate.lower_bound);
    return says_so(best, certificate.certified());
  }

  bool says_so(Summary& best, bool is_certified = false) const {
    if (!is_certified && !best.is_within(certifier_.options.gap)) return false;
    best.message = "within the gap of the global minimum";
    return true;
  }

  Solver solver_;
  Certifier<System> certifier_;
  detail::Scratch<detail::Lift<System, 1>> first_;
  detail::Scratch<detail::Lift<System, 3>> second_;
  int nodes_ = -1;  // of the last system that was lifted
  int links_ = -1;
};

template <typename System, typename Solver>
requires(detail::is_liftable<System>()) Summary Staircase<System, Solver>::run(const System& system,
                                                                               Points& x) {
  if (system.has_loads()) return detail::refused(name(), detail::kNoLoads);
  const auto begin = std::chrono::steady_clock::now();
  solver_.options = options;
  if (!solver_.options.certifier) solver_.options.certifier = certifier_;
  Summary best = solver_.solve(system, x);
  if (best.usable() && best.status != Status::Interrupted) {
    detail::attempt<std::bad_alloc>(
        [&] { climb(system, x, best); },
        [&best](const std::bad_alloc& error) { best.message = detail::memory_message(error); });
  }
  best.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return best;
}

#ifdef ASTERISM_SOLVER_COMPILED
extern template ASTERISM_API Summary detail::Compiled::solve(NewtonCg<detail::TwiceLiftedPlane>&,
                                                             const detail::TwiceLiftedPlane&,
                                                             detail::TwiceLiftedPlane::Points&);
extern template ASTERISM_API Summary detail::Compiled::solve(NewtonCg<detail::LiftedSpace>&,
                                                             const detail::LiftedSpace&,
                                                             detail::LiftedSpace::Points&);
extern template ASTERISM_API Summary detail::Compiled::solve(NewtonCg<detail::TwiceLiftedSpace>&,
                                                             const detail::TwiceLiftedSpace&,
                                                             detail::TwiceLiftedSpace::Points&);
#endif

}  // namespace ASTERISM_ABI
}  // namespace asterism
