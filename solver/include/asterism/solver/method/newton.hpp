#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/numbers.hpp>
#include <asterism/solver/energy/align.hpp>
#include <asterism/solver/energy/compiled_four_nodes.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/free_motion.hpp>
#include <asterism/solver/energy/hessian_operator.hpp>
#include <asterism/solver/energy/newton_matrix.hpp>
#include <asterism/solver/energy/spring_element.hpp>
#include <asterism/solver/method/descent.hpp>
#include <asterism/solver/method/saddle.hpp>
#include <asterism/solver/run/compiled.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/session.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <cmath>
#include <limits>
#include <string_view>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of Newton.
struct NewtonOptions : AlignedOptions {
  /// Continue from stationary points whose Hessian has a negative eigenvalue, or where linked nodes coincide.
  bool escape_saddles = true;

  constexpr NewtonOptions() = default;
  constexpr NewtonOptions(const SolverOptions& options) : AlignedOptions(options) {}
  constexpr NewtonOptions(const AlignedOptions& options) : AlignedOptions(options) {}
};

/// The names of these options, for an OptionVisitor.
inline void visit_options(OptionVisitor& visit, NewtonOptions& options) {
  visit_options(visit, static_cast<AlignedOptions&>(options));
  visit("escape_saddles", options.escape_saddles);
}

/// Newton's method for small constellations: up to some 12 nodes if all are linked, and to 48 if links are
/// near their rest lengths at the start. For more nodes its cost, cubic in their number, exceeds that of the
/// methods with cheaper iterations.
///
/// Each iteration solves with the energy's Hessian, whose springs have curvature k_ij along their axis and
/// k_ij (1 - mu_ij / r_ij) across it. Up to the first four steps, as long as they promise to lose more than
/// half of the energy, clamp the latter at 0 (IDA's majoriser has k_ij in its place); later ones repair
/// negative pivots of L D L^T by their absolute value. Steps backtrack until the energy falls (Armijo); if
/// none lowers it, the step is along the gradient, to the minimum of IDA's majoriser, which always lowers it.
/// Close to a minimum the error squares from one iteration to the next; a step whose predicted gain, half of
/// Newton's decrement, is below the tolerance's share of the energy is taken as the last one, which the
/// stopping rule then confirms.
///
/// At a stationary point whose Hessian has negative curvature, it continues along that; at one where the ends
/// of a link that pushes them apart coincide, it separates them. So it leaves a line or plane that the start,
/// and all anchors, lie on.
/// Summary::positive_definite describes the Hessian at the x returned, or one such last step before it, if
/// the Hessian is too far from singular for the step to matter.
///
/// asterism::solver_compiled takes these steps for four linked nodes in the plane, in double, in vectors of
/// AVX-512 where the processor has them and no callback, gap or stop flag is set, and fills and factors the
/// matrix of more nodes in double in the widest vectors that the processor has. With these, results may
/// differ in their last digits.
///
/// An object holds its workspace: reuse it to solve without allocation, one thread at a time.
template <typename System>
class Newton {
 public:
  using Scalar = typename System::Scalar;
  using Point = typename System::Point;
  using Points = typename System::Points;

  NewtonOptions options;

  Newton() = default;
  /// For type deduction: Newton(system).solve(system, x).
  explicit Newton(const System&, const NewtonOptions& o = {}) : options(o) {}

  static constexpr std::string_view name() { return "Newton, repaired LDL^T"; }

  /// Moves x (Dim x N), the start, to a local minimum of the energy, or to another stationary point if the
  /// Hessian is singular or the options do not ask to escape saddles. Statuses other than Converged:
  /// MaxIterations, InvalidInput, NumericalFailure (overflow), OutOfMemory, and NoProgress if no step lowers
  /// the energy beyond its rounding.
  Summary solve(const System& given, Points& x) { return detail::Compiled::solve(*this, given, x); }

 private:
  friend detail::Compiled;

  Summary run(const System& given, Points& x);

  Status iterate(const System& system, Points& x, Summary& summary);

  static constexpr int kClampedSteps = 4;
  static constexpr Scalar kFlatShare = Scalar(1e-3);

