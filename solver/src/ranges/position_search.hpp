#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include "position_lanes.hpp"
#include "small_matrix.hpp"

// The search for all low minima of E(x) = sum_i w_i / 2 (|x - b_i| - r_i)^2, where no term exceeds a cutoff.
//
// Of each range: p = x - b, d = |p|, u = p / d, v = w r / d. The Hessian of E is mu I + sum v u u^T with
// mu = sum (w - v). Four facts carry the proofs:
//
// 1. Identity. At a stationary point x, for a unit e and rho = |p + s e|, where
//    rho - d = s (2 p.e + s) / (rho + d),
//      E(x + s e) = E(x) + mu s^2 / 2 + sum v / 2 (rho - d)^2.
//    Hence another point at distance s is that low only if the beacons are nearly in the plane (line)
//    halfway: sum v (2 / (rho + d))^2 (p.e + s/2)^2 is then small. As rho <= d + s, and also
//    rho <= r + sqrt(2 E / w) because no term is above E, a quadratic form in e is smaller still.
//    excluded_about() bounds it for shells of s, and the slope along e likewise.
//    If mu >= 0, no point is lower. Where all beacons are in one plane (line), every minimum has that, see
//    settle_flat().
// 2. On a ball of radius h = q d < d around c the Hessian of -w r |x - b| changes by at most
//    v 2/sqrt(3) q / (1 - q), since |D^2 u| <= 2/sqrt(3) / d^2. Bounds of gradient and curvature follow.
// 3. All stationary points are in the ball around the centroid (weights w) of radius sum w r / sum w, as
//    0 = sum w (x - b - r u).
// 4. At z from c, with kappa = |z|^2 / 2,
//      w (rho - r)^2 = 4 w / (rho + r)^2 (p.z + kappa + (d^2 - r^2) / 2)^2.
//    As rho is bounded as in fact 1, a quadratic form in z and kappa is a bound of the energy that hardly
//    depends on the size of the ball.
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

/// What is given: M beacons about their centroid.
struct Ranges {
  int count;
  const double* beacons;  ///< (count, D)
  const double* range;
  const double* weight;  ///< 1 / sigma^2
  const double* sigma;
};

template <int D>
class PositionSearch {
 public:
  static constexpr int kMost = 32;

  /// `is_flat`: the last coordinate of all beacons is 0. lanes: with room for as many beacons.
  PositionSearch(const Ranges& ranges, bool is_flat, double within, double cutoff, long max_cells,
                 lanes_v0_1::Cells& lanes)
      : given_(ranges),
        is_flat_(is_flat),
        within_(within),
        cutoff_(cutoff),
        outlier_(0.5 * cutoff * cutoff),
        max_cells_(max_cells),
        lanes_(lanes) {
    for (int i = 0; i < given_.count; ++i) {
      total_ += given_.weight[i];
      reach_ += given_.weight[i] * given_.range[i];
      extent_ = std::max(extent_, norm(beacon(i)) + given_.range[i]);
    }
    reach_ = reach_ / total_ + 1e-9 * extent_;
    if (is_robust()) {
      reach_ = extent_;
      // Fewer than D ranges meet on circles or spheres, not in points.
      ceiling_ = (given_.count - D + 0.9) * outlier_;
    }
  }

  /// Finds the minima.
  void run() {
    if (is_proven_at_once()) return;
    is_by_sets_ = has_sets_ = is_robust() && given_.count <= kMostOfSets;
    for (int k = 0; k < D; ++k) set_[k] = k;
    if (!is_by_sets_) push({constant<D>(0), constant<D>(reach_), 0, 0, 0, 0, 0}, 3);
    branch_and_bound();
  }

  /// Searches the cells on the stack, with as many at a time as there are lanes.
  void branch_and_bound();

  /// The same in one lane, beside the searches of other tags, and without a cutoff: is_proven_at_once(), or
  /// begin(lane), and while next() the lanes are judged and use() is called.
  bool is_proven_at_once() {
    const Vector<D> guess = from_squares();
    if (is_flat_ && !is_robust() && settle_flat(guess)) return true;
    add_from(guess);
    if (is_robust()) {
      start_from_sets();
      return false;
    }
    minima_[0].radius = excluded_about(minima_[0]);
    return minima_[0].radius == kNone;
  }
  void begin(int lane) {
    lane_ = lane;
    take_lanes(lane, lane + 1);
    push({constant<D>(0), constant<D>(reach_), 0, 0, 0, 0, 0}, 0);
  }
  bool next() {
    for (; stacked_ > 0; --stacked_) {
      if (!has_room()) return false;
      const Cell& cell = stack_[stacked_ - 1];
      ++cells_;
      if (cell.bound > threshold() || is_covered(cell.centre, cell.half)) continue;
      lanes_.room[lane_] = 2 * (threshold() + kBarrier);
      for (int k = 0; k < D; ++k) {
        lanes_.centre[k][lane_] = cell.centre[k];
        lanes_.half[k][lane_] = cell.half[k];
      }
      return true;
    }
    return false;
  }
  void use() {
    Cell& cell = stack_[stacked_ - 1];
    const double share = lanes_.share[lane_], h = norm(cell.half);
    cell.bound = std::max(cell.bound, lanes_.bound[lane_]);
    if (share == 0 || cell.bound > threshold() || has_its_minimum(cell, lane_) ||
        is_tiny(cell, lanes_.slope[lane_] * h + 0.5 * total_ * h * h)) {
      --stacked_;
      return;
    }
    int axis = 0;
    for (int k = 0; k < D; ++k) {
      cell.centre[k] = lanes_.centre[k][lane_];
      cell.half[k] = lanes_.half[k][lane_];
      if (cell.half[k] > cell.half[axis]) axis = k;
    }
    if (share <= kLittleLess) return;
    Cell& other = stack_[stacked_++];
    cell.half[axis] *= 0.5;
    for (int k = 0; k < D; ++k) {
      other.centre[k] = cell.centre[k];
      other.half[k] = cell.half[k];
    }
    other.bound = cell.bound;
    other.inliers = other.outliers = other.far = 0;
    other.least_inliers = 0;
    other.centre[axis] += cell.half[axis];
    cell.centre[axis] -= cell.half[axis];
  }

