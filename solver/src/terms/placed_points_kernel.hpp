#pragma once

// Places of new points by one instruction set's vectors, in whose lanes points are. No standard library, see
// batch_lanes.hpp.
#include "../batch_lanes.hpp"
#include "kernels.hpp"

namespace asterism::lanes_v0_1 {
namespace {

// Newton's method on the stress of as many points as there are lanes. A lane whose point has its place takes
// the next one. kDim is the number of coordinates, or 0 where it is known at run time.
template <typename L, int kDim>
class PlacedLanes {
  using V = typename L::V;
  static constexpr int kLanes = L::kLanes, kBlock = 4;  // held points at a time
  static constexpr int kMostEvaluations = 100;
  static constexpr int kMostMirrored = 5;  // dimensions; in more, hardly any second minimum is a lower one
  static constexpr double kExact = 3e-5;   // of a step of Newton's: what is left is near its square
  static constexpr double kNear = 0.1;     // of a step: its prediction tells which minimum is the lower one
  static constexpr double kLeastShift = 0.005, kMostShift = 1e6;  // of the sum of weights

 public:
  explicit PlacedLanes(const PlacedPoints& points)
      : points_(points),
        dim_(kDim > 0 ? kDim : points.dim),
        entries_(dim_ * (dim_ + 1) / 2),
        rows_((points.held + kBlock - 1) / kBlock * kBlock) {
    double* next = points.room;
    const auto take = [&](int vectors) ASTERISM_INLINED {
      double* const taken = next;
      next += vectors * kLanes;
      for (double* number = taken; number != next; ++number) *number = 0;
      return taken;
    };
    distances_ = take(rows_), weights_ = take(rows_), units_ = take(kBlock * dim_);
    x_ = take(dim_), trial_ = take(dim_), step_ = take(dim_);
    gradient_ = take(dim_), new_gradient_ = take(dim_);
    hessian_ = take(entries_), new_hessian_ = take(entries_), factor_ = take(entries_);
  }

  // Each point where the squares of its distances, with weights w / d^2, are nearest to those given, up to
  // what they have in common; and a little off it, as held points may lie on a line, which is a saddle then.
  void start() {
    for (int next = 0, used = kLanes; used == kLanes;) {
      for (used = 0; used < kLanes && load(used, next);) ++used;
      sum_squares();
      solve();
      for (int l = 0; l < used; ++l) {
        for (int c = 0; c < dim_; ++c) place_of(l)[c] = held(0)[c] + step_[c * kLanes + l] + 1e-3 * size_[l];
      }
    }
  }

  void descend() {
    int next = 0, active = 0;
    for (int l = 0; l < kLanes; ++l) active += begin(l, next);
    while (active > 0) {
      evaluate();
      accept();
      solve();
      for (int l = 0; l < kLanes; ++l) {
        if (is_active_[l] && has_ended(l) && !begin_second(l)) active += begin(l, next) - 1;
      }
    }
  }

 private:
  ASTERISM_INLINE V at(const double* numbers, int k) { return L::load(numbers + k * kLanes); }
  ASTERISM_INLINE void set(double* numbers, int k, V v) { L::store(numbers + k * kLanes, v); }

  double* place_of(int l) const { return points_.places + static_cast<std::ptrdiff_t>(point_[l]) * dim_; }
  const double* held(int k) const { return points_.at + static_cast<std::ptrdiff_t>(k) * dim_; }

  // The next point that has to go down; one that has the distance 0 has its place.
  bool load(int l, int& next) {
    while (next < points_.count) {
      const int point = next++;
      const double* const distances = points_.distances + point * points_.distances_stride;
      const double* const weights = points_.weights + point * points_.weights_stride;
      int nearest = -1;
      double total = 0, sum = 0;
      for (int k = 0; k < points_.held; ++k) {
        const bool is_known = weights[k] > 0 && distances[k] == distances[k];
        const double weight = is_known ? weights[k] : 0, distance = is_known ? distances[k] : 0;
        weights_[k * kLanes + l] = weight;
        distances_[k * kLanes + l] = distance;
        total += weight;
        sum += weight * distance;
        if (is_known && (nearest < 0 || distance < distances[nearest])) nearest = k;
      }
      point_[l] = point, nearest_[l] = nearest, total_[l] = total, size_[l] = sum / total;
      if (nearest >= 0 && (points_.have_starts || distances[nearest] > 0)) return true;
      for (int c = 0; c < dim_; ++c) place_of(l)[c] = nearest < 0 ? __builtin_nan("") : held(nearest)[c];
    }
    return false;
  }

