#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/problem/model.hpp>
#include <asterism/testing/random_system.hpp>
#include <cmath>

namespace asterism {
inline namespace ASTERISM_ABI {

/// A rule that a LinkPotential or AnchorLoss breaks, and where; `problem` is a null pointer if it breaks
/// none.
struct ModelViolation {
  const char* problem = nullptr;  ///< the rule that is broken
  double at = 0;                  ///< the length r, or the squared distance s
  double rest_length = 0;         ///< of links

  /// Whether a rule is broken.
  explicit operator bool() const { return problem != nullptr; }
};

namespace detail {

/// Whether a and b differ by less than `share` of their size and scale.
inline bool close_to(double a, double b, double share, double scale) {
  return std::abs(a - b) <= share * (std::max(std::abs(a), std::abs(b)) + scale);
}

// Compares derivatives with central differences; at a kink, the one-sided derivatives must enclose those.
template <typename Function>
bool derivatives_agree(const Function& f, double at, double step) {
  const auto here = f(at), below = f(at - step), above = f(at + step);
  const double slope = (above.value - below.value) / (2 * step);
  const double low = std::min({below.first, here.first, above.first});
  const double high = std::max({below.first, here.first, above.first});
  const double slack = 1e-6 * (std::abs(slope) + std::abs(here.first) + step);
  if (!(low - slack <= slope && slope <= high + slack)) return false;
  const double bend = (above.first - below.first) / (2 * step);
  const double least = std::min({below.second, here.second, above.second});
  const double most = std::max({below.second, here.second, above.second});
  const double bend_slack = 1e-6 * (std::abs(bend) + std::abs(here.second)) + 1e-9;
  return least - bend_slack <= bend && bend <= most + bend_slack;
}

}  // namespace detail

/// Checks that `potential` meets the conditions that solvers rely on (see LinkPotential), at lengths and rest
/// lengths of 1/100 to 100 times `scale` and at zero: finite, not negative, with correct derivatives, with
/// curvatures of at most a spring's, and below IDA's quadratic. For the tests of a potential of your own.
template <LinkPotential P>
ModelViolation check_link_potential(const P& potential, double scale = 1) {
  constexpr int kSteps = 60;
  const auto length = [&](int i) { return scale * std::pow(10.0, -2 + 4.0 * i / (kSteps - 1)); };
  for (int m = -1; m < kSteps; m += 3) {
    const double mu = m < 0 ? 0 : length(m);
    const auto phi = [&](double r) { return potential(r, mu); };
    for (int i = -1; i < kSteps; ++i) {
      const double r = i < 0 ? 0 : length(i);
      const auto here = phi(r);
      if (!(detail::is_finite(here.value) && detail::is_finite(here.first) && detail::is_finite(here.second)))
        return {"is not finite", r, mu};
      if (!(here.value >= 0)) return {"is negative", r, mu};
      constexpr double kRounding = 1e-9;
      if (!(here.second <= 1 + kRounding)) return {"has more curvature along than a spring", r, mu};
      if (!(here.first <= r * (1 + kRounding))) return {"has more curvature across than a spring", r, mu};
      if (r > 0 && !detail::derivatives_agree(phi, r, 1e-4 * r))
        return {"has derivatives that are not those of its value", r, mu};
      // The quadratic at e = (r, 0) against points d around.
      for (int j = 0; j < kSteps; j += 4) {
        for (int angle = 0; angle < 8; ++angle) {
          const double turn = 0.3 + 0.785 * angle;
          const Eigen::Vector2d d(length(j) * std::cos(turn), length(j) * std::sin(turn));
          const Eigen::Vector2d e(r, 0);
          const double above = here.value + here.first * (d.x() - r) + (d - e).squaredNorm() / 2;
          const double value = phi(d.norm()).value;
          if (!(value <= above + kRounding * (std::abs(above) + value + here.value)))
            return {"is above IDA's quadratic", r, mu};
        }
      }
    }
  }
  return {};
}

/// The same for the loss of an anchor (see AnchorLoss), at distances of 1/100 to 100 times `scale` and at
/// zero.
template <AnchorLoss L>
ModelViolation check_anchor_loss(const L& loss, double scale = 1) {
  constexpr int kSteps = 200;
  const auto rho = [&](double s) { return loss(s); };
  const auto at_zero = rho(0.0);
  if (!(at_zero.value == 0)) return {"is not zero at zero", 0, 0};
  for (int i = -1; i < kSteps; ++i) {
    const double s = i < 0 ? 0 : scale * scale * std::pow(10.0, -4 + 8.0 * i / (kSteps - 1));
    const auto here = rho(s);
    constexpr double kRounding = 1e-9;
    if (!(detail::is_finite(here.value) && detail::is_finite(here.first) && detail::is_finite(here.second)))
      return {"is not finite", s, 0};
    if (!(here.first >= 0 && here.first <= 1 + kRounding))
      return {"has a slope that is not from 0 to 1", s, 0};
    if (!(here.second <= kRounding / (scale * scale))) return {"is not concave", s, 0};
    if (s > 0 && !detail::derivatives_agree(rho, s, 1e-4 * s))
      return {"has derivatives that are not those of its value", s, 0};
  }
  return {};
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