  /// Sorted by energy, those that are asked for.
  int finish() {
    int kept = 0;
    for (int i = 0; i < count_; ++i)
      if (minima_[i].energy <= highest()) minima_[kept++] = minima_[i];
    count_ = kept;
    std::sort(minima_, minima_ + count_, [](const auto& a, const auto& b) { return a.energy < b.energy; });
    return count_;
  }
  const Minimum<D>& minimum(int i) const { return minima_[i]; }
  bool is_complete() const { return is_complete_; }
  /// Up to this much above the least energy all minima are kept.
  double within() const { return left_out_ > highest() ? within_ : threshold() - best_; }
  long cells() const { return cells_; }
  double total() const { return total_; }  ///< of the weights

 private:
  static constexpr int kShells = 6;
  static constexpr int kMostUndecided = 6, kLanes = lanes_v0_1::Cells::kMost;
  static constexpr int kForm = Symmetric<D>::kSize + D + 1;  ///< numbers of a form in (e, t)
  /// For up to kLanes of each of D halvings of the sides to 1e-12 of the first.
  static constexpr int kRoom = 1024;
  static constexpr double kLittleLess = 0.4;  ///< a cell of which more is left is halved
  static constexpr double kMostShares = 1, kMostLimits = 4;
  static constexpr int kMostOfSets = 14;  ///< ranges, where sets of them are searched one by one
  static constexpr double kNone = std::numeric_limits<double>::infinity();
  using Forms = double[kForm][kShells];

  struct Cell {
    Vector<D> centre, half;
    double bound;
    /// Of the first 64 ranges, those that are inliers, and outliers, in all of it, or of which only minima
    /// are searched where they are.
    std::uint64_t inliers, outliers;
    std::uint64_t far;  ///< of the outliers, those that cannot be inliers anywhere in it
    int least_inliers;  ///< only minima of so many inliers are searched
  };
  /// Of a range in a cell, with a bound on what it adds there.
  struct Role {
    bool may_be_inlier, may_be_outlier, is_far;
    double bound;
  };

  /// A cell that is judged, which has a lane for each set of inliers that it may have, or one for all of
  /// them.
  struct Judged {
    Cell cell;
    int first = 0, sets = 0, undecided = 0;  ///< its lanes, and the ranges that may be inliers or outliers
    bool is_partial = false;                 ///< one lane for all sets
    std::uint64_t undecided_ranges = 0, inliers_of[kLanes] = {};  ///< of the first 64
  };

  bool is_robust() const { return outlier_ < kNone; }
  /// The highest energy of a minimum that is asked for, and of one that is searched for: lower where some
  /// were left out.
  double highest() const { return std::min(best_ + within_, ceiling_); }
  double threshold() const { return std::min(highest(), std::max(best_, left_out_ - kBarrier)); }
  Vector<D> beacon(int i) const {
    Vector<D> b;
    for (int k = 0; k < D; ++k) b[k] = given_.beacons[D * i + k];
    return b;
  }
  Vector<D> from_beacon(const Vector<D>& x, int i) const {
    Vector<D> p;
    for (int k = 0; k < D; ++k) p[k] = x[k] - given_.beacons[D * i + k];
    return p;
  }
  /// Of p, where a beacon itself is a little away from it, so that quotients are finite.
  double length(const Vector<D>& p) const { return std::max(norm(p), 1e-13 * extent_); }

  /// What a range whose square is e adds, and whether as an inlier. `only`: not 0 for least squares of some
  /// of up to 64 ranges.
  bool is_inlier(int i, double e, std::uint64_t only) const {
    return only == 0 ? e < outlier_ : (only >> i & 1) != 0;
  }
  double energy(const Vector<D>& x, std::uint64_t only = 0) const {
    double sum = 0;
    for (int i = 0; i < given_.count; ++i) {
      const double stretch = norm(from_beacon(x, i)) - given_.range[i];
      const double e = 0.5 * given_.weight[i] * stretch * stretch;
      sum += is_inlier(i, e, only) ? e : outlier_;
    }
    return sum;
  }

  double evaluate(const Vector<D>& x, Vector<D>& gradient, Symmetric<D>& hessian,
                  std::uint64_t only = 0) const {
    double sum = 0, mu = 0;
    gradient = constant<D>(0);
    hessian = Symmetric<D>::zero();
    for (int i = 0; i < given_.count; ++i) {
      const Vector<D> p = from_beacon(x, i);
      const double w = given_.weight[i], d = length(p), stretch = d - given_.range[i];
      const double e = 0.5 * w * stretch * stretch;
      if (!is_inlier(i, e, only)) {
        sum += outlier_;
        continue;
      }
      sum += e;
      const double inverse = 1 / d, v = w * given_.range[i] * inverse;
      mu += w - v;
      for (int k = 0; k < D; ++k) gradient[k] += (w - v) * p[k];
      hessian.add(v * inverse * inverse, p);
    }
    hessian = hessian.shifted(mu);
    return sum;
  }

  void return_to_valley(const Vector<D>& from, Vector<D>& x, std::uint64_t only) const;
  double descend(Vector<D>& x, Symmetric<D>& hessian, std::uint64_t only = 0) const;
  bool has_barrier(const Minimum<D>& a, const Minimum<D>& b) const;
  int keep(const Vector<D>& x, double e, const Symmetric<D>& hessian);
  /// The same, and beside flat beacons its mirror image.
  int add(const Vector<D>& x, double e, const Symmetric<D>& hessian) {
    const int at = keep(x, e, hessian);
    if (!is_flat_ || at < 0 || x[D - 1] == 0) return at;
    Vector<D> image = x;
    Symmetric<D> turned = hessian;
    image[D - 1] = -image[D - 1];
    for (int k = 0; k + 1 < D; ++k) turned(D - 1, k) = -turned(D - 1, k);
    keep(image, e, turned);
    return at;
  }
  int add_from(Vector<D> x) {
    Symmetric<D> hessian;
    const double e = descend(x, hessian);
    return add(x, e, hessian);
  }
  bool is_convex_around(const Vector<D>& x, double radius) const;
  double convex_radius(const Vector<D>& x) const;
  Vector<D> from_squares() const;
  bool settle_flat(Vector<D> x);
  void start_from_sets();
  double excluded_about(const Minimum<D>& about) const;
  bool is_covered(const Vector<D>& centre, const Vector<D>& half) const;
  std::pair<double, double> squares(int i, const Cell& cell) const;
  Role role(int i, const Cell& cell) const;
  bool prepare(Judged& judged, int first);
  int settle(Judged& judged, Cell* left, int* halvings);
  bool has_its_minimum(const Cell& cell, int lane);
  bool has_its_roles(const Cell& cell, const Vector<D>& x) const;
  bool is_tiny(const Cell& cell, double change);
  void take_lanes(int first, int last);
  void push(const Cell& cell, int halvings);
  void push_set();
  void take_next_set();
  bool has_room() {
    is_complete_ = is_complete_ && cells_ < max_cells_ && stacked_ + kLanes * 2 <= kRoom;
    return is_complete_;
  }

