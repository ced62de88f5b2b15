#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "range_energy.hpp"

namespace asterism::ranges {

/// Two minima between which the energy rises by less, on the straight line, are one.
inline constexpr double kBarrier = 1e-6;

template <int D>
struct Minimum {
  Vector<D> x;
  double energy;
  Symmetric<D> hessian;
  double radius;  ///< of a ball about it with no other minimum below the threshold
};

/// The minima that were found: the lowest of those that are asked for.
template <int D>
class Minima {
 public:
  static constexpr int kMost = 32;

  /// Asks for those up to `within` above the least energy. `is_flat`: the last coordinate of all beacons is
  /// 0, so that each minimum beside them has a mirror image.
  Minima(const RangeEnergy<D>& energy, bool is_flat, double within)
      : energy_(energy), is_flat_(is_flat), within_(within) {
    // Fewer than D ranges meet on circles or spheres, not in points.
    if (energy.is_robust()) ceiling_ = (energy.count() - D + 0.9) * energy.outlier();
  }
  Minima(const Minima&) = delete;
  Minima& operator=(const Minima&) = delete;

  int count() const { return count_; }
  const Minimum<D>& operator[](int i) const { return minima_[i]; }
  double best() const { return best_; }  ///< the least energy
  /// The highest energy of a minimum that is searched for.
  double threshold() const { return std::min(highest(), std::max(best_, left_out_ - kBarrier)); }
  /// Up to this much above the least energy all minima are kept.
  double within() const { return left_out_ > highest() ? within_ : threshold() - best_; }

  /// Adds a minimum below the threshold, and beside flat beacons its mirror image. Returns its index, also if
  /// it was there before, or -1.
  int add(const Vector<D>& x, double e, const Symmetric<D>& hessian);
  /// The same for the minimum to which the energy descends from x.
  int add_from(Vector<D> x) {
    Symmetric<D> hessian;
    const double e = energy_.descend(x, hessian);
    return add(x, e, hessian);
  }
  /// There is no other one below the threshold in a ball of this radius about one.
  void set_radius(int i, double radius) { minima_[i].radius = radius; }

  /// Whether a box is in a ball of a known minimum.
  bool cover(const Vector<D>& centre, const Vector<D>& half) const;

  /// Sorts them by energy, and drops those that are not asked for any more.
  void sort();

 private:
  /// The highest energy of a minimum that is asked for. The threshold is lower where some were left out.
  double highest() const { return std::min(best_ + within_, ceiling_); }
  int keep(const Vector<D>& x, double e, const Symmetric<D>& hessian);
  bool has_barrier(const Minimum<D>& a, const Minimum<D>& b) const;

  const RangeEnergy<D>& energy_;
  bool is_flat_;
  double within_;
  double ceiling_ = std::numeric_limits<double>::infinity(), best_ = ceiling_;
  double left_out_ = ceiling_;  ///< the lowest energy of a minimum for which there was no room
  Minimum<D> minima_[kMost];
  int count_ = 0;
};

template <int D>
int Minima<D>::add(const Vector<D>& x, double e, const Symmetric<D>& hessian) {
  const int at = keep(x, e, hessian);
  if (!is_flat_ || at < 0 || x[D - 1] == 0) return at;
  Vector<D> image = x;
  Symmetric<D> turned = hessian;
  image[D - 1] = -image[D - 1];
  for (int k = 0; k + 1 < D; ++k) turned(D - 1, k) = -turned(D - 1, k);
  keep(image, e, turned);
  return at;
}

/// Whether the energy rises on the straight line from the higher one of two minima to the lower one. The
/// first place is where the quadratic form of the higher one has risen by the barrier; a ridge may be just
/// beyond.
template <int D>
bool Minima<D>::has_barrier(const Minimum<D>& a, const Minimum<D>& b) const {
  const Minimum<D>&from = a.energy >= b.energy ? a : b, &to = a.energy >= b.energy ? b : a;
  Vector<D> way = to.x;
  for (int k = 0; k < D; ++k) way[k] -= from.x[k];
  const double share_of_barrier = std::sqrt(2 * kBarrier / std::max(0.0, form(from.hessian, way)));
  for (double share = std::clamp(1.1 * share_of_barrier, 1e-9, 0.5); share < 1; share *= 1.25) {
    Vector<D> between = from.x;
    for (int k = 0; k < D; ++k) between[k] += share * way[k];
    if (energy_(between) > from.energy + kBarrier) return true;
  }
  return false;
}

template <int D>
int Minima<D>::keep(const Vector<D>& x, double e, const Symmetric<D>& hessian) {
  if (!(e <= threshold())) return -1;
  Minimum<D> found = {x, e, hessian, 0};
  for (int i = 0; i < count_; ++i) {
    Minimum<D>& known = minima_[i];
    const double apart = distance(x, known.x);
    if (apart > known.radius && has_barrier(found, known)) continue;
    if (e < known.energy && apart > 0) {
      if (energy_.is_robust()) found.radius = energy_.convex_radius(x);
      known = found;
      best_ = std::min(best_, e);
    }
    return i;
  }
  best_ = std::min(best_, e);
  if (count_ == kMost) sort();
  if (count_ == kMost) {
    const double last = minima_[kMost - 1].energy;
    left_out_ = std::min(left_out_, std::max(e, last));
    if (e >= last) return -1;
    --count_;
  }
  if (energy_.is_robust()) found.radius = energy_.convex_radius(x);
  minima_[count_] = found;
  return count_++;
}

template <int D>
bool Minima<D>::cover(const Vector<D>& centre, const Vector<D>& half) const {
  for (int i = 0; i < count_; ++i) {
    double far = 0;
    for (int k = 0; k < D; ++k) {
      const double q = std::abs(centre[k] - minima_[i].x[k]) + half[k];
      far += q * q;
    }
    if (far <= minima_[i].radius * minima_[i].radius) return true;
  }
  return false;
}

template <int D>
void Minima<D>::sort() {
  int kept = 0;
  for (int i = 0; i < count_; ++i)
    if (minima_[i].energy <= highest()) minima_[kept++] = minima_[i];
  count_ = kept;
  std::sort(minima_, minima_ + count_, [](const auto& a, const auto& b) { return a.energy < b.energy; });
}

}  // namespace asterism::ranges