  // Whether there is a point to go down from its start.
  int begin(int l, int& next) {
    is_active_[l] = load(l, next);
    if (!is_active_[l]) return 0;
    is_second_[l] = false;
    go_from(l, place_of(l));
    return 1;
  }

  void go_from(int l, const double* start) {
    for (int c = 0; c < dim_; ++c) trial_[c * kLanes + l] = start[c];
    evaluations_[l] = 0, shift_[l] = 0;
  }

  // A descent has ended. The other one begins at the mirror image of its place in the nearest held point.
  bool begin_second(int l) {
    double* const place = place_of(l);
    if (!is_second_[l] || lowest_[l] > predicted_[l]) {
      for (int c = 0; c < dim_; ++c)
        place[c] = x_[c * kLanes + l] - (is_exact_[l] ? step_[c * kLanes + l] : 0);
    }
    if (is_second_[l] || points_.have_starts || dim_ > kMostMirrored) return false;
    is_second_[l] = true;
    lowest_[l] = predicted_[l];
    go_from(l, place);
    for (int c = 0; c < dim_; ++c) trial_[c * kLanes + l] = 2 * held(nearest_[l])[c] - place[c];
    return true;
  }

  // sum += sum_b factors_b units_b units_b', the lower triangle column by column.
  void add_products(const V (&factors)[kBlock], double* sum) const {
    for (int j = 0, n = 0; j < dim_; ++j) {
      V bent[kBlock];
      for (int b = 0; b < kBlock; ++b) bent[b] = factors[b] * at(units_, b * dim_ + j);
      for (int i = j; i < dim_; ++i, ++n) {
        V entry = at(sum, n);
        for (int b = 0; b < kBlock; ++b) entry = L::fma(bent[b], at(units_, b * dim_ + i), entry);
        set(sum, n, entry);
      }
    }
  }

  void clear(double* numbers, int vectors) const {
    for (int n = 0; n < vectors; ++n) set(numbers, n, L::set(0));
  }

  // The system of start(): sum v h h' in the Hessian, 1/2 sum v e h in the gradient, around their means, with
  // h from the first held point, v = w / d^2 and e = |h|^2 - d^2.
  void sum_squares() {
    const V least = L::set(0.1) * L::load(size_);
    V total = L::set(0), excess = total;
    clear(hessian_, entries_), clear(gradient_, dim_), clear(x_, dim_);
    for (int k = 0; k < rows_; k += kBlock) {
      V factors[kBlock];
      for (int b = 0; b < kBlock; ++b) {
        const V d = at(distances_, k + b), longer = L::max(d, least);
        V square = L::set(0);
        for (int c = 0; c < dim_; ++c) {
          const V h = L::set(k + b < points_.held ? held(k + b)[c] - held(0)[c] : 0);
          set(units_, b * dim_ + c, h);
          square = L::fma(h, h, square);
        }
        const V weight = at(weights_, k + b),
                v = weight * L::inverse(L::max(longer * longer, L::set(1e-300)));
        const V share = v * (square - d * d);
        factors[b] = v;
        total = total + v;
        excess = excess + share;
        for (int c = 0; c < dim_; ++c) {
          const V h = at(units_, b * dim_ + c);
          set(x_, c, L::fma(v, h, at(x_, c)));
          set(gradient_, c, L::fma(share, h, at(gradient_, c)));
        }
      }
      add_products(factors, hessian_);
    }
    const V inverse = L::inverse(L::max(total, L::set(1e-300)));
    V trace = L::set(0);
    for (int j = 0, n = 0; j < dim_; ++j) {
      const V mean = at(x_, j) * inverse;
      set(gradient_, j, L::set(0.5) * L::fnma(excess, mean, at(gradient_, j)));
      trace = trace + at(hessian_, n);
      for (int i = j; i < dim_; ++i, ++n) set(hessian_, n, L::fnma(mean, at(x_, i), at(hessian_, n)));
    }
    for (int j = 0, n = 0; j < dim_; n += dim_ - j++)  // held points may lie on a line
      set(hessian_, n, L::fma(L::set(1e-9), trace, at(hessian_, n)));
    L::store(total_, trace);
    for (double& shift : shift_) shift = 0;
    clear(x_, dim_);
  }

