#pragma once

#include <Eigen/Core>
#include <asterism/solver/detail/config.hpp>
#include <cmath>
#include <concepts>
#include <limits>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Three nodes to which a TriplePotential applies, j being the middle one.
struct Triple {
  int i = -1;  ///< a node
  int j = -1;  ///< the middle one
  int k = -1;  ///< a third one
  /// >= 0, in the units that the potential says; NaN until it is set.
  double stiffness = std::numeric_limits<double>::quiet_NaN();
  double rest = 0;  ///< what the potential prefers, in its units
};

/// A function of three points, and its gradient by each.
template <typename Point>
struct TripleForce {
  typename Point::Scalar value;  ///< of the function
  Point by_i;                    ///< gradient by the first point
  Point by_j;                    ///< by the middle point
  Point by_k;                    ///< by the last point
};

/// The energy of unit stiffness of three nodes, as a function of their positions and of what they prefer:
/// potential(x_i, x_j, x_k, rest) returns a TripleForce, in the plane, in space or in both. It is not
/// negative, and the same wherever the three are moved or turned as one body. check_triple_potential tests
/// this.
///
/// There is no bound on its curvature. Only methods that look for lower energy along a line by its gradient
/// can solve systems that have one: Lbfgs (and so Auto) and NonlinearCg; all others refuse them.
template <typename P>
concept TriplePotential = std::default_initializable<P> &&(
    requires(const P p, const Eigen::Vector2d v) {
      { p(v, v, v, 0.0) } -> std::same_as<TripleForce<Eigen::Vector2d>>;
    } ||
    requires(const P p, const Eigen::Vector3d v) {
      { p(v, v, v, 0.0) } -> std::same_as<TripleForce<Eigen::Vector3d>>;
    });

/// A spring of the second difference d = x_i - 2 x_j + x_k: 1/2 (|d| - rest)^2, with rest >= 0 [px]. With
/// rest 0 it straightens a chain evenly (a beam, a snake; Kass, Witkin & Terzopoulos 1988) and is quadratic.
/// Stiffness as that of links.
struct Bending {
  /// Of the second difference of the three places.
  template <typename Point, typename Scalar = typename Point::Scalar>
  TripleForce<Point> operator()(const Point& i, const Point& j, const Point& k, Scalar rest) const {
    const Point d = i - 2 * j + k;
    const Scalar length = d.norm(), stretch = length - rest;
    const Point pull = length > 0 ? Point((stretch / length) * d) : Point(Point::Zero());
    return {stretch * stretch / 2, pull, -2 * pull, pull};
  }
};

/// A spring of the angle at x_j between x_i and x_k: 1/2 (angle - rest)^2 [rad^2], angles from 0 to pi.
/// Stiffness in energy per rad^2. Where an angle is 0 or pi, or a side has no length, there is no direction
/// to turn to, and the gradient is 0: do not start on a straight line if rest is another angle.
struct Angle {
  /// Of the angle at the middle one.
  template <typename Point, typename Scalar = typename Point::Scalar>
  TripleForce<Point> operator()(const Point& i, const Point& j, const Point& k, Scalar rest) const {
    const Point a = i - j, b = k - j;
    const Scalar aa = a.squaredNorm(), bb = b.squaredNorm(), dot = a.dot(b);
    // What a has across b, and b across a, whose lengths are those of the cross product by |b| and |a|.
    const Point across_a = b - (dot / aa) * a, across_b = a - (dot / bb) * b;
    const Scalar cross = std::sqrt(aa) * across_a.norm();
    const Scalar off = std::atan2(cross, dot) - rest;
    TripleForce<Point> result{off * off / 2, Point::Zero(), Point::Zero(), Point::Zero()};
    if (!(aa > 0 && bb > 0)) {
      result.value = rest * rest / 2;
    } else if (cross > 0) {
      result.by_i = (-off / cross) * across_a;
      result.by_k = (-off / cross) * across_b;
      result.by_j = -(result.by_i + result.by_k);
    }
    return result;
  }
};

/// A spring of the area of the triangle: 1/2 (area - rest)^2 [px^4]. In the plane the area has a sign,
/// positive where i, j, k turn from the x axis to the y axis, so that a triangle does not turn over.
/// Stiffness in energy per px^4.
struct Area {
  /// In the plane, with a sign; in space, without one.
  template <typename Scalar, int Dim>
  requires(Dim == 2 || Dim == 3) TripleForce<Eigen::Matrix<Scalar, Dim, 1>>
  operator()(const Eigen::Matrix<Scalar, Dim, 1>& i, const Eigen::Matrix<Scalar, Dim, 1>& j,
             const Eigen::Matrix<Scalar, Dim, 1>& k, Scalar rest) const {
    if constexpr (Dim == 2) {
      return of_plane(i, j, k, rest);
    } else {
      return of_space(i, j, k, rest);
    }
  }

 private:
  template <typename Point, typename Scalar = typename Point::Scalar>
  static TripleForce<Point> of_plane(const Point& i, const Point& j, const Point& k, Scalar rest) {
    const Point a = j - i, b = k - i;
    const Scalar off = (a.x() * b.y() - a.y() * b.x()) / 2 - rest;
    const Point by_j = off / 2 * Point(b.y(), -b.x()), by_k = off / 2 * Point(-a.y(), a.x());
    return {off * off / 2, -(by_j + by_k), by_j, by_k};
  }
  template <typename Point>
  static Point cross(const Point& a, const Point& b) {
    return {a.y() * b.z() - a.z() * b.y(), a.z() * b.x() - a.x() * b.z(), a.x() * b.y() - a.y() * b.x()};
  }
  template <typename Point, typename Scalar = typename Point::Scalar>
  static TripleForce<Point> of_space(const Point& i, const Point& j, const Point& k, Scalar rest) {
    const Point a = j - i, b = k - i, normal = cross(a, b);
    const Scalar twice = normal.norm(), off = twice / 2 - rest;
    if (!(twice > 0)) return {off * off / 2, Point::Zero(), Point::Zero(), Point::Zero()};
    const Point n = normal / twice, by_j = off / 2 * cross(b, n), by_k = off / 2 * cross(n, a);
    return {off * off / 2, -(by_j + by_k), by_j, by_k};
  }
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
