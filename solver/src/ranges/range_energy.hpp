#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#include "small_matrix.hpp"

namespace asterism::ranges {

/// What is given: M beacons about their centroid.
struct Ranges {
  int count;
  const double* beacons;  ///< (count, D)
  const double* range;
  const double* weight;  ///< 1 / sigma^2
  const double* sigma;
};

/// E(x) = sum_i w_i / 2 (|x - b_i| - r_i)^2, where no term exceeds cutoff^2 / 2: one that would is that of an
/// outlier.
///
/// Functions that take `only`, if it is not 0, are those of least squares of the ranges whose bits it has.
template <int D>
class RangeEnergy {
 public:
  RangeEnergy(const Ranges& ranges, double cutoff)
      : given_(ranges), cutoff_(cutoff), outlier_(0.5 * cutoff * cutoff) {
    double moment = 0;
    for (int i = 0; i < count(); ++i) {
      total_ += weight(i);
      moment += weight(i) * range(i);
      extent_ = std::max(extent_, norm(beacon(i)) + range(i));
    }
    reach_ = is_robust() ? extent_ : moment / total_ + 1e-9 * extent_;
  }

  int count() const { return given_.count; }
  double range(int i) const { return given_.range[i]; }
  double weight(int i) const { return given_.weight[i]; }
  double coordinate(int i, int k) const { return given_.beacons[D * i + k]; }
  Vector<D> beacon(int i) const {
    Vector<D> b;
    for (int k = 0; k < D; ++k) b[k] = coordinate(i, k);
    return b;
  }
  Vector<D> from_beacon(const Vector<D>& x, int i) const {
    Vector<D> p;
    for (int k = 0; k < D; ++k) p[k] = x[k] - coordinate(i, k);
    return p;
  }
  /// Of p, where a beacon itself is a little away from it, so that quotients are finite.
  double length(const Vector<D>& p) const { return std::max(norm(p), 1e-13 * extent_); }

  bool is_robust() const { return outlier_ < std::numeric_limits<double>::infinity(); }
  double outlier() const { return outlier_; }  ///< what an outlier adds
  /// How far from its range an inlier's distance is at most.
  double limit(int i) const { return cutoff_ * given_.sigma[i]; }
  double total() const { return total_; }    ///< of the weights
  double extent() const { return extent_; }  ///< the centroid's largest distance from a beacon, and its range
  /// All stationary points are in a ball of this radius about the centroid.
  double reach() const { return reach_; }

  double operator()(const Vector<D>& x, std::uint64_t only = 0) const {
    double sum = 0;
    for (int i = 0; i < count(); ++i) {
      const double stretch = norm(from_beacon(x, i)) - range(i);
      const double e = 0.5 * weight(i) * stretch * stretch;
      sum += is_inlier(i, e, only) ? e : outlier_;
    }
    return sum;
  }

  double evaluate(const Vector<D>& x, Vector<D>& gradient, Symmetric<D>& hessian,
                  std::uint64_t only = 0) const;
  /// Damped Newton to a local minimum; saddle points are left along their negative curvature.
  double descend(Vector<D>& x, Symmetric<D>& hessian, std::uint64_t only = 0) const;
  /// The radius of a ball about x in which the energy is convex; 0 if none is found.
  double convex_radius(const Vector<D>& x) const;

  /// A first place: from the linear equations of the squared ranges, |x|^2 - 2 b.x = r^2 - |b|^2, whose mean
  /// gives |x|^2. The last axis is that along which the beacons extend least; there |x|^2 may tell more than
  /// they do.
  Vector<D> from_squares() const;
  /// The lowest of the places where D of the first ranges meet, or almost do.
  Vector<D> from_meetings() const;

 private:
  /// Of a range whose square adds e.
  bool is_inlier(int i, double e, std::uint64_t only) const {
    return only == 0 ? e < outlier_ : (only >> i & 1) != 0;
  }
  void return_to_valley(const Vector<D>& from, Vector<D>& x, std::uint64_t only) const;
  bool is_convex_around(const Vector<D>& x, double radius) const;