  // The stress at the trials, half its gradient and half its Hessian.
  void evaluate() {
    const V least = L::max(L::set(1e-24) * L::load(size_) * L::load(size_), L::set(kLeastLengthSquare));
    V stress = L::set(0), across = stress;
    clear(new_hessian_, entries_), clear(new_gradient_, dim_);
    for (int k = 0; k < rows_; k += kBlock) {
      V shares[kBlock];
      for (int b = 0; b < kBlock; ++b) {
        const bool is_one = k + b < points_.held;
        V square = least;
        for (int c = 0; c < dim_; ++c) {
          const V u = at(trial_, c) - L::set(is_one ? held(k + b)[c] : 0);
          set(units_, b * dim_ + c, u);
          square = L::fma(u, u, square);
        }
        const V inverse = L::inverse_sqrt(square), d = at(distances_, k + b), w = at(weights_, k + b);
        const V stretch = square * inverse - d, tension = w * stretch;
        stress = L::fma(tension, stretch, stress);
        shares[b] = w * d * inverse;
        across = across + (w - shares[b]);
        for (int c = 0; c < dim_; ++c) {
          const V unit = at(units_, b * dim_ + c) * inverse;
          set(units_, b * dim_ + c, unit);
          set(new_gradient_, c, L::fma(tension, unit, at(new_gradient_, c)));
        }
      }
      add_products(shares, new_hessian_);
    }
    for (int j = 0, n = 0; j < dim_; n += dim_ - j++) set(new_hessian_, n, at(new_hessian_, n) + across);
    L::store(new_stress_, stress);
  }

  // The trials become the points where the stress is no higher; and how far the next steps may go.
  void accept() {
    unsigned accepted = 0;
    for (int l = 0; l < kLanes; ++l) {
      const bool is_first = evaluations_[l]++ == 0;
      const double gain = stress_[l] - new_stress_[l], expected = stress_[l] - predicted_[l];
      const double least = kLeastShift * total_[l];
      if (is_first || gain >= 0) {
        accepted |= 1U << l;
        stress_[l] = new_stress_[l];
        if (is_first) continue;
        if (gain > 0.5 * expected) shift_[l] = shift_[l] > least ? shift_[l] / 8 : 0;
        if (gain < 0.1 * expected) shift_[l] = 2 * shift_[l] > least ? 2 * shift_[l] : least;
      } else {
        raise(l);
      }
    }
    const auto which = L::mask(accepted);
    const auto take = [&](double* numbers, const double* others, int count) ASTERISM_INLINED {
      for (int n = 0; n < count; ++n) set(numbers, n, L::select(which, at(others, n), at(numbers, n)));
    };
    take(x_, trial_, dim_), take(gradient_, new_gradient_, dim_), take(hessian_, new_hessian_, entries_);
  }

  void raise(int l) {
    const double least = kLeastShift * total_[l];
    shift_[l] = 4 * shift_[l] > least ? 4 * shift_[l] : least;
  }