  // The Hessian, clamped or not, into the matrix, energy and gradient at x.
  Scalar assemble(const System& system, const Points& x, Points& gradient, Summary& summary) {
    ++summary.energy_evaluations;
    ++summary.gradient_evaluations;
    return matrix_.assemble(system, x, clamps_, gradient);
  }

  // Takes x as the result.
  void adopt(const System& system, const Points& x) {
    if (matrix_.rounds_alike()) {
      session_.adopt(x, energy_, gradient_);
    } else {
      session_.evaluate(system, x);
    }
  }

  // What of `iterate` the compiled library has in vectors. False, with nothing changed, if it does not serve.
  bool iterate_compiled(const System& system, Points& x, Summary& summary, bool& converged) {
    if constexpr (detail::kHasFourNodes<System>) {
      if (session_.watches() || !detail::is_four_nodes(system)) return false;
      lanes_v0_1::FourNodesSearch at{detail::four_nodes(system, session_), options.max_iterations, realign_,
                                     x.data()};
      if (!lanes_v0_1::iterate_four_nodes(at)) return false;
      session_.evaluate(system, x);  // rounded as all other energies
      energy_ = session_.energy();
      gradient_ = session_.gradient();
      clamps_ = at.clamps;
      converged = at.converged && at.definite && session_.stationary(gradient_);
      if (converged) summary.positive_definite = true;
      summary.iterations = at.iterations;
      summary.energy_evaluations = summary.gradient_evaluations = at.evaluations;
      summary.factorizations = summary.linear_solves = at.factorizations;
      return true;
    }
    return false;
  }

  // The whole step, if the stopping rule is met after it.
  bool finish(const System& system, Points& x, Summary& summary) {
    detail::step_from(x, Scalar(-1), step_, next_x_);
    if (realign_) detail::align(system, next_x_, false);
    session_.evaluate(system, next_x_);
    ++summary.energy_evaluations;
    ++summary.gradient_evaluations;
    if (!(session_.energy() <= energy_ + detail::rounding_of_energy(system, x, energy_))) return false;
    if (!session_.stationary(session_.gradient())) return false;
    if (detail::peaked_link(system, next_x_) >= 0) return false;
    const bool may_turn = may_turn_indefinite((next_x_ - x).squaredNorm(), x);
    x = next_x_;
    ++summary.iterations;
    session_.report(x, session_.gradient(), summary.iterations);
    if (may_turn) {
      assemble(system, x, gradient_, summary);
      ++summary.factorizations;
      summary.positive_definite = matrix_.factorize();
    }
    return true;
  }

  // Whether a step of this squared length from x could make the Hessian indefinite, which it may do if the
  // Hessian was nearly singular before. Nodes may be much nearer to each other than an anchor is that is far
  // off.
  bool may_turn_indefinite(Scalar square, const Points& x) const {
    Point centroid = Point::Zero();
    for (Eigen::Index i = 0; i < x.cols(); ++i) centroid += x.col(i);
    centroid /= static_cast<Scalar>(x.cols());
    Scalar spread = 0;
    for (Eigen::Index i = 0; i < x.cols(); ++i) spread += (x.col(i) - centroid).squaredNorm();
    const Scalar length = session_.length(), flat = kFlatShare * matrix_.least_pivot();
    return square > flat * flat * std::min(length * length, spread / static_cast<Scalar>(x.cols()));
  }

  void accept(Points& x, Scalar energy, Summary& summary) {
    x.swap(next_x_);
    gradient_.swap(next_gradient_);
    energy_ = energy;
    ++summary.iterations;
  }

  // Backtracks along -step_ until the energy falls by a share of what its slope promises.
  bool search(const System& system, Points& x, Scalar decrement, Summary& summary) {
    constexpr int kMaxTrials = 12;
    constexpr Scalar kDecrease = Scalar(1e-4);
    if (!(decrement > 0 && detail::is_finite(decrement))) return false;
    const Scalar rounding = detail::rounding_of_energy(system, x, energy_);
    Scalar t = 1;
    for (int trial = 0; trial < kMaxTrials; ++trial) {
      detail::step_from(x, -t, step_, next_x_);
      if (realign_) detail::align(system, next_x_, false);
      const Scalar next = assemble(system, next_x_, next_gradient_, summary);
      bool falls = next <= energy_ - kDecrease * t * decrement && next < energy_;
      // In the last digits of the energy the gradient tells more.
      if (!falls && decrement <= 8 * rounding && next <= energy_ + rounding) {
        falls = next_gradient_.squaredNorm() < gradient_.squaredNorm() / 4;
      }
      if (falls) {
        accept(x, next, summary);
        return true;
      }
      // The minimum of the parabola through what is known.
      const Scalar vertex = t * t * decrement / (2 * (next - energy_ + t * decrement));
      t = vertex > t / 10 ? std::min(vertex, t / 2) : t / 10;  // also for energies that are not finite
    }
    return false;
  }

