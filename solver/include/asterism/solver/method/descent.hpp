#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/energy/tiled_springs.hpp>
#include <asterism/solver/run/session.hpp>
#include <asterism/solver/run/summary.hpp>
#include <limits>
#include <type_traits>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// v^T K_dyn v for all coordinates.
template <typename System>
typename System::Scalar stiffness_along(const System& system, const typename System::Points& v) {
  typename System::Scalar sum = 0;
  for (int i = 0; i < system.nodes(); ++i) sum += system.anchor_stiffness[i] * v.col(i).squaredNorm();
  int l = 0;
  for (const Link& link : system.links())
    sum += system.link_stiffness[l++] * (v.col(link.i) - v.col(link.j)).squaredNorm();
  return sum;
}

/// The minimiser along a direction of IDA's quadratic, which lies above the energy: the longest step that is
/// known to lower the energy without looking, whatever the direction of descent. `slope` is the gradient
/// times the direction, negative.
template <typename System>
typename System::Scalar majorised_step(const System& system, const typename System::Points& direction,
                                       typename System::Scalar slope) {
  return -slope / stiffness_along(system, direction);
}

/// The direction of descent -A^-1 g for the nodes' stiffness A; zero for nodes without.
template <typename NodeVector, typename Points>
void scaled_descent(const NodeVector& node_stiffness, const Points& gradient, Points& direction) {
  direction.resizeLike(gradient);
  for (Eigen::Index i = 0; i < gradient.cols(); ++i) {
    for (Eigen::Index c = 0; c < gradient.rows(); ++c)
      direction(c, i) = node_stiffness[i] > 0 ? -gradient(c, i) / node_stiffness[i] : 0;
  }
}

/// The iterate of a descent method, and its line search.
template <typename System>
class DescentState {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  /// Energy and gradient at the start x.
  void start(const System& system, const Points& x, Summary& summary) {
    if constexpr (kIsCompiled && kServes) {
      has_springs_ = system.nodes() >= kLeastNodes && system.nodes() <= kMostNodes && Springs::serve(system);
      if (has_springs_) springs_.set(system);
    }
    energy_ = lowest_ = move(system, x, x, 0, summary);
    gradient_.swap(other_gradient_);
  }

  Scalar energy() const { return energy_; }
  /// Whether energies and gradients are rounded as those of all methods.
  bool rounds_alike() const { return !has_springs_; }
  const Points& gradient() const { return gradient_; }
  const Points& previous_gradient() const { return other_gradient_; }
  Scalar slope() const { return slope_; }  ///< along the last direction, at the point that it led to

  /// Moves x by step * direction, with the first step of `step`, shorter ones by interpolation, and at last
  /// majorised_step that gives a sufficient decrease (Armijo, c1 = 1e-4; Nocedal & Wright, section 3.1).
  /// Where the rounding of the energy hides a decrease, the slopes at both ends tell it, as they would for a
  /// parabola (Hager & Zhang 2005), and the lowest energy so far is kept to within its rounding. `step`
  /// becomes the one taken. False, with x as it was, where rounding or overflow leave none.
  bool search(const System& system, Points& x, const Points& direction, Scalar slope, Scalar& step,
              Summary& summary) {
    constexpr Scalar kDecrease = Scalar(1e-4);
    constexpr Scalar kFlatter = Scalar(0.8);
    const Scalar rounding = rounding_of_energy(system, x, lowest_);
    Scalar sure = -1;
    while (true) {
      const Scalar energy = move(system, x, direction, step, summary);
      const bool lower = energy <= energy_ + kDecrease * step * slope;
      if (lower || (energy <= lowest_ + rounding && slope_ <= -kFlatter * slope)) {
        x.swap(other_x_);
        gradient_.swap(other_gradient_);
        energy_ = energy;
        lowest_ = std::min(lowest_, energy);
        return true;
      }
      if (sure < 0) {
        sure = majorised_step(system, direction, slope);
        if (!(sure > 0 && sure < step)) return false;
      } else if (!(step > sure)) {
        return false;
      }
      // Minimum of the parabola through the energies and the slope at the start.
      Scalar shorter = -slope * step * step / (2 * (energy - energy_ - slope * step));
      shorter = is_finite(shorter) ? std::clamp(shorter, step / 10, step / 2) : step / 10;
      step = std::max(shorter, sure);
    }
  }

 private:
  using Springs = TiledSprings<System>;
  struct Nothing {};
  // For which numbers of nodes the kernel pays.
  static constexpr int kLeastNodes = 6;
  static constexpr int kMostNodes = 400;
  static constexpr bool kServes =
      Springs::kServes && (System::kMaxNodes == Eigen::Dynamic ||
                           (System::kMaxNodes >= kLeastNodes && System::kMaxNodes <= kMostNodes));

  // Energy, gradient and slope at x + step * direction.
  Scalar move(const System& system, const Points& x, const Points& direction, Scalar step, Summary& summary) {
    ++summary.energy_evaluations, ++summary.gradient_evaluations;
    if constexpr (kIsCompiled && kServes) {
      Scalar energy = 0;
      if (has_springs_ &&
          springs_.differentiate(system, x, direction, step, other_x_, other_gradient_, energy, slope_)) {
        if (system.fixed_count() > 0) {
          clear_fixed(system, other_gradient_);
          slope_ = other_gradient_.cwiseProduct(direction).sum();
        }
        return energy;
      }
    }
    other_x_ = x + step * direction;
    const Scalar energy = energy_and_gradient(system, other_x_, other_gradient_);
    slope_ = other_gradient_.cwiseProduct(direction).sum();
    return energy;
  }

  std::conditional_t<kServes, Springs, Nothing> springs_;
  bool has_springs_ = false;
  Points gradient_;
  Points other_x_;
  Points other_gradient_;
  Scalar energy_ = 0;
  Scalar lowest_ = 0;
  Scalar slope_ = 0;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