  Ranges given_;
  double cutoff_, outlier_;
  double total_ = 0, extent_ = 0, reach_ = 0;
};

template <int D>
double RangeEnergy<D>::evaluate(const Vector<D>& x, Vector<D>& gradient, Symmetric<D>& hessian,
                                std::uint64_t only) const {
  double sum = 0, mu = 0;
  gradient = constant<D>(0);
  hessian = Symmetric<D>::zero();
  for (int i = 0; i < count(); ++i) {
    const Vector<D> p = from_beacon(x, i);
    const double w = weight(i), d = length(p), stretch = d - range(i);
    const double e = 0.5 * w * stretch * stretch;
    if (!is_inlier(i, e, only)) {
      sum += outlier_;
      continue;
    }
    sum += e;
    const double inverse = 1 / d, v = w * range(i) * inverse;
    mu += w - v;
    for (int k = 0; k < D; ++k) gradient[k] += (w - v) * p[k];
    hessian.add(v * inverse * inverse, p);
  }
  hessian = hessian.shifted(mu);
  return sum;
}

/// Steps across a curved valley only: where ranges are much more certain than what tells places along it
/// apart, a straight step leaves it. The valley is that of the inliers before the step.
template <int D>
void RangeEnergy<D>::return_to_valley(const Vector<D>& from, Vector<D>& x, std::uint64_t only) const {
  for (int turn = 0; turn < 3; ++turn) {
    Vector<D> gradient = constant<D>(0);
    Symmetric<D> across = Symmetric<D>::zero();
    for (int i = 0; i < count(); ++i) {
      const Vector<D> p = from_beacon(x, i);
      const double w = weight(i), d = length(p), stretch = d - range(i);
      const double before = norm(from_beacon(from, i)) - range(i);
      if (!is_inlier(i, 0.5 * w * before * before, only)) continue;
      for (int k = 0; k < D; ++k) gradient[k] += w * stretch / d * p[k];
      across.add(w / (d * d), p);
    }
    if (across.trace() == 0) return;
    const Vector<D> step = across.shifted(1e-3 * across.trace()).inverse().times(gradient);
    for (int k = 0; k < D; ++k) x[k] -= step[k];
  }
}

template <int D>
double RangeEnergy<D>::descend(Vector<D>& x, Symmetric<D>& hessian, std::uint64_t only) const {
  Vector<D> gradient;
  double e = evaluate(x, gradient, hessian, only), damping = 0;
  int escapes = 0;
  const auto minus = [](Vector<D> from, double factor, const Vector<D>& step) {
    for (int k = 0; k < D; ++k) from[k] -= factor * step[k];
    return from;
  };
  for (int iteration = 0; iteration < 1000; ++iteration) {
    const double rounding =
        std::max(1e-14 * (1 + e), 4e-16 * std::sqrt(2 * e * total_) * (extent_ + norm(x)));
    const bool is_definite = hessian.is_definite();
    if (is_definite) {
      const Vector<D> step = hessian.inverse().times(gradient);
      if (0.5 * dot(step, gradient) <= rounding) {
        const Vector<D> y = minus(x, 1, step);
        if ((*this)(y, only) <= e + rounding) x = y;
        break;
      }
    }
    Symmetric<D> matrix = hessian.shifted(damping);
    double shift = damping;
    while (!matrix.is_definite() && shift < 1e30 * total_) {
      shift = shift == 0 ? 1e-16 * total_ : 3 * shift;
      matrix = hessian.shifted(shift);
    }
    const Vector<D> step = matrix.inverse().times(gradient);
    const double decrease = 0.5 * dot(step, gradient);
    if (!is_definite && decrease <= 1e-16 * (1 + e)) {
      const Vector<D> along = lowest_direction(hessian);
      bool is_lower = false;
      for (double size = 1e-3 * reach_; escapes < 8 && size > 1e-10 * reach_ && !is_lower; size *= 0.5) {
        const Vector<D> y = minus(x, -size, along);
        is_lower = (*this)(y, only) < e;
        if (is_lower) x = y;
      }
      if (!is_lower) break;
      ++escapes;
      e = evaluate(x, gradient, hessian, only);
      damping = 0;
      continue;
    }
    Vector<D> y = minus(x, 1, step), next_gradient;
    Symmetric<D> next_hessian;
    double next = evaluate(y, next_gradient, next_hessian, only);
    if (next > e) {
      return_to_valley(x, y, only);
      next = evaluate(y, next_gradient, next_hessian, only);
    }
    if (next <= e) {
      x = y;
      e = next;
      gradient = next_gradient;
      hessian = next_hessian;
      const double least = hessian.is_definite() ? hessian.least_of_definite() : 0;
      damping = damping < std::max(0.1 * least, 1e-16 * total_) ? 0 : damping / 8;
    } else {
      damping = std::max(shift > 0 ? 8 * shift : matrix.least_of_definite(), 1e-16 * total_);
      if (damping > 1e12 * total_) break;
    }
  }
  return evaluate(x, gradient, hessian, only);
}

template <int D>
bool RangeEnergy<D>::is_convex_around(const Vector<D>& x, double radius) const {
  Symmetric<D> sum = Symmetric<D>::zero();
  double shift = 0;
  for (int i = 0; i < count(); ++i) {
    const Vector<D> p = from_beacon(x, i);
    const double d = length(p), w = weight(i);
    const double stretch = std::abs(d - range(i)), most = limit(i);
    if (stretch - radius >= most) continue;
    if (stretch + radius > most) return false;
    shift += w;
    if (range(i) == 0) continue;
    if (d <= radius) return false;
    const double q = radius / d, v = w * range(i) / d;
    shift -= v * (1 + 1.1547006 * q / (1 - q));
    sum.add(v / (d * d), p);
  }
  return sum.shifted(shift).is_definite();
}

template <int D>
double RangeEnergy<D>::convex_radius(const Vector<D>& x) const {
  double radius = reach_;
  for (int i = 0; i < count(); ++i) radius = std::min(radius, 0.5 * norm(from_beacon(x, i)));
  for (int k = 0; k < 8; ++k, radius *= 0.6)
    if (is_convex_around(x, radius)) return radius;
  return 0;
}

template <int D>
Vector<D> RangeEnergy<D>::from_squares() const {
  Symmetric<D> scatter = Symmetric<D>::zero();
  Vector<D> right = constant<D>(0);
  double square = 0;
  for (int i = 0; i < count(); ++i) {
    const Vector<D> b = beacon(i);
    const double w = weight(i), q = range(i) * range(i) - dot(b, b);
    square += w * q / total_;
    for (int k = 0; k < D; ++k) right[k] -= 0.5 * w * b[k] * q;
    scatter.add(w, b);
  }
  Vector<D> best = scatter.shifted(1e-9 * scatter.trace()).inverse().times(right);
  double lowest = (*this)(best), flat = 0;
  for (int k = 0; k + 1 < D; ++k) flat += best[k] * best[k];
  const double height = std::sqrt(std::max(square - flat, 0.01 * std::abs(square)));
  for (const double last : {-height, height}) {
    Vector<D> x = best;
    x[D - 1] = last;
    const double e = (*this)(x);
    if (e < lowest) {
      lowest = e;
      best = x;
    }
  }
  return best;
}

template <int D>
Vector<D> RangeEnergy<D>::from_meetings() const {
  const int most = std::min(count(), 12);
  Vector<D> best = constant<D>(0);
  double lowest = std::numeric_limits<double>::infinity();
  const auto consider = [&](const Vector<D>& x) {
    const double e = (*this)(x);
    if (e < lowest) {
      lowest = e;
      best = x;
    }
  };
  for (int i = 0; i < most; ++i) {
    for (int j = i + 1; j < most; ++j) {
      // On the circle (two points in the plane) of two ranges: its centre, axis and radius.
      const Vector<D> b = beacon(i), to = beacon(j);
      const double apart = distance(b, to), r = range(i), other = range(j);
      if (apart == 0) continue;
      const double along = (r * r - other * other + apart * apart) / (2 * apart);
      const double radius = std::sqrt(std::max(0.0, r * r - along * along));
      Vector<D> axis, centre;
      for (int k = 0; k < D; ++k) {
        axis[k] = (to[k] - b[k]) / apart;
        centre[k] = b[k] + along * axis[k];
      }
      if constexpr (D == 2) {
        for (const double side : {-radius, radius})
          consider({{centre[0] - side * axis[1], centre[1] + side * axis[0]}});
      } else {
        for (int n = j + 1; n < most; ++n) {
          // The beacon n is at `height` along the axis and at `off` from it: the cosine of the angle there.
          const Vector<D> p = from_beacon(centre, n);
          const double height = dot(p, axis);
          Vector<D> first, second;
          for (int k = 0; k < D; ++k) first[k] = height * axis[k] - p[k];
          const double off = norm(first), third = range(n);
          if (off == 0 || radius == 0) continue;
          const double cosine =
              std::clamp((off * off + radius * radius + height * height - third * third) / (2 * off * radius),
                         -1.0, 1.0);
          const double sine = std::sqrt(1 - cosine * cosine);
          for (int k = 0; k < D; ++k) first[k] /= off;
          second = {{axis[1] * first[2] - axis[2] * first[1], axis[2] * first[0] - axis[0] * first[2],
                     axis[0] * first[1] - axis[1] * first[0]}};
          for (const double side : {-sine, sine}) {
            Vector<D> x = centre;
            for (int k = 0; k < D; ++k) x[k] += radius * (cosine * first[k] + side * second[k]);
            consider(x);
          }
        }
      }
    }
  }
  return best;
}

}  // namespace asterism::ranges