  // One more step where forces are below the tolerance but, for weak anchors, the energy is not.
  bool polish(const System& system, Points& x, Summary& summary) {
    const Scalar decrement = matrix_.solve(step_);
    ++summary.linear_solves;
    const Scalar scale = detail::energy_scale(system, x, energy_);
    if (!(decrement > 2 * session_.tolerance() * scale)) return false;
    if (!(scale > matrix_.energy_of_rounding(x))) return false;
    return search(system, x, decrement, summary);
  }

  // The gradient scaled by the nodes' stiffness, as far down as IDA's majoriser is sure of.
  bool majorise(const System& system, Points& x, Summary& summary) {
    detail::scaled_descent(session_.node_stiffness(), gradient_, step_);
    const Scalar slope = detail::dot(gradient_, step_);
    if (!(slope < 0)) return false;
    detail::step_from(x, detail::majorised_step(system, step_, slope), step_, next_x_);
    const Scalar next = assemble(system, next_x_, next_gradient_, summary);
    if (!(next < energy_)) return false;
    accept(x, next, summary);
    return true;
  }

  // Improves step_, a direction v of negative curvature, and returns its curvature. Each round minimises
  // v^T H v / v^T A v over the plane of v and the quotient's gradient; A has the nodes' stiffness. A pivot's
  // direction may bend stiff springs that its curvature hardly sees.
  [[gnu::cold]] Scalar bend_downwards(const System& system, const Points& x) {
    constexpr int kRounds = 20;
    const auto& A = session_.node_stiffness();
    hessian_.set(system, x);
    const auto normalise = [&A](Points& v) {
      Scalar square = 0;
      for (Eigen::Index i = 0; i < v.cols(); ++i) square += A[i] * v.col(i).squaredNorm();
      if (square > 0) v /= std::sqrt(square);
      return square > 0;
    };
    normalise(step_);
    next_gradient_.resize(System::kDim, x.cols());  // where the start is the saddle, no step has yet
    hessian_.apply(system, step_, next_x_);         // H v
    Scalar curvature = detail::dot(step_, next_x_);
    for (int round = 0; round < kRounds; ++round) {
      for (Eigen::Index i = 0; i < x.cols(); ++i) {
        for (int c = 0; c < System::kDim; ++c)
          next_gradient_(c, i) = A[i] > 0 ? next_x_(c, i) / A[i] - curvature * step_(c, i) : Scalar(0);
      }
      if (!(normalise(next_gradient_) > 0)) break;
      hessian_.apply(system, next_gradient_, next_x_);
      const Scalar mixed = detail::dot(step_, next_x_);
      const Scalar other = detail::dot(next_gradient_, next_x_);
      // The lower eigenvector of [curvature mixed; mixed other].
      const Scalar half = (other - curvature) / 2;
      const Scalar lower = curvature + half - std::sqrt(half * half + mixed * mixed);
      if (!(lower < curvature)) break;
      step_ = mixed * step_ + (lower - curvature) * next_gradient_;
      if (!(normalise(step_) > 0)) break;
      hessian_.apply(system, step_, next_x_);
      curvature = detail::dot(step_, next_x_);
    }
    return curvature;
  }

  // Writes a direction into step_ in which the energy falls to both sides, and returns its curvature; 0 if
  // there is none.
  Scalar descent_from_saddle(const System& system, const Points& x) {
    if (const Scalar curvature = detail::direction_off_peak(system, x, step_); curvature < 0)
      return curvature;
    if (matrix_.negative_curvature(step_) < 0) return bend_downwards(system, x);
    constexpr Scalar kRounding = 64 * std::numeric_limits<Scalar>::epsilon();
    Scalar curvature = 0;  // of the nodes' stiffness
    matrix_.any_flat_direction(step_, [&](const Points&) {
      curvature = bend_downwards(system, x);
      return curvature < -kRounding;
    });
    return curvature < -kRounding ? curvature : Scalar(0);
  }

