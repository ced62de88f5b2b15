#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <cmath>
#include <concepts>
#include <limits>

namespace asterism {
inline namespace ASTERISM_ABI {

/// A function's value and its first and second derivative.
template <typename Scalar>
struct Derivatives {
  Scalar value;   ///< of the function
  Scalar first;   ///< derivative
  Scalar second;  ///< derivative
};

/// The energy of a link of unit stiffness as a function phi of its length r >= 0 (that of x_i - x_j - m_ij if
/// the link has an offset) and its rest length mu; the
/// link's energy is k_ij phi(r, mu). phi >= 0, its curvatures along and across the link are at most those of
/// a spring, phi'' <= 1 and phi' / r <= 1, so that k_ij bounds the link's curvature from above. The author of
/// a potential has to ensure both; check_link_potential tests them, and this bound, on which IDA relies:
/// phi(|d|) <= phi(|e|) + phi'(|e|) e . (d - e) / |e| + |d - e|^2 / 2 for all points d and e != 0.
///
/// It may have parameters, the same for all links. It then has a function `problem()`, which says what is
/// wrong with them, or returns nullptr.
///
/// A potential that is convex as a function of r^2, phi(s) >= phi(r) + phi'(r) / (2 r) (s^2 - r^2) for all r
/// and s, may declare `static constexpr bool kConvexInSquare = true`. Its systems can then be certified.
template <typename P>
concept LinkPotential = std::default_initializable<P> && requires(const P potential, double r, float s) {
  { potential(r, r) } -> std::same_as<Derivatives<double>>;
  { potential(s, s) } -> std::same_as<Derivatives<float>>;
};

/// The loss rho of an anchor's squared distance s = |x_i - a_i|^2; the anchor's energy is 1/2 k_i rho(s), as
/// in Ceres's LossFunction. rho(0) = 0, rho is concave and 0 <= rho' <= 1: then the weighted spring
/// 1/2 k_i rho'(s) |x - a|^2 lies above it (up to a constant) and k_i bounds its curvature.
///
/// It may have parameters, the same for all anchors, and `problem()`, like a LinkPotential.
template <typename L>
concept AnchorLoss = std::default_initializable<L> && requires(const L loss, double s, float t) {
  { loss(s) } -> std::same_as<Derivatives<double>>;
  { loss(t) } -> std::same_as<Derivatives<float>>;
};

/// The paper's link: a spring, phi = 1/2 (r - mu)^2.
struct Hooke {
  /// (s - mu)^2 / 2 is above (r - mu)^2 / 2 + (1 - mu / r) (s^2 - r^2) / 2 by mu (s - r)^2 / (2 r).
  static constexpr bool kConvexInSquare = true;

  /// phi at length r and rest length mu, and its derivatives by r.
  template <typename Scalar>
  constexpr Derivatives<Scalar> operator()(Scalar r, Scalar mu) const {
    const Scalar stretch = r - mu;
    return {stretch * stretch / 2, stretch, 1};
  }
};

/// A rope: a spring that pulls where it is longer than mu and does nothing where it is slack.
struct Rope {
  /// As Hooke's where it pulls, and 0 elsewhere.
  static constexpr bool kConvexInSquare = true;

  /// phi at length r and rest length mu, and its derivatives by r.
  template <typename Scalar>
  constexpr Derivatives<Scalar> operator()(Scalar r, Scalar mu) const {
    if (r <= mu) return {0, 0, 0};
    return Hooke()(r, mu);
  }
};

/// A spring that pushes its ends apart where they are nearer than mu and does nothing beyond: parts that may
/// not overlap.
struct Repulsion {
  /// As Hooke's where it pushes, and 0 elsewhere.
  static constexpr bool kConvexInSquare = true;

  /// phi at length r and rest length mu, and its derivatives by r.
  template <typename Scalar>
  constexpr Derivatives<Scalar> operator()(Scalar r, Scalar mu) const {
    if (r >= mu) return {0, 0, 0};
    return Hooke()(r, mu);
  }
};

/// The paper's anchor: a spring, rho = s.
struct Quadratic {
  /// rho at s = |x_i - a_i|^2, and its derivatives by s.
  template <typename Scalar>
  constexpr Derivatives<Scalar> operator()(Scalar s) const {
    return {s, 1, 0};
  }
};

namespace detail {

constexpr const char* scale_problem(double scale) {
  return scale > 0 && is_finite(scale) ? nullptr : "is not a positive, finite scale";
}

}  // namespace detail

/// A spring up to `scale`, a constant force beyond: an anchor pulls no harder than k_i scale (Huber 1964).
/// The energy stays convex in the distance.
struct Huber {
  double scale = 1;  ///< [px]

  /// rho at s = |x_i - a_i|^2, and its derivatives by s.
  template <typename Scalar>
  Derivatives<Scalar> operator()(Scalar s) const {
    const auto c = static_cast<Scalar>(scale);
    if (s <= c * c) return {s, 1, 0};
    const Scalar r = std::sqrt(s);
    const Scalar weight = c / r;
    return {2 * c * r - c * c, weight, -weight / (2 * s)};
  }

  constexpr const char* problem() const { return detail::scale_problem(scale); }
};

/// A spring near the anchor whose force vanishes far beyond `scale`: rho = s / (1 + s / scale^2) (Geman &
/// McClure 1987). An anchor's energy is at most 1/2 k_i scale^2.
struct GemanMcClure {
  double scale = 1;  ///< [px]

  /// rho at s = |x_i - a_i|^2, and its derivatives by s.
  template <typename Scalar>
  Derivatives<Scalar> operator()(Scalar s) const {
    const auto square = static_cast<Scalar>(scale * scale);
    const Scalar share = 1 / (1 + s / square);
    return {s * share, share * share, -2 * share * share * share / square};
  }

  constexpr const char* problem() const { return detail::scale_problem(scale); }
};

/// A spring near the anchor and a constant beyond about `scale`: least squares that are truncated at `scale`,
/// rho = min(s, scale^2), with the corner rounded off between 1 - 1 / (sharpness + 1) and 1 + 1 / sharpness
/// times scale^2 (Yang et al., Graduated non-convexity for robust spatial perception, 2020, Eq. 14). The more
/// sharpness, the more minima.
struct Truncated {
  double scale = 1;      ///< [px]
  double sharpness = 4;  ///< > 0

  /// rho at s = |x_i - a_i|^2, and its derivatives by s.
  template <typename Scalar>
  Derivatives<Scalar> operator()(Scalar s) const {
    const auto square = static_cast<Scalar>(scale * scale), mu = static_cast<Scalar>(sharpness);
    if (s <= mu / (mu + 1) * square) return {s, 1, 0};
    if (s >= (mu + 1) / mu * square) return {square, 0, 0};
    const Scalar root = std::sqrt(square * mu * (mu + 1) / s);
    return {2 * root * s - mu * (square + s), root - mu, -root / (2 * s)};
  }

  constexpr const char* problem() const {
    if (!(sharpness > 0 && detail::is_finite(sharpness)))
      return "has a sharpness that is not positive and finite";
    return detail::scale_problem(scale);
  }
};

/// A spring whose stretch counts by a robust loss, phi = 1/2 rho((r - mu)^2): a link that may be an outlier,
/// such as a distance that was measured wrongly.
template <AnchorLoss Loss>
struct RobustHooke {
  [[no_unique_address]] Loss loss;  ///< rho, of a link's (r - mu)^2

  /// phi at length r and rest length mu, and its derivatives by r.
  template <typename Scalar>
  Derivatives<Scalar> operator()(Scalar r, Scalar mu) const {
    const Scalar stretch = r - mu, square = stretch * stretch;
    const Derivatives<Scalar> rho = loss(square);
    return {rho.value / 2, rho.first * stretch, rho.first + 2 * square * rho.second};
  }

  constexpr const char* problem() const {
    if constexpr (requires { loss.problem(); }) return loss.problem();
    return nullptr;
  }
};

/// Whether an anchor pulls equally hard in all directions.
enum class AnchorShape { Isotropic, Anisotropic };

/// The kind of links and anchors of a SpringSystem: how a link's energy depends on its length and an anchor's
/// on its distance, and whether an anchor has an information matrix instead of a stiffness. A System
/// (terms/system.hpp) has more kinds, mixed at will, and parameters for each link and anchor.
template <LinkPotential Link = Hooke, AnchorLoss Loss = Quadratic,
          AnchorShape kShape = AnchorShape::Isotropic>
struct Model {
  using LinkPotential = Link;                          ///< phi of every link
  using AnchorLoss = Loss;                             ///< rho of every anchor
  static constexpr AnchorShape kAnchorShape = kShape;  ///< isotropic or with information matrices
};

/// The paper's model: all links and anchors are springs.
using Springs = Model<>;

}  // namespace ASTERISM_ABI
}  // namespace asterism
