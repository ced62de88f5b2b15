#pragma once

#include <algorithm>
#include <asterism/solver/config.hpp>
#include <asterism/solver/session.hpp>
#include <asterism/solver/summary.hpp>
#include <cmath>
#include <limits>
#include <string_view>
#include <utility>

namespace asterism::inline ASTERISM_ABI {

namespace detail {

/// A point on a search ray: step length, energy and slope along the ray.
template <typename Scalar>
struct RayPoint {
  Scalar step = 0;
  Scalar energy = 0;
  Scalar slope = 0;
};

/// A step that meets the strong Wolfe conditions, by bracketing and zoom (Nocedal & Wright, Numerical
/// Optimization, algorithms 3.5 and 3.6, with c1 = 1e-4 and c2 = 0.1). `evaluate(step)` returns the RayPoint
/// at a step; the last one evaluated is the one accepted. Energies that differ by no more than `rounding`
/// count as equal (cf. Hager & Zhang 2005), or the search would fail on the last digits of a minimum.
template <typename Scalar, typename Evaluate>
bool strong_wolfe(const RayPoint<Scalar>& start, Scalar first_step, Scalar rounding, Evaluate&& evaluate) {
  using Point = RayPoint<Scalar>;
  constexpr Scalar kDecrease = Scalar(1e-4);
  constexpr Scalar kCurvature = Scalar(0.1);
  constexpr int kMaxTrials = 40;

  const auto too_high = [&](const Point& p) {  // also for energies that overflow to infinity or NaN
    return !(p.energy <= start.energy + kDecrease * p.step * start.slope + rounding);
  };
  const auto flat = [&](const Point& p) { return std::abs(p.slope) <= -kCurvature * start.slope; };

  // Nocedal & Wright 3.5: lengthen the step until an acceptable one lies between two points.
  Point low = start;
  Point high;
  int trial = 0;
  for (Point current{first_step, 0, 0};; ++trial) {
    if (trial == kMaxTrials || !std::isfinite(current.step)) return false;
    current = evaluate(current.step);
    if (too_high(current) || (trial > 0 && current.energy > low.energy + rounding)) {
      high = current;
      break;
    }
    if (flat(current)) return true;
    if (current.slope >= 0) {
      high = std::exchange(low, current);
      break;
    }
    // Where the slope would vanish if it went on changing at this rate.
    const Scalar width = current.step - low.step;
    const Scalar secant = width * current.slope / (low.slope - current.slope);
    low = std::exchange(
        current, Point{current.step + std::clamp(secant > 0 ? secant : 9 * width, width / 10, 9 * width)});
  }

  // 3.6: shrink the bracket; `low` is its end of lower energy and its slope points into the bracket.
  for (; trial < kMaxTrials; ++trial) {
    const Scalar width = high.step - low.step;
    // Minimum of the parabola through low's energy and slope and high's energy, kept off the ends.
    const Scalar bend = high.energy - low.energy - low.slope * width;
    Scalar fraction = -low.slope * width / (2 * bend);
    if (high.energy <= low.energy + rounding)
      fraction = low.slope / (low.slope - high.slope);  // secant of the slopes
    fraction = std::isfinite(fraction) ? std::clamp(fraction, Scalar(0.1), Scalar(0.9)) : Scalar(0.5);
    const Point current = evaluate(low.step + fraction * width);
    if (too_high(current) || current.energy > low.energy + rounding) {
      high = current;
    } else {
      if (flat(current)) return true;
      if (current.slope * width >= 0) high = low;
      low = current;
    }
  }
  return false;
}

}  // namespace detail

/// Nonlinear conjugate gradients, Polak-Ribiere+ with a strong Wolfe line search, restarted along the
/// steepest descent where a direction or its line search fails. The general-purpose method that the paper
/// compares IDA with (Nocedal & Wright, section 5.2). Evaluates energy and gradient together, more than once
/// an iteration.
///
/// Keeps its workspace: reuse an object to solve without allocation, one thread at a time.
template <typename System>
class NonlinearCg {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  SolverOptions options;

  NonlinearCg() = default;
  /// For type deduction: NonlinearCg(system).solve(system, x).
  explicit NonlinearCg(const System&, const SolverOptions& o = {}) : options(o) {}

  static constexpr std::string_view name() { return "nonlinear CG, Polak-Ribiere+"; }

  /// Moves x (Dim x N), the start, to a stationary point of the energy. Statuses other than Converged:
  /// MaxIterations, InvalidInput, NumericalFailure (overflow), OutOfMemory, and NoProgress where no step
  /// along the steepest descent lowers the energy beyond its rounding.
  Summary solve(const System& system, Points& x) {
    return session_.run(name(), options, system, x, [&](Summary& summary) {
      const auto count = [&summary] { ++summary.energy_evaluations, ++summary.gradient_evaluations; };
      detail::RayPoint<Scalar> start;
      start.energy = energy_and_gradient(system, x, gradient_);
      count();
      bool restart = true;
      Scalar step = 0;
      Scalar next_energy = 0;
      while (true) {
        if (session_.done(gradient_)) return Status::Converged;
        if (summary.iterations == options.max_iterations) return Status::MaxIterations;

        const Scalar previous_slope = start.slope;
        start.slope = restart ? Scalar(0) : gradient_.cwiseProduct(direction_).sum();
        if (!(start.slope < 0)) {
          restart = true;
          direction_ = -gradient_;
          start.slope = -gradient_.squaredNorm();
          step = majorised_step(system, start.slope);
        } else {
          step *= previous_slope / start.slope;  // the same first-order decrease as before
        }

        const bool found = detail::strong_wolfe(
            start, step, detail::rounding_of_energy(system, start.energy), [&](Scalar trial) {
              step = trial;
              next_x_ = x + trial * direction_;
              next_energy = energy_and_gradient(system, next_x_, next_gradient_);
              count();
              return detail::RayPoint<Scalar>{trial, next_energy,
                                              next_gradient_.cwiseProduct(direction_).sum()};
            });
        if (!found) {
          if (restart) return Status::NoProgress;
          restart = true;
          continue;
        }
        restart = false;

        // beta = max(0, g_new . (g_new - g) / g . g)
        const Scalar beta =
            std::max(Scalar(0),
                     next_gradient_.cwiseProduct(next_gradient_ - gradient_).sum() / gradient_.squaredNorm());
        direction_ = beta * direction_ - next_gradient_;
        x.swap(next_x_);
        gradient_.swap(next_gradient_);
        start.energy = next_energy;
        ++summary.iterations;
      }
    });
  }

 private:
  // The minimum along direction_ of IDA's quadratic above the energy: lowers the energy for certain, and has
  // the right scale whatever the units.
  Scalar majorised_step(const System& system, Scalar slope) const {
    Scalar curvature = 0;
    for (int i = 0; i < system.nodes(); ++i) {
      curvature += system.anchor_stiffness[i] * direction_.col(i).squaredNorm();
    }
    int l = 0;
    for (const Link& link : system.links()) {
      curvature +=
          system.link_stiffness[l++] * (direction_.col(link.i) - direction_.col(link.j)).squaredNorm();
    }
    return -slope / curvature;
  }

  detail::Session<System> session_;
  Points gradient_;
  Points direction_;
  Points next_x_;
  Points next_gradient_;
};

}  // namespace asterism::inline ASTERISM_ABI