  // From a saddle or peak down.
  [[gnu::cold]] bool escape(const System& system, Points& x, Summary& summary) {
    const Scalar curvature = descent_from_saddle(system, x);
    if (!(curvature < 0)) return false;
    const Scalar t =
        detail::step_off_saddle(session_, system, x, energy_, curvature, step_, next_x_, summary);
    if (t == 0) return false;
    detail::step_from(x, t, step_, next_x_);
    const Scalar next = assemble(system, next_x_, next_gradient_, summary);
    accept(x, next, summary);
    return true;
  }

  Session<System> session_;
  detail::FreeMotions<System> free_motions_;
  detail::NewtonMatrix<System> matrix_;
  detail::HessianOperator<System> hessian_;  // at saddles
  bool clamps_ = false;                      // the matrix at x is the clamped one
  bool realign_ = false;                     // after every step
  Scalar energy_ = 0;                        // at x, as gradient_
  Points gradient_;
  Points step_;
  Points next_x_;
  Points next_gradient_;
};

template <typename System>
Summary Newton<System>::run(const System& given, Points& x) {
  return session_.run(name(), options, given, x, [&](const System& system, Summary& summary) {
    const Status reason = iterate(system, x, summary);
    // The factors say so of x also by rounding, where a component or a part of one is free to move, and where
    // x is no minimum because a link that pushes its ends apart has them in one place.
    if (summary.positive_definite == true &&
        (detail::peaked_link(system, x) >= 0 || free_motions_.find(system, x)))
      summary.positive_definite = false;
    return reason;
  });
}

template <typename System>
Status Newton<System>::iterate(const System& system, Points& x, Summary& summary) {
  // Weak anchors leave a narrow valley, curved as the constellation turns, that straight steps have to
  // follow.
  realign_ = options.align && detail::has_weak_anchors(system);
  matrix_.reset(session_.node_stiffness());
  clamps_ = true;
  bool converged = false;
  bool is_assembled = !iterate_compiled(system, x, summary, converged);
  if (converged) return Status::Converged;
  if (is_assembled) energy_ = assemble(system, x, gradient_, summary);
  while (true) {
    session_.report(x, gradient_, summary.iterations);
    const bool stationary = session_.stationary(gradient_);
    const bool last = summary.iterations == options.max_iterations || session_.stopped();
    if (last && !stationary) {
      adopt(system, x);
      summary.positive_definite.reset();
      return Status::MaxIterations;
    }
    if (!is_assembled || (stationary && clamps_)) {
      clamps_ = clamps_ && !stationary;
      is_assembled = true;
      energy_ = assemble(system, x, gradient_, summary);
    }
    ++summary.factorizations;
    const bool definite = matrix_.factorize();
    summary.positive_definite = clamps_ ? std::nullopt : std::optional(definite);
    if (stationary) {
      const bool is_minimum = definite && detail::peaked_link(system, x) < 0;
      if (!last &&
          (is_minimum ? polish(system, x, summary) : options.escape_saddles && escape(system, x, summary)))
        continue;
      adopt(system, x);
      return Status::Converged;
    }
    const Scalar decrement = matrix_.solve(step_);  // step = H^-1 g, decrement = g^T H^-1 g
    ++summary.linear_solves;
    const Scalar scale = detail::energy_scale(system, x, energy_);
    if (definite && !clamps_ && decrement <= 2 * session_.tolerance() * scale && finish(system, x, summary)) {
      if (summary.positive_definite == true) return Status::Converged;
      is_assembled = false;  // the step led to a saddle
      continue;
    }
    // Far off: the step promises to lose more than half of the energy.
    clamps_ = decrement > scale && summary.iterations + 1 < kClampedSteps;
    if (!search(system, x, decrement, summary) && !majorise(system, x, summary)) return Status::NoProgress;
  }
}

ASTERISM_COMPILED_SOLVER(Newton)

}  // namespace ASTERISM_ABI
}  // namespace asterism