  Ranges given_;
  bool is_flat_;
  double within_, cutoff_, outlier_;
  long max_cells_;
  double total_ = 0, reach_ = 0, extent_ = 0;
  double ceiling_ = kNone, best_ = kNone;
  Minimum<D> minima_[kMost];
  int count_ = 0;
  long cells_ = 0;
  double left_out_ = kNone;  ///< the lowest energy of a minimum for which there was no room
  bool is_complete_ = true;
  lanes_v0_1::Cells& lanes_;
  double of_outliers_[kLanes];  ///< what outliers add in each lane
  Cell stack_[kRoom];
  int stacked_ = 0, lane_ = 0;
  bool is_by_sets_ = false, has_sets_ = false;  ///< whether it goes by sets of ranges, and some are left
  int set_[D] = {};                             ///< the next one
};

/// Steps across a curved valley only: where ranges are much more certain than what tells places along it
/// apart, a straight step leaves it. The valley is that of the inliers before the step.
template <int D>
void PositionSearch<D>::return_to_valley(const Vector<D>& from, Vector<D>& x, std::uint64_t only) const {
  for (int turn = 0; turn < 3; ++turn) {
    Vector<D> gradient = constant<D>(0);
    Symmetric<D> across = Symmetric<D>::zero();
    for (int i = 0; i < given_.count; ++i) {
      const Vector<D> p = from_beacon(x, i);
      const double w = given_.weight[i], d = length(p), stretch = d - given_.range[i];
      const double before = norm(from_beacon(from, i)) - given_.range[i];
      if (!is_inlier(i, 0.5 * w * before * before, only)) continue;
      for (int k = 0; k < D; ++k) gradient[k] += w * stretch / d * p[k];
      across.add(w / (d * d), p);
    }
    if (across.trace() == 0) return;
    const Vector<D> step = across.shifted(1e-3 * across.trace()).inverse().times(gradient);
    for (int k = 0; k < D; ++k) x[k] -= step[k];
  }
}