  // (H + shift) step = gradient, with a larger shift where that is not positive definite; the next trials;
  // and the stress that is predicted there.
  void solve() {
    for (unsigned failed = factorize(); failed != 0; failed = factorize()) {
      bool is_any = false;
      for (int l = 0; l < kLanes; ++l) {
        if ((failed >> l & 1U) == 0 || !(shift_[l] < kMostShift * total_[l])) continue;
        raise(l);
        is_any = true;
      }
      if (!is_any) break;
    }
    V along = L::set(0), square = along;
    for (int j = 0; j < dim_; ++j) set(step_, j, at(gradient_, j));
    for (int j = 0, n = 0; j < dim_; n += dim_ - j++) {
      const V scaled = at(step_, j) * at(factor_, n);
      for (int i = j + 1; i < dim_; ++i) set(step_, i, L::fnma(at(factor_, n + i - j), scaled, at(step_, i)));
      set(step_, j, scaled);
    }
    for (int j = dim_ - 1, n = entries_ - 1; j >= 0; n -= dim_ - --j) {
      V sum = L::set(0);
      for (int i = j + 1; i < dim_; ++i) sum = L::fma(at(factor_, n + i - j), at(step_, i), sum);
      const V step = L::fnma(at(factor_, n), sum, at(step_, j));
      set(step_, j, step);
      set(trial_, j, at(x_, j) - step);
      along = L::fma(step, at(gradient_, j), along);
      square = L::fma(step, step, square);
    }
    L::store(predicted_, L::load(stress_) - L::fma(L::load(shift_), square, along));
    L::store(length_, L::sqrt(square));
  }

  // H + shift = L D L'. The factor has 1 / D on the diagonal and L D below. Returns the lanes in which a
  // pivot is not positive.
  unsigned factorize() {
    const V shift = L::load(shift_), zero = L::set(0), least = L::set(1e-13) * L::load(total_);
    for (int n = 0; n < entries_; ++n) set(factor_, n, at(hessian_, n));
    unsigned positive = (1U << kLanes) - 1;
    for (int j = 0, n = 0; j < dim_; n += dim_ - j++) {
      const V pivot = at(factor_, n) + shift;
      const auto is_positive = L::less(least, pivot);
      positive &= L::bits(is_positive);
      const V inverse = L::select(is_positive, L::inverse(pivot), zero);
      set(factor_, n, inverse);
      for (int i = j + 1, m = n + dim_ - j; i < dim_; ++i) {
        const V scaled = at(factor_, n + i - j) * inverse;
        for (int k = i; k < dim_; ++k, ++m)
          set(factor_, m, L::fnma(scaled, at(factor_, n + k - j), at(factor_, m)));
      }
    }
    return ~positive & ((1U << kLanes) - 1);
  }

  // Whether the descent ends after this step, or without it.
  bool has_ended(int l) {
    const bool is_small = length_[l] <= kExact * size_[l];
    is_exact_[l] = is_small && shift_[l] == 0;
    if (is_exact_[l] || length_[l] <= kExact * kExact * size_[l]) return true;
    const bool is_stuck = evaluations_[l] == kMostEvaluations || !(shift_[l] < kMostShift * total_[l]);
    const bool is_higher =
        is_second_[l] && length_[l] <= kNear * size_[l] && predicted_[l] > 0.999 * lowest_[l];
    if (is_stuck) predicted_[l] = stress_[l];
    if (is_higher) predicted_[l] = lowest_[l];
    return is_stuck || is_higher;
  }

  const PlacedPoints& points_;
  int dim_, entries_, rows_;
  double *distances_, *weights_, *units_, *x_, *trial_, *step_, *gradient_, *new_gradient_, *hessian_,
      *new_hessian_, *factor_;
  // Of each lane.
  int point_[kLanes] = {}, nearest_[kLanes] = {}, evaluations_[kLanes] = {};
  bool is_active_[kLanes] = {}, is_second_[kLanes] = {}, is_exact_[kLanes] = {};
  double total_[kLanes] = {}, size_[kLanes] = {}, shift_[kLanes] = {}, length_[kLanes] = {};
  double stress_[kLanes] = {}, new_stress_[kLanes] = {}, predicted_[kLanes] = {}, lowest_[kLanes] = {};
};

template <int kDim>
void place_in(const PlacedPoints& points) {
  PlacedLanes<DoubleLanes, kDim> lanes(points);
  if (!points.have_starts) lanes.start();
  lanes.descend();
}

void run_with_these_instructions(const PlacedPoints& points) {
  if (points.dim == 2) return place_in<2>(points);
  return points.dim == 3 ? place_in<3>(points) : place_in<0>(points);
}

}  // namespace
}  // namespace asterism::lanes_v0_1
