#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include "closed_forms.hpp"
#include "meeting.hpp"
#include "minima.hpp"
#include "position_lanes.hpp"
#include "range_energy.hpp"
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

template <int D>
class PositionSearch {
 public:
  /// `is_flat`: the last coordinate of all beacons is 0. lanes: with room for as many beacons.
  PositionSearch(const Ranges& ranges, bool is_flat, double within, double cutoff, long max_cells,
                 lanes_v0_1::Cells& lanes)
      : energy_(ranges, cutoff),
        minima_(energy_, is_flat, within),
        is_flat_(is_flat),
        max_cells_(max_cells),
        lanes_(lanes) {}

  /// Finds the minima.
  void run() {
    if (is_proven_at_once()) return;
    is_by_sets_ = has_sets_ = energy_.is_robust() && energy_.count() <= kMostOfSets;
    for (int k = 0; k < D; ++k) set_[k] = k;
    if (!is_by_sets_) push({constant<D>(0), constant<D>(energy_.reach()), 0, 0, 0, 0, 0}, 3);
    branch_and_bound();
  }

  /// Searches the cells on the stack, with as many at a time as there are lanes.
  void branch_and_bound();

  /// The same in one lane, beside the searches of other tags, and without a cutoff: is_proven_at_once(), or
  /// begin(lane), and while next() the lanes are judged and use() is called.
  bool is_proven_at_once() {
    const Vector<D> guess = energy_.from_squares();
    if (is_flat_ && !energy_.is_robust() && settle_flat(energy_, guess, minima_)) return true;
    minima_.add_from(guess);
    if (energy_.is_robust()) {
      minima_.add_from(energy_.from_meetings());
      return false;
    }
    minima_.set_radius(0, excluded_about(energy_, minima_[0], minima_.threshold()));
    return minima_[0].radius == kNone;
  }
  void begin(int lane) {
    lane_ = lane;
    take_lanes(lane, lane + 1);
    push({constant<D>(0), constant<D>(energy_.reach()), 0, 0, 0, 0, 0}, 0);
  }
  bool next() {
    for (; stacked_ > 0; --stacked_) {
      if (!has_room()) return false;
      const Cell& cell = stack_[stacked_ - 1];
      ++cells_;
      if (cell.bound > minima_.threshold() || minima_.cover(cell.centre, cell.half)) continue;
      lanes_.room[lane_] = 2 * (minima_.threshold() + kBarrier);
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
    if (share == 0 || cell.bound > minima_.threshold() || has_its_minimum(cell, lane_) ||
        is_tiny(cell, lanes_.slope[lane_] * h + 0.5 * energy_.total() * h * h)) {
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
  const Minima<D>& finish() {
    minima_.sort();
    return minima_;
  }
  bool is_complete() const { return is_complete_; }
  long cells() const { return cells_; }
  double total_weight() const { return energy_.total(); }

 private:
  static constexpr int kMostUndecided = 6, kLanes = lanes_v0_1::Cells::kMost;
  /// For up to kLanes of each of D halvings of the sides to 1e-12 of the first.
  static constexpr int kRoom = 1024;
  static constexpr double kLittleLess = 0.4;  ///< a cell of which more is left is halved
  static constexpr double kMostShares = 1, kMostLimits = 4;
  static constexpr int kMostOfSets = 14;  ///< ranges, where sets of them are searched one by one
  static constexpr double kNone = std::numeric_limits<double>::infinity();

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

  RangeEnergy<D> energy_;
  Minima<D> minima_;
  bool is_flat_;
  long max_cells_, cells_ = 0;
  bool is_complete_ = true;
  lanes_v0_1::Cells& lanes_;
  double of_outliers_[kLanes];  ///< what outliers add in each lane
  Cell stack_[kRoom];
  int stacked_ = 0, lane_ = 0;
  bool is_by_sets_ = false, has_sets_ = false;  ///< whether it goes by sets of ranges, and some are left
  int set_[D] = {};                             ///< the next one
};

/// The squares of the least and the largest distance of a cell's places from a beacon.
template <int D>
std::pair<double, double> PositionSearch<D>::squares(int i, const Cell& cell) const {
  double near = 0, far = 0;
  for (int k = 0; k < D; ++k) {
    const double q = std::abs(cell.centre[k] - energy_.coordinate(i, k)), n = std::max(0.0, q - cell.half[k]);
    near += n * n;
    far += (q + cell.half[k]) * (q + cell.half[k]);
  }
  return {near, far};
}

/// Whether a range is that of an inlier, or of an outlier, or may be either, in a cell.
template <int D>
typename PositionSearch<D>::Role PositionSearch<D>::role(int i, const Cell& cell) const {
  const auto [near, far] = squares(i, cell);
  const double r = energy_.range(i), limit = energy_.limit(i), high = (r + limit) * (r + limit);
  const double low = r > limit ? (r - limit) * (r - limit) : 0;
  const std::uint64_t bit = i < 64 ? std::uint64_t{1} << i : 0;
  const bool is_far = near > high || far < low;
  const bool may_be_outlier = (near < low || far > high) && (cell.inliers & bit) == 0;
  if (is_far || (cell.outliers & bit) != 0) return {false, may_be_outlier, is_far, energy_.outlier()};
  const double least = near > r * r ? std::sqrt(near) - r : far < r * r ? r - std::sqrt(far) : 0;
  return {true, may_be_outlier, false, 0.5 * energy_.weight(i) * least * least};
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
  const bool is_image = is_flat_ && energy_.is_robust() && cell.centre[D - 1] + cell.half[D - 1] <= 0;
  if (is_image || minima_.cover(cell.centre, cell.half)) cell.bound = kNone;
  if (cell.bound > minima_.threshold()) return true;
  double bound = 0, inliers = 0, outliers = 0, bound_of[kMostUndecided];
  int sure = 0;  // inliers
  int undecided[kMostUndecided];
  for (int i = 0; energy_.is_robust() && i < energy_.count() && bound <= minima_.threshold(); ++i) {
    const std::uint64_t bit = i < 64 ? std::uint64_t{1} << i : 0;
    const Role of = (cell.far & bit) != 0 ? Role{false, true, true, energy_.outlier()} : role(i, cell);
    lanes_.weights[kLanes * i + first] = of.may_be_inlier ? energy_.weight(i) : 0;
    if (!of.may_be_inlier) {
      bound += of.may_be_outlier ? energy_.outlier() : kNone;
      outliers += energy_.outlier();
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
  if (cell.bound > minima_.threshold()) return true;
  if (judged.undecided > 0 && judged.undecided <= kMostUndecided && energy_(cell.centre) < minima_.best())
    minima_.add_from(cell.centre);
  judged.first = first;
  // Without a cutoff there are none, which would each add an infinity.
  const auto of_outliers = [this](int count) { return count == 0 ? 0 : count * energy_.outlier(); };
  const auto take_lane = [&](double constant, bool is_partial) {
    const int lane = first + judged.sets++;
    of_outliers_[lane] = constant;
    lanes_.room[lane] = 2 * (minima_.threshold() + kBarrier - constant);
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
      least_of[set] = least_of[set & (set - 1)] + bound_of[std::countr_zero(set)] - energy_.outlier();
    for (int set = (1 << judged.undecided) - 1; set >= 0; --set) {
      const int count = std::popcount(static_cast<unsigned>(set));
      if (least_of[set] > minima_.threshold() || sure + count < cell.least_inliers) continue;
      if (first + judged.sets == kLanes) {
        if (first > 0) return false;
        judged.is_partial = true;
        break;
      }
      const int lane = take_lane(outliers + of_outliers(judged.undecided - count), false);
      std::uint64_t& of_set = judged.inliers_of[judged.sets - 1] = 0;
      if (lane > first)
        for (int i = 0; i < energy_.count(); ++i)
          lanes_.weights[kLanes * i + lane] = lanes_.weights[kLanes * i + first];
      for (int n = 0; n < judged.undecided; ++n) {
        const bool is_in = (set >> n & 1) != 0;
        lanes_.weights[kLanes * undecided[n] + lane] = is_in ? energy_.weight(undecided[n]) : 0;
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
    const double limit = energy_.limit(i),
                 most =
                     std::max({limit, std::sqrt(far) - energy_.range(i), energy_.range(i) - std::sqrt(near)});
    lanes_.weights[kLanes * i + first] = energy_.weight(i) * limit * limit / (most * most);
  }
  return true;
}

/// What the lanes tell of a cell: the parts of it where a minimum may be, each of one set of inliers or all
/// of all, and how often they are to be halved. Returns their number.
template <int D>
int PositionSearch<D>::settle(Judged& judged, Cell* left, int* halvings) {
  Cell& cell = judged.cell;
  const double h = norm(cell.half),
               at_ridges = std::sqrt(2 * energy_.outlier() * energy_.total()) * h * energy_.count();
  double lowest = kNone, shares = 0;
  int count = 0;
  if (judged.sets > 0 && judged.is_partial) {
    const int lane = judged.first, i = std::countr_zero(judged.undecided_ranges);
    if (lanes_.share[lane] > kLittleLess && h < kMostLimits * energy_.limit(i)) {
      cell.bound = std::max(cell.bound, of_outliers_[lane] + lanes_.bound[lane]);
      if (cell.bound > minima_.threshold()) return 0;
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
    if (part.bound > minima_.threshold() || lanes_.share[lane] == 0) continue;
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
      judged.undecided > 0 ? at_ridges : lanes_.slope[judged.first] * h + 0.5 * energy_.total() * h * h;
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
  for (int i = 0; i < std::min(energy_.count(), 64); ++i) {
    const bool is_outlier = std::abs(norm(energy_.from_beacon(x, i)) - energy_.range(i)) >= energy_.limit(i);
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
    if (!energy_.is_robust()) return distance(x, cell.centre) <= h;
    bool is_in = true;  // in the ball around it, other ranges may be inliers
    for (int k = 0; k < D; ++k)
      is_in = is_in && std::abs(x[k] - cell.centre[k]) <= cell.half[k] + 1e-12 * energy_.extent();
    return is_in;
  };
  for (int i = 0; i < minima_.count(); ++i)
    if (is_inside(minima_[i].x) && has_its_roles(cell, minima_[i].x)) return true;
  double square = 0;
  for (int k = 0; k < D; ++k) square += lanes_.newton[k][lane] * lanes_.newton[k][lane];
  if (!(square <= 2.25 * h * h)) return false;
  Vector<D> x = cell.centre;
  Symmetric<D> hessian;
  // With other inliers, it is no minimum.
  const double found = energy_.descend(x, hessian, of_set);
  const bool is_here = is_inside(x);
  if (of_set == 0 || (is_here && has_its_roles(cell, x))) minima_.add(x, found, hessian);
  return is_here;
}

/// Whether a cell is too flat, or too small, to be split further.
template <int D>
bool PositionSearch<D>::is_tiny(const Cell& cell, double change) {
  if (change >= 0.1 * kBarrier && norm(cell.half) >= 1e-12 * energy_.extent()) return false;
  minima_.add_from(cell.centre);
  return true;
}

/// Gives lanes the beacons, ranges and weights. Others may have more beacons.
template <int D>
void PositionSearch<D>::take_lanes(int first, int last) {
  for (int i = 0; i < lanes_.beacons; ++i) {
    const bool is_heard = i < energy_.count();
    for (int lane = first; lane < last; ++lane) {
      for (int k = 0; k < D; ++k)
        lanes_.places[kLanes * (D * i + k) + lane] = is_heard ? energy_.coordinate(i, k) : 0;
      lanes_.ranges[kLanes * i + lane] = is_heard ? energy_.range(i) : 0;
      lanes_.weights[kLanes * i + lane] = is_heard ? energy_.weight(i) : 0;
    }
  }
  for (int lane = first; lane < last; ++lane) {
    lanes_.extent[lane] = energy_.extent();
    lanes_.rounding[lane] = 1e-14 * energy_.total() * energy_.extent();
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
  const Meeting<D> meeting = meeting_of(energy_, set_);
  Cell cell = {};
  for (const int i : set_) cell.inliers |= std::uint64_t{1} << i;
  cell.bound = (set_[D - 1] + 1 - D) * energy_.outlier();
  cell.outliers = ((std::uint64_t{2} << set_[D - 1]) - 1) & ~cell.inliers;
  cell.least_inliers = meeting.is_clear ? D + 1 : D;
  // If these alone are inliers, all minima are one or its mirror image. Where their beacons are nearly on a
  // line, it may not be found from here.
  if (meeting.is_clear && (energy_.count() - D) * energy_.outlier() <= minima_.threshold()) {
    Cell exact = cell;
    exact.outliers = ~cell.inliers;
    for (int n = 0; n < meeting.places; ++n) {
      Vector<D> x = meeting.place[n];
      if (meeting.places > 1 && !has_its_roles(exact, x)) continue;
      Symmetric<D> hessian;
      const double e = energy_.descend(x, hessian, cell.inliers);
      if (has_its_roles(exact, x)) minima_.add(x, e, hessian);
    }
  }
  for (int n = 0; n < meeting.boxes; ++n) {
    cell.centre = meeting.box[n].centre;
    cell.half = meeting.box[n].half;
    push(cell, 0);
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
  has_sets_ =
      set_[D - 1] < energy_.count() && (set_[D - 1] + 1 - D) * energy_.outlier() <= minima_.threshold();
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
      if (judged[taken].cell.bound <= minima_.threshold()) lanes += judged[taken++].sets;
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
