#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/spring_element.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/method/descent.hpp>
#include <asterism/solver/method/policy_name.hpp>
#include <asterism/solver/run/compiled.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/session.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <cmath>
#include <limits>
#include <string_view>
#include <utility>

namespace asterism {
inline namespace ASTERISM_ABI {

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
    if (trial == kMaxTrials || !detail::is_finite(current.step)) return false;
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
    fraction = detail::is_finite(fraction) ? std::clamp(fraction, Scalar(0.1), Scalar(0.9)) : Scalar(0.5);
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

/// Central or forward differences of the energy, of step h = max(|x_c|, L) times the root of the scalar's
/// epsilon that balances their error and the energy's rounding; L is the characteristic length.
template <typename System, bool kCentral>
class DifferencedEnergy {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  static constexpr bool kNumeric = true;

  void start(Scalar length) {
    constexpr Scalar kEpsilon = std::numeric_limits<Scalar>::epsilon();
    typical_ = length;
    relative_step_ = kCentral ? std::cbrt(kEpsilon) : std::sqrt(kEpsilon);
  }

  /// Energy at x, with its gradient (Dim x N); counts its evaluations in the summary.
  Scalar operator()(const System& system, const Points& x, Points& gradient, Summary& summary) {
    const Scalar here = energy(system, x);
    summary.energy_evaluations += 1 + static_cast<int>(kCentral ? 2 * x.size() : x.size());
    gradient.resize(x.rows(), x.cols());
    moved_ = x;
    for (Eigen::Index c = 0; c < x.size(); ++c) {
      Scalar& coordinate = moved_.data()[c];
      const Scalar at = coordinate;
      const Scalar step = relative_step_ * std::max(std::abs(at), typical_);
      const Scalar above = coordinate = at + step;
      const Scalar energy_above = energy(system, moved_);
      Scalar below = at;
      Scalar energy_below = here;
      if constexpr (kCentral) {
        below = coordinate = at - step;
        energy_below = energy(system, moved_);
      }
      gradient.data()[c] = (energy_above - energy_below) / (above - below);
      coordinate = at;
    }
    clear_fixed(system, gradient);
    return here;
  }

 private:
  Points moved_;
  Scalar typical_ = 1;
  Scalar relative_step_ = 0;
};

}  // namespace detail

/// Gradient of NonlinearCg: the exact one.
template <typename System>
class AnalyticGradient {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  static constexpr std::string_view kName = "analytic gradient";
  /// Whether the gradient is approximated by differences of energies.
  static constexpr bool kNumeric = false;

  /// Called once before a solve, with the system's characteristic length.
  void start(Scalar) {}

  /// Energy at x, with its gradient (Dim x N); counts its evaluations in the summary.
  Scalar operator()(const System& system, const Points& x, Points& gradient, Summary& summary) {
    ++summary.energy_evaluations, ++summary.gradient_evaluations;
    return energy_and_gradient(system, x, gradient);
  }
};

/// Gradient of NonlinearCg: forward differences, Dim N more energies for each gradient, as in optimisers that
/// only know the energy. Accurate to half of the scalar's digits, so tolerances below about 1e-7 in double
/// may end at NoProgress.
template <typename System>
class ForwardDifferences : public detail::DifferencedEnergy<System, false> {
 public:
  static constexpr std::string_view kName = "forward differences";
};

/// Gradient of NonlinearCg: central differences, 2 Dim N more energies for each gradient; accurate to two
/// thirds of the scalar's digits.
template <typename System>
class CentralDifferences : public detail::DifferencedEnergy<System, true> {
 public:
  static constexpr std::string_view kName = "central differences";
};

/// Nonlinear conjugate gradients, Polak-Ribiere+ with a strong Wolfe line search, restarted along the
/// steepest descent where a direction or its line search fails. The general-purpose method that the paper
/// compares IDA with (Nocedal & Wright, section 5.2). Evaluates energy and gradient together, more than once
/// an iteration.
///
/// `Gradient` is AnalyticGradient (default), ForwardDifferences or CentralDifferences. Each energy that a
/// difference needs is counted as an energy evaluation; no gradient evaluation is counted. The method itself
/// uses only its differences. The stopping rule uses the analytic gradient, as for every solver, and that is
/// not counted.
///
/// Keeps its workspace: reuse an object to solve without allocation, one thread at a time.
template <typename System, typename Gradient = AnalyticGradient<System>>
class NonlinearCg {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  SolverOptions options;