/// Damped Newton to a local minimum; saddle points are left along their negative curvature.
template <int D>
double PositionSearch<D>::descend(Vector<D>& x, Symmetric<D>& hessian, std::uint64_t only) const {
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
        if (energy(y, only) <= e + rounding) x = y;
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
        is_lower = energy(y, only) < e;
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

/// Whether the energy rises on the straight line from the higher one of two minima to the lower one. The
/// first place is where the quadratic form of the higher one has risen by the barrier; a ridge may be just
/// beyond.
template <int D>
bool PositionSearch<D>::has_barrier(const Minimum<D>& a, const Minimum<D>& b) const {
  const Minimum<D>&from = a.energy >= b.energy ? a : b, &to = a.energy >= b.energy ? b : a;
  Vector<D> way = to.x;
  for (int k = 0; k < D; ++k) way[k] -= from.x[k];
  const double share_of_barrier = std::sqrt(2 * kBarrier / std::max(0.0, form(from.hessian, way)));
  for (double share = std::clamp(1.1 * share_of_barrier, 1e-9, 0.5); share < 1; share *= 1.25) {
    Vector<D> between = from.x;
    for (int k = 0; k < D; ++k) between[k] += share * way[k];
    if (energy(between) > from.energy + kBarrier) return true;
  }
  return false;
}

/// Keeps a minimum below the threshold. Returns its index, also if it was there before, or -1.
template <int D>
int PositionSearch<D>::keep(const Vector<D>& x, double e, const Symmetric<D>& hessian) {
  if (!(e <= threshold())) return -1;
  Minimum<D> found = {x, e, hessian, 0};
  for (int i = 0; i < count_; ++i) {
    Minimum<D>& known = minima_[i];
    const double apart = distance(x, known.x);
    if (apart > known.radius && has_barrier(found, known)) continue;
    if (e < known.energy && apart > 0) {
      if (is_robust()) found.radius = convex_radius(x);
      known = found;
      best_ = std::min(best_, e);
    }
    return i;
  }
  best_ = std::min(best_, e);
  if (count_ == kMost) finish();
  if (count_ == kMost) {
    const double last = minima_[kMost - 1].energy;
    left_out_ = std::min(left_out_, std::max(e, last));
    if (e >= last) return -1;
    --count_;
  }
  if (is_robust()) found.radius = convex_radius(x);
  minima_[count_] = found;
  return count_++;
}

template <int D>
bool PositionSearch<D>::is_convex_around(const Vector<D>& x, double radius) const {
  Symmetric<D> sum = Symmetric<D>::zero();
  double shift = 0;
  for (int i = 0; i < given_.count; ++i) {
    const Vector<D> p = from_beacon(x, i);
    const double d = length(p), w = given_.weight[i];
    const double stretch = std::abs(d - given_.range[i]), limit = std::sqrt(2 * outlier_ / w);
    if (stretch - radius >= limit) continue;
    if (stretch + radius > limit) return false;
    shift += w;
    if (given_.range[i] == 0) continue;
    if (d <= radius) return false;
    const double q = radius / d, v = w * given_.range[i] / d;
    shift -= v * (1 + 1.1547006 * q / (1 - q));
    sum.add(v / (d * d), p);
  }
  return sum.shifted(shift).is_definite();
}

template <int D>
double PositionSearch<D>::convex_radius(const Vector<D>& x) const {
  double radius = reach_;
  for (int i = 0; i < given_.count; ++i) radius = std::min(radius, 0.5 * norm(from_beacon(x, i)));
  for (int k = 0; k < 8; ++k, radius *= 0.6)
    if (is_convex_around(x, radius)) return radius;
  return 0;
}

/// A first place: from the linear equations of the squared ranges, |x|^2 - 2 b.x = r^2 - |b|^2, whose mean
/// gives |x|^2. The last axis is that along which the beacons extend least; there |x|^2 may tell more than
/// they do.
template <int D>
Vector<D> PositionSearch<D>::from_squares() const {
  Symmetric<D> scatter = Symmetric<D>::zero();
  Vector<D> right = constant<D>(0);
  double square = 0;
  for (int i = 0; i < given_.count; ++i) {
    const Vector<D> b = beacon(i);
    const double w = given_.weight[i], q = given_.range[i] * given_.range[i] - dot(b, b);
    square += w * q / total_;
    for (int k = 0; k < D; ++k) right[k] -= 0.5 * w * b[k] * q;
    scatter.add(w, b);
  }
  Vector<D> best = scatter.shifted(1e-9 * scatter.trace()).inverse().times(right);
  double lowest = energy(best), flat = 0;
  for (int k = 0; k + 1 < D; ++k) flat += best[k] * best[k];
  const double height = std::sqrt(std::max(square - flat, 0.01 * std::abs(square)));
  for (const double last : {-height, height}) {
    Vector<D> x = best;
    x[D - 1] = last;
    const double e = energy(x);
    if (e < lowest) {
      lowest = e;
      best = x;
    }
  }
  return best;
}

/// The minimum beside beacons that all have a last coordinate of 0, and its mirror image. E depends on the
/// other coordinates y and on the square h of the last one, and dE/dh = mu / 2 increases with h: at a minimum
/// mu is 0, or h is 0 and mu >= 0. By the identity, no point is lower, and only the mirror image is as low.
/// Newton's method on y and h >= 0 finds it, where x itself is a bad unknown: E hardly depends on the last
/// coordinate near 0. False, with nothing kept, if rounding leaves more than the minima are to be told to.
template <int D>
bool PositionSearch<D>::settle_flat(Vector<D> x) {
  double h = x[D - 1] * x[D - 1];
  double e = 0, mu = 0;
  int last_steps = 0;
  for (int iteration = 0; iteration < 100; ++iteration) {
    Vector<D> slope = constant<D>(0);  // by y and h
    Symmetric<D> hessian = Symmetric<D>::zero();
    e = mu = 0;
    for (int i = 0; i < given_.count; ++i) {
      Vector<D> p = from_beacon(x, i);
      const double d = length(p), w = given_.weight[i], v = w * given_.range[i] / d;
      e += 0.5 * w * (d - given_.range[i]) * (d - given_.range[i]);
      mu += w - v;
      p[D - 1] = 0.5;
      for (int k = 0; k + 1 < D; ++k) slope[k] += (w - v) * p[k];
      hessian.add(v / (d * d), p);
    }
    slope[D - 1] = 0.5 * mu;
    for (int k = 0; k + 1 < D; ++k) hessian(k, k) += std::max(mu, 0.0) + 1e-13 * total_;
    hessian(D - 1, D - 1) += 1e-13 * total_;
    if (h == 0 && mu >= 0) {  // on the border
      slope[D - 1] = 0;
      for (int k = 0; k + 1 < D; ++k) hessian(D - 1, k) = 0;
    }
    const Vector<D> step = hessian.inverse().times(slope);
    // The last steps lower the energy by less than its rounding.
    const double decrease = dot(step, slope);
    const bool is_last = decrease < 1e-10 * (1 + e);
    if (!(decrease > 0) || (is_last && ++last_steps > 4)) break;
    bool is_lower = false;
    for (double share = 1; share > 1e-6 && !is_lower; share *= 0.5) {
      Vector<D> y = x;
      for (int k = 0; k + 1 < D; ++k) y[k] -= share * step[k];
      const double square = std::max(0.0, h - share * step[D - 1]);
      y[D - 1] = std::sqrt(square);
      is_lower = is_last || energy(y) < e;
      if (!is_lower) continue;
      x = y;
      h = square;
    }
    if (!is_lower) break;
  }
  Vector<D> gradient;
  Symmetric<D> hessian;
  e = evaluate(x, gradient, hessian);
  const double reach = reach_ + norm(x);
  if (!(norm(gradient) * reach + 0.5 * std::max(0.0, -mu) * reach * reach < 0.5 * kBarrier)) return false;
  add(x, e, hessian);
  return true;
}

/// The lowest of the places where D of the first ranges meet, or almost do.
template <int D>
void PositionSearch<D>::start_from_sets() {
  const int count = std::min(given_.count, 12);
  Vector<D> best = constant<D>(0);
  double lowest = std::numeric_limits<double>::infinity();
  const auto consider = [&](const Vector<D>& x) {
    const double e = energy(x);
    if (e < lowest) {
      lowest = e;
      best = x;
    }
  };
  for (int i = 0; i < count; ++i) {
    for (int j = i + 1; j < count; ++j) {
      // On the circle (two points in the plane) of two ranges: its centre, axis and radius.
      const Vector<D> b = beacon(i), to = beacon(j);
      const double apart = distance(b, to), r = given_.range[i], other = given_.range[j];
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
        for (int n = j + 1; n < count; ++n) {
          // The beacon n is at `height` along the axis and at `off` from it: the cosine of the angle there.
          const Vector<D> p = from_beacon(centre, n);
          const double height = dot(p, axis);
          Vector<D> first, second;
          for (int k = 0; k < D; ++k) first[k] = height * axis[k] - p[k];
          const double off = norm(first), third = given_.range[n];
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
  add_from(best);
}

/// Whether e^T A e + 2 t e.m + n t^2 > target for all unit e and low <= t <= high. `form`: A, m, n.
template <int D>
bool is_above(const Symmetric<D>& a, const Vector<D>& m, double n, double target, double low, double high) {
  double lambda = target;  // any number below the eigenvalues of A gives a bound
  for (int round = 0; round < 4; ++round) {
    const Symmetric<D> shifted = a.shifted(-lambda);
    if (!shifted.is_definite()) return false;
    const double rest = n - form(shifted.inverse(), m), t = rest >= 0 ? low : high;
    if (lambda + t * t * rest > target) return true;
    lambda += 0.3 * shifted.least_of_definite();
  }
  return false;
}

/// The radius up to which the identity excludes, in shells, other minima about one; infinite if there are
/// none.
template <int D>
double PositionSearch<D>::excluded_about(const Minimum<D>& about) const {
  double edge[kShells + 1];
  edge[kShells] = 1.0000001 * (reach_ + norm(about.x));
  for (int k = kShells; k > 1; --k) edge[k - 1] = edge[k] / 2;
  edge[0] = 0;
  Forms height = {}, slope = {};
  double extra[kShells] = {}, mu = 0, scale = 0;
  const double ceiling = threshold() + kBarrier;
  for (int i = 0; i < given_.count; ++i) {
    const Vector<D> p = from_beacon(about.x, i);
    const double d = length(p), r = given_.range[i], v = given_.weight[i] * r / d;
    mu += given_.weight[i] - v;
    scale += v;
    // Below the ceiling, rho is between these.
    const double slack = std::sqrt(2 * ceiling / given_.weight[i]) + 1e-9 * extent_;
    double for_height[kShells], for_slope[kShells];
    for (int k = 0; k < kShells; ++k) {
      const double inner = edge[k], s = edge[k + 1];
      const double most = std::min(d + s, r + slack), least = std::max(std::max(d - s, r - slack), 0.0);
      const double t = 2 / (d + most);
      for_height[k] = v * t * t;
      // E' / s = mu + sum v (2 p.e + s) (p.e + s) / (rho (rho + d)), and the product is
      // 2 (p.e + 3 s / 4)^2 - s^2 / 8. A summand is never below -v |rho - d| / s.
      const double of_form = s * s / (8 * least * (d + least));
      const double of_all = std::min(1.0, std::max(most - d, d - least) / inner);
      const bool is_near = of_form < of_all;
      for_slope[k] = is_near ? 2 * v / (most * (d + most)) : 0;
      extra[k] += v * (is_near ? of_form : of_all);
    }
    double product[kForm];
    int n = 0;
    for (int k = 0; k < D; ++k)
      for (int l = 0; l <= k; ++l) product[n++] = p[k] * p[l];
    for (int k = 0; k < D; ++k) product[n++] = p[k];
    product[n] = 1;
    for (n = 0; n < kForm; ++n) {
      for (int k = 0; k < kShells; ++k) {
        height[n][k] += for_height[k] * product[n];
        slope[n][k] += for_slope[k] * product[n];
      }
    }
  }
  const auto exceeds = [](const Forms& forms, int k, double target, double low, double high) {
    Symmetric<D> a;
    Vector<D> m;
    for (int n = 0; n < Symmetric<D>::kSize; ++n) a.at[n] = forms[n][k];
    for (int n = 0; n < D; ++n) m[n] = forms[Symmetric<D>::kSize + n][k];
    return is_above(a, m, forms[kForm - 1][k], target, low, high);
  };
  const double gap = threshold() - about.energy + kBarrier, rounding = 1e-9 * scale;
  for (int k = 0; k < kShells; ++k) {
    const double inner = edge[k], outer = edge[k + 1];
    if (exceeds(slope, k, extra[k] - mu + rounding, 0.75 * inner, 0.75 * outer)) continue;
    const double target = 2 * gap / (inner * inner) - mu + rounding;  // infinite in the first shell
    if (inner == 0 || !exceeds(height, k, target, 0.5 * inner, 0.5 * outer)) return inner;
  }
  return kNone;
}

/// Whether a box is in a ball of a known minimum.
template <int D>
bool PositionSearch<D>::is_covered(const Vector<D>& centre, const Vector<D>& half) const {
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

/// The squares of the least and the largest distance of a cell's places from a beacon.
template <int D>
std::pair<double, double> PositionSearch<D>::squares(int i, const Cell& cell) const {
  double near = 0, far = 0;
  for (int k = 0; k < D; ++k) {
    const double q = std::abs(cell.centre[k] - given_.beacons[D * i + k]),
                 n = std::max(0.0, q - cell.half[k]);
    near += n * n;
    far += (q + cell.half[k]) * (q + cell.half[k]);
  }
  return {near, far};
}

/// Whether a range is that of an inlier, or of an outlier, or may be either, in a cell.
template <int D>
typename PositionSearch<D>::Role PositionSearch<D>::role(int i, const Cell& cell) const {
  const auto [near, far] = squares(i, cell);
  const double r = given_.range[i], limit = cutoff_ * given_.sigma[i], high = (r + limit) * (r + limit);
  const double low = r > limit ? (r - limit) * (r - limit) : 0;
  const std::uint64_t bit = i < 64 ? std::uint64_t{1} << i : 0;
  const bool is_far = near > high || far < low;
  const bool may_be_outlier = (near < low || far > high) && (cell.inliers & bit) == 0;
  if (is_far || (cell.outliers & bit) != 0) return {false, may_be_outlier, is_far, outlier_};
  const double least = near > r * r ? std::sqrt(near) - r : far < r * r ? r - std::sqrt(far) : 0;
  return {true, may_be_outlier, false, 0.5 * given_.weight[i] * least * least};
}

/// Gives a cell a lane for each set of inliers that it may have, from `first` on: a minimum is one of the
/// energy of such a set, as where a term becomes that of an outlier, the energy has a ridge. Where that would
/// be too many, it gets one lane, for a bound of the energy alone, in which the square of each range that may
/// be either has as little weight as its loss. Without a lane, `bound` is above the threshold. False if too
/// few lanes are left.
template <int D>
bool PositionSearch<D>::prepare(Judged& judged, int first) {
  Cell& cell = judged.cell;
  // With a cutoff, the first cell is as large to either side of flat beacons, where the energy is the same.
  const bool is_image = is_flat_ && is_robust() && cell.centre[D - 1] + cell.half[D - 1] <= 0;
  if (is_image || is_covered(cell.centre, cell.half)) cell.bound = kNone;
  if (cell.bound > threshold()) return true;
  double bound = 0, inliers = 0, outliers = 0, bound_of[kMostUndecided];
  int sure = 0;  // inliers
  int undecided[kMostUndecided];
  for (int i = 0; is_robust() && i < given_.count && bound <= threshold(); ++i) {
    const std::uint64_t bit = i < 64 ? std::uint64_t{1} << i : 0;
    const Role of = (cell.far & bit) != 0 ? Role{false, true, true, outlier_} : role(i, cell);
    lanes_.weights[kLanes * i + first] = of.may_be_inlier ? given_.weight[i] : 0;
    if (!of.may_be_inlier) {
      bound += of.may_be_outlier ? outlier_ : kNone;
      outliers += outlier_;
      cell.outliers |= bit;
      if (of.is_far) cell.far |= bit;
    } else if (!of.may_be_outlier) {
      bound += of.bound;
      inliers += of.bound;
      cell.inliers |= bit;
      ++sure;
    } else {
      bound += of.bound;
      judged.undecided_ranges |= bit;
      if (judged.undecided++ < kMostUndecided) {
        undecided[judged.undecided - 1] = i;
        bound_of[judged.undecided - 1] = of.bound;
      }
    }
  }
  cell.bound = std::max(cell.bound, sure + judged.undecided < cell.least_inliers ? kNone : bound);
  if (cell.bound > threshold()) return true;
  if (judged.undecided > 0 && judged.undecided <= kMostUndecided && energy(cell.centre) < best_)
    add_from(cell.centre);
  judged.first = first;
  // Without a cutoff there are none, which would each add an infinity.
  const auto of_outliers = [this](int count) { return count == 0 ? 0 : count * outlier_; };
  const auto take_lane = [&](double constant, bool is_partial) {
    const int lane = first + judged.sets++;
    of_outliers_[lane] = constant;
    lanes_.room[lane] = 2 * (threshold() + kBarrier - constant);
    lanes_.is_partial[lane] = is_partial;
    for (int k = 0; k < D; ++k) {
      lanes_.centre[k][lane] = cell.centre[k];
      lanes_.half[k][lane] = cell.half[k];
    }
    return lane;
  };
  if (judged.undecided <= kMostUndecided) {
    double least_of[1 << kMostUndecided];  // of the energy, by set
    least_of[0] = outliers + inliers + of_outliers(judged.undecided);
    for (unsigned set = 1; set < 1U << judged.undecided; ++set)
      least_of[set] = least_of[set & (set - 1)] + bound_of[std::countr_zero(set)] - outlier_;
    for (int set = (1 << judged.undecided) - 1; set >= 0; --set) {
      const int count = std::popcount(static_cast<unsigned>(set));
      if (least_of[set] > threshold() || sure + count < cell.least_inliers) continue;
      if (first + judged.sets == kLanes) {
        if (first > 0) return false;
        judged.is_partial = true;
        break;
      }
      const int lane = take_lane(outliers + of_outliers(judged.undecided - count), false);
      std::uint64_t& of_set = judged.inliers_of[judged.sets - 1] = 0;
      if (lane > first)
        for (int i = 0; i < given_.count; ++i)
          lanes_.weights[kLanes * i + lane] = lanes_.weights[kLanes * i + first];
      for (int n = 0; n < judged.undecided; ++n) {
        const bool is_in = (set >> n & 1) != 0;
        lanes_.weights[kLanes * undecided[n] + lane] = is_in ? given_.weight[undecided[n]] : 0;
        if (is_in && undecided[n] < 64) of_set |= std::uint64_t{1} << undecided[n];
      }
    }
    if (!judged.is_partial) {
      if (judged.sets == 0) cell.bound = kNone;
      return true;
    }
    judged.sets = 0;
  }
  judged.is_partial = true;
  if (!is_by_sets_) return true;
  take_lane(outliers, true);
  for (std::uint64_t rest = judged.undecided_ranges; rest != 0; rest &= rest - 1) {
    const int i = std::countr_zero(rest);
    const auto [near, far] = squares(i, cell);
    const double limit = cutoff_ * given_.sigma[i],
                 most =
                     std::max({limit, std::sqrt(far) - given_.range[i], given_.range[i] - std::sqrt(near)});
    lanes_.weights[kLanes * i + first] = given_.weight[i] * limit * limit / (most * most);
  }
  return true;
}

/// What the lanes tell of a cell: the parts of it where a minimum may be, each of one set of inliers or all
/// of all, and how often they are to be halved. Returns their number.
template <int D>
int PositionSearch<D>::settle(Judged& judged, Cell* left, int* halvings) {
  Cell& cell = judged.cell;
  const double h = norm(cell.half), at_ridges = std::sqrt(2 * outlier_ * total_) * h * given_.count;
  double lowest = kNone, shares = 0;
  int count = 0;
  if (judged.sets > 0 && judged.is_partial) {
    const int lane = judged.first, i = std::countr_zero(judged.undecided_ranges);
    if (lanes_.share[lane] > kLittleLess && h < kMostLimits * cutoff_ * given_.sigma[i]) {
      cell.bound = std::max(cell.bound, of_outliers_[lane] + lanes_.bound[lane]);
      if (cell.bound > threshold()) return 0;
      if (is_tiny(cell, at_ridges)) return 0;
      for (int k = 0; k < D; ++k) {
        cell.centre[k] = lanes_.centre[k][lane];
        cell.half[k] = lanes_.half[k][lane];
      }
      left[0] = left[1] = cell;
      halvings[0] = halvings[1] = 0;
      left[0].inliers |= std::uint64_t{1} << i;
      left[1].outliers |= std::uint64_t{1} << i;
      return 2;
    }
  }
  for (int n = 0; n < judged.sets; ++n) {
    const int lane = judged.first + n;
    Cell part = cell;
    part.bound = std::max(part.bound, of_outliers_[lane] + lanes_.bound[lane]);
    if (part.bound > threshold() || lanes_.share[lane] == 0) continue;
    if (!judged.is_partial) {
      if (is_by_sets_) {
        part.inliers |= judged.inliers_of[n];
        part.outliers |= judged.undecided_ranges & ~judged.inliers_of[n];
      }
      if ((judged.undecided == 0 || is_by_sets_) && has_its_minimum(part, lane)) continue;
    }
    lowest = std::min(lowest, part.bound);
    shares += lanes_.share[lane];
    for (int k = 0; k < D; ++k) {
      part.centre[k] = lanes_.centre[k][lane];
      part.half[k] = lanes_.half[k][lane];
    }
    halvings[count] = lanes_.share[lane] > kLittleLess;
    left[count++] = part;
  }
  if (judged.sets == 0) {
    left[count] = cell;
    halvings[count++] = 1;
  }
  if (count == 0) return 0;
  const double change =
      judged.undecided > 0 ? at_ridges : lanes_.slope[judged.first] * h + 0.5 * total_ * h * h;
  if (is_tiny(cell, change)) return 0;
  if (count > 1 && (shares > kMostShares || !is_by_sets_)) {
    cell.bound = std::max(cell.bound, lowest);
    left[0] = cell;
    halvings[0] = 1;
    count = 1;
  }
  return count;
}

/// Whether at a place in a cell the ranges are what they are to be there.
template <int D>
bool PositionSearch<D>::has_its_roles(const Cell& cell, const Vector<D>& x) const {
  for (int i = 0; i < std::min(given_.count, 64); ++i) {
    const bool is_outlier = std::abs(norm(from_beacon(x, i)) - given_.range[i]) >= cutoff_ * given_.sigma[i];
    if (((is_outlier ? cell.inliers : cell.outliers) >> i & 1) != 0) return false;
  }
  return true;
}

/// Whether the energy is convex in a cell, so that it has one minimum at most, and that is known.
template <int D>
bool PositionSearch<D>::has_its_minimum(const Cell& cell, int lane) {
  if ((lanes_.convex >> lane & 1) == 0) return false;
  const double h = norm(cell.half);
  const std::uint64_t of_set = is_by_sets_ ? cell.inliers : 0;
  const auto is_inside = [&](const Vector<D>& x) {
    if (!is_robust()) return distance(x, cell.centre) <= h;
    bool is_in = true;  // in the ball around it, other ranges may be inliers
    for (int k = 0; k < D; ++k)
      is_in = is_in && std::abs(x[k] - cell.centre[k]) <= cell.half[k] + 1e-12 * extent_;
    return is_in;
  };
  for (int i = 0; i < count_; ++i)
    if (is_inside(minima_[i].x) && has_its_roles(cell, minima_[i].x)) return true;
  double square = 0;
  for (int k = 0; k < D; ++k) square += lanes_.newton[k][lane] * lanes_.newton[k][lane];
  if (!(square <= 2.25 * h * h)) return false;
  Vector<D> x = cell.centre;
  Symmetric<D> hessian;
  // With other inliers, it is no minimum.
  const double found = descend(x, hessian, of_set);
  const bool is_here = is_inside(x);
  if (of_set == 0 || (is_here && has_its_roles(cell, x))) add(x, found, hessian);
  return is_here;
}

/// Whether a cell is too flat, or too small, to be split further.
template <int D>
bool PositionSearch<D>::is_tiny(const Cell& cell, double change) {
  if (change >= 0.1 * kBarrier && norm(cell.half) >= 1e-12 * extent_) return false;
  add_from(cell.centre);
  return true;
}

/// Gives lanes the beacons, ranges and weights. Others may have more beacons.
template <int D>
void PositionSearch<D>::take_lanes(int first, int last) {
  for (int i = 0; i < lanes_.beacons; ++i) {
    const bool is_heard = i < given_.count;
    for (int lane = first; lane < last; ++lane) {
      for (int k = 0; k < D; ++k)
        lanes_.places[kLanes * (D * i + k) + lane] = is_heard ? given_.beacons[D * i + k] : 0;
      lanes_.ranges[kLanes * i + lane] = is_heard ? given_.range[i] : 0;
      lanes_.weights[kLanes * i + lane] = is_heard ? given_.weight[i] : 0;
    }
  }
  for (int lane = first; lane < last; ++lane) {
    lanes_.extent[lane] = extent_;
    lanes_.rounding[lane] = 1e-14 * total_ * extent_;
  }
}

/// A cell, halved so often along its longest sides.
template <int D>
void PositionSearch<D>::push(const Cell& cell, int halvings) {
  const int first = stacked_;
  stack_[stacked_++] = cell;
  for (; halvings > 0; --halvings) {
    for (int n = first, last = stacked_; n < last; ++n) {
      int axis = 0;
      for (int k = 1; k < D; ++k)
        if (stack_[n].half[k] > stack_[n].half[axis]) axis = k;
      stack_[n].half[axis] *= 0.5;
      stack_[stacked_] = stack_[n];
      stack_[stacked_++].centre[axis] += stack_[n].half[axis];
      stack_[n].centre[axis] -= stack_[n].half[axis];
    }
  }
}

/// The minima of which D ranges are all inliers, and a cell, or two, for all places where they and others
/// are, but none before the last of them. In coordinates about the first beacon, along those towards the
/// others, places are linear functions of the squared distances, and so the square of the last coordinate is
/// a quadratic one. Where beacons are at one place, or on one line in space, distances do not tell places
/// along it.
template <int D>
void PositionSearch<D>::push_set() {
  double square[D], mean[D], spread[D];  // of the range, and of an inlier's distance
  Vector<D> low = constant<D>(-kNone), high = constant<D>(kNone);
  Cell cell = {};
  cell.bound = (set_[D - 1] + 1 - D) * outlier_;
  for (int j = 0; j < D; ++j) {
    const int i = set_[j];
    const double r = given_.range[i], limit = cutoff_ * given_.sigma[i];
    const double most = r + limit, least = std::max(0.0, r - limit);
    square[j] = r * r;
    mean[j] = 0.5 * (most * most + least * least);
    spread[j] = 0.5 * (most - least) * (most + least);
    cell.inliers |= std::uint64_t{1} << i;
    for (int k = 0; k < D; ++k) {
      low[k] = std::max(low[k], given_.beacons[D * i + k] - most);
      high[k] = std::min(high[k], given_.beacons[D * i + k] + most);
    }
  }
  cell.outliers = ((std::uint64_t{2} << set_[D - 1]) - 1) & ~cell.inliers;
  cell.least_inliers = D;
  const auto push_part = [&](const Vector<D>& middle, const Vector<D>& reach, double rounding) {
    for (int k = 0; k < D; ++k) {
      const double from = std::max(low[k], middle[k] - reach[k]),
                   to = std::min(high[k], middle[k] + reach[k]);
      if (from > to + 2 * rounding) return;
      cell.centre[k] = 0.5 * (from + to);
      cell.half[k] = 0.5 * (to - from) + rounding;
    }
    push(cell, 0);
  };
  // x = origin + height axis_0 + sum_{j > 0} at_j axis_j, where at_j = constant_j + sum_k by_jk square_k
  const Vector<D> origin = beacon(set_[0]);
  Vector<D> axis[D], place = origin, middle = origin, half = constant<D>(0);
  double by[D][D] = {}, constants[D] = {}, slope[D] = {1};
  double height = square[0], most = mean[0], less = 0, change = 1e-11 * extent_ * extent_;
  // Coordinates are differences of numbers of these sizes, of which this share is more than what they may be
  // wrong by.
  constexpr double kRounding = 1e-13;
  double sizes[D] = {}, rounding = 1e-9 * extent_;
  bool is_clear = true;  // where the ranges meet
  for (int j = 1; j < D; ++j) {
    axis[j] = from_beacon(beacon(set_[j]), set_[0]);
    constants[j] = dot(axis[j], axis[j]);
    sizes[j] = constants[j];
    for (const int k : {0, j}) sizes[j] += mean[k] + spread[k];
    by[j][0] = 1;
    by[j][j] = -1;
    for (int l = 1; l < j; ++l) {
      const double along = dot(axis[j], axis[l]);
      constants[j] -= 2 * along * constants[l];
      sizes[j] += 2 * std::abs(along) * sizes[l];
      for (int k = 0; k < D; ++k) {
        by[j][k] -= 2 * along * by[l][k];
        axis[j][k] -= along * axis[l][k];
      }
    }
    const double length = norm(axis[j]);
    if (length < 1e-4 * extent_) return push_part(origin, constant<D>(kNone), rounding);
    is_clear = is_clear && length > 1e-2 * extent_;
    sizes[j] /= 2 * length;
    const double wrong = kRounding * sizes[j];
    double at = constants[j] /= 2 * length, of_mean = at, reach = wrong;
    for (int k = 0; k < D; ++k) {
      axis[j][k] /= length;
      by[j][k] /= 2 * length;
      at += by[j][k] * square[k];
      of_mean += by[j][k] * mean[k];
      reach += std::abs(by[j][k]) * spread[k];
    }
    height -= at * at;
    most -= of_mean * of_mean;
    less += reach * reach;
    change += 2 * std::abs(of_mean) * wrong;
    rounding += wrong;
    for (int k = 0; k < D; ++k) {
      slope[k] -= 2 * of_mean * by[j][k];
      place[k] += at * axis[j][k];
      middle[k] += of_mean * axis[j][k];
      half[k] += reach * std::abs(axis[j][k]);
    }
  }
  if constexpr (D == 2)
    axis[0] = {{-axis[1][1], axis[1][0]}};
  else
    axis[0] = {{axis[1][1] * axis[2][2] - axis[1][2] * axis[2][1],
                axis[1][2] * axis[2][0] - axis[1][0] * axis[2][2],
                axis[1][0] * axis[2][1] - axis[1][1] * axis[2][0]}};
  // These beacons are in one plane: if they alone are inliers, all minima are one or its mirror image. Where
  // they are nearly on a line, it may not be found from here.
  Cell exact = cell;
  exact.outliers = ~cell.inliers;
  for (const double side : {-1.0, 1.0}) {
    if (!is_clear || (given_.count - D) * outlier_ > threshold()) break;
    Vector<D> x = place;
    for (int k = 0; k < D; ++k) x[k] += side * std::sqrt(std::max(0.0, height)) * axis[0][k];
    if (height > 0 && !has_its_roles(exact, x)) continue;
    Symmetric<D> hessian;
    const double e = descend(x, hessian, cell.inliers);
    if (has_its_roles(exact, x)) add(x, e, hessian);
    if (height <= 0) break;
  }
  if (is_clear) cell.least_inliers = D + 1;
  for (int k = 0; k < D; ++k) change += std::abs(slope[k]) * spread[k];
  if (most + change >= 0) {
    const double top = std::sqrt(most + change), bottom = std::sqrt(std::max(0.0, most - change - less));
    const double along = bottom > 0 ? 0.5 * (top + bottom) : 0;
    for (int k = 0; k < D; ++k) half[k] += (top - along) * std::abs(axis[0][k]);
    for (const double side : {along, -along}) {
      Vector<D> of_part = middle;
      for (int k = 0; k < D; ++k) of_part[k] += side * axis[0][k];
      push_part(of_part, half, rounding);
      if (along == 0) break;
    }
  }
}

/// In the order of its last range.
template <int D>
void PositionSearch<D>::take_next_set() {
  int k = 0;
  while (k + 1 < D && set_[k] + 1 == set_[k + 1]) {
    set_[k] = k;
    ++k;
  }
  ++set_[k];
  has_sets_ = set_[D - 1] < given_.count && (set_[D - 1] + 1 - D) * outlier_ <= threshold();
}

template <int D>
void PositionSearch<D>::branch_and_bound() {
  take_lanes(0, kLanes);
  while (has_room()) {
    for (; has_sets_ && stacked_ < kLanes; take_next_set()) push_set();
    if (stacked_ == 0) break;
    Judged judged[kLanes];
    int taken = 0, lanes = 0;
    while (stacked_ > 0 && taken < kLanes && lanes < kLanes) {
      judged[taken] = {stack_[stacked_ - 1]};
      if (!prepare(judged[taken], lanes)) break;
      --stacked_;
      ++cells_;
      if (judged[taken].cell.bound <= threshold()) lanes += judged[taken++].sets;
    }
    if (lanes > 0) lanes_v0_1::judge(lanes_);
    Cell left[2 * kLanes];
    int halvings[2 * kLanes], order[2 * kLanes], count_left = 0;
    for (int n = 0; n < taken; ++n) {
      const int last = count_left + settle(judged[n], left + count_left, halvings + count_left);
      for (; count_left < last; ++count_left) {
        int at = count_left;  // the lowest one is searched first
        for (; at > 0 && left[order[at - 1]].bound < left[count_left].bound; --at) order[at] = order[at - 1];
        order[at] = count_left;
      }
    }
    const int more = count_left == 1 ? 2 : count_left == 2 ? 1 : 0;  // to fill the lanes
    for (int n = 0; n < count_left; ++n)
      push(left[order[n]], halvings[order[n]] > 0 ? halvings[order[n]] + more : 0);
  }
}

}  // namespace asterism::ranges