  NonlinearCg() = default;
  /// For type deduction: NonlinearCg(system).solve(system, x).
  explicit NonlinearCg(const System&, const SolverOptions& o = {}) : options(o) {}

  static constexpr std::string_view name() { return detail::NameWithPolicy<kMethod, Gradient>::value; }

  /// Moves x (Dim x N), the start, to a stationary point of the energy. Statuses other than Converged:
  /// MaxIterations, InvalidInput, NumericalFailure (overflow), OutOfMemory, and NoProgress if no step
  /// along the steepest descent lowers the energy beyond its rounding.
  Summary solve(const System& given, Points& x) { return detail::Compiled::solve(*this, given, x); }

 private:
  friend detail::Compiled;

  Summary run(const System& given, Points& x);

  static constexpr std::string_view kMethod = "nonlinear CG";

  // At x, where gradient_ is what the method sees.
  const Points& analytic_gradient(const System& system, const Points& x) {
    if constexpr (Gradient::kNumeric) {
      detail::evaluate<false>(system, x, analytic_gradient_);
      return analytic_gradient_;
    } else {
      return gradient_;
    }
  }

  Session<System> session_;
  Points gradient_;
  Points direction_;
  Points next_x_;
  Points next_gradient_;
  Points analytic_gradient_;  // of numeric ones
  Gradient evaluate_;
};

template <typename System, typename Gradient>
Summary NonlinearCg<System, Gradient>::run(const System& given, Points& x) {
  return session_.run(name(), options, given, x, [&](const System& system, Summary& summary) {
    detail::RayPoint<Scalar> start;
    evaluate_.start(session_.length());
    start.energy = evaluate_(system, x, gradient_, summary);
    bool restart = true;
    Scalar step = 0;
    Scalar next_energy = 0;
    while (true) {
      const Points& analytic = analytic_gradient(system, x);
      if (session_.done(x, analytic, summary.iterations)) return Status::Converged;
      if (summary.iterations == options.max_iterations) return Status::MaxIterations;
      if (!restart && session_.stalls(x, analytic, summary.iterations)) return Status::NoProgress;

      const Scalar previous_slope = start.slope;
      start.slope = restart ? Scalar(0) : gradient_.cwiseProduct(direction_).sum();
      if (!(start.slope < 0)) {
        restart = true;
        direction_ = -gradient_;
        start.slope = -gradient_.squaredNorm();
        step = detail::majorised_step(system, direction_, start.slope);
      } else {
        step *= previous_slope / start.slope;  // the same first-order decrease as before
      }

      const bool found = detail::strong_wolfe(
          start, step, detail::rounding_of_energy(system, x, start.energy), [&](Scalar trial) {
            step = trial;
            next_x_ = x + trial * direction_;
            next_energy = evaluate_(system, next_x_, next_gradient_, summary);
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
      const Scalar beta = std::max(
          Scalar(0), next_gradient_.cwiseProduct(next_gradient_ - gradient_).sum() / gradient_.squaredNorm());
      direction_ = beta * direction_ - next_gradient_;
      x.swap(next_x_);
      gradient_.swap(next_gradient_);
      start.energy = next_energy;
      ++summary.iterations;
    }
  });
}

ASTERISM_COMPILED_SOLVER(NonlinearCg)

}  // namespace ASTERISM_ABI
}  // namespace asterism
