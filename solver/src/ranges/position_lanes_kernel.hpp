#pragma once

// Positions of tags by one instruction set's vectors, in whose lanes tags are. No standard library, see
// batch_lanes.hpp.
#include "../batch_lanes.hpp"
#include "position_lanes.hpp"

namespace asterism::lanes_v0_1 {
namespace {

// Vectors and symmetric matrices in lanes.
template <typename L, int D>
struct LaneAlgebra {
  using V = typename L::V;
  using M = typename L::M;
  static constexpr int kSize = D * (D + 1) / 2;

  struct Vector {
    V at[D];
    ASTERISM_INLINED V& operator[](int k) { return at[k]; }
    ASTERISM_INLINED const V& operator[](int k) const { return at[k]; }
  };
  // Rows of the lower triangle.
  struct Matrix {
    V at[kSize];
    ASTERISM_INLINED const V& operator()(int i, int j) const {
      return i >= j ? at[i * (i + 1) / 2 + j] : at[j * (j + 1) / 2 + i];
    }
  };
  ASTERISM_INLINE V set(double a) { return L::set(a); }
  ASTERISM_INLINE M both(M a, M b) { return L::both(a, b); }
  ASTERISM_INLINE V dot(const Vector& a, const Vector& b) {
    V sum = a[0] * b[0];
    for (int k = 1; k < D; ++k) sum = L::fma(a[k], b[k], sum);
    return sum;
  }
  ASTERISM_INLINE Vector zero() {
    Vector v;
    for (V& a : v.at) a = set(0);
    return v;
  }
  ASTERISM_INLINE Matrix empty() {
    Matrix m;
    for (V& a : m.at) a = set(0);
    return m;
  }
  ASTERISM_INLINE void add(Matrix& m, V factor, const Vector& p) {
    for (int i = 0, n = 0; i < D; ++i) {
      const V scaled = factor * p[i];
      for (int j = 0; j <= i; ++j, ++n) m.at[n] = L::fma(scaled, p[j], m.at[n]);
    }
  }
  ASTERISM_INLINE Matrix shifted(Matrix m, V value) {
    for (int i = 0; i < D; ++i) m.at[i * (i + 3) / 2] = m(i, i) + value;
    return m;
  }
  ASTERISM_INLINE V trace(const Matrix& m) {
    V sum = m(0, 0);
    for (int i = 1; i < D; ++i) sum = sum + m(i, i);
    return sum;
  }
  ASTERISM_INLINE Matrix adjugate(const Matrix& m) {
    const V* const at = m.at;
    if constexpr (D == 2) {
      return {{at[2], set(0) - at[1], at[0]}};
    } else {
      return {{at[2] * at[5] - at[4] * at[4], at[3] * at[4] - at[1] * at[5], at[0] * at[5] - at[3] * at[3],
               at[1] * at[4] - at[2] * at[3], at[1] * at[3] - at[0] * at[4], at[0] * at[2] - at[1] * at[1]}};
    }
  }
  ASTERISM_INLINE V determinant(const Matrix& m, const Matrix& adjugate) {
    V sum = m(0, 0) * adjugate(0, 0);
    for (int i = 1; i < D; ++i) sum = L::fma(m(i, 0), adjugate(i, 0), sum);
    return sum;
  }
  ASTERISM_INLINE M is_definite(const Matrix& m, V determinant) {
    const V none = set(0);
    return both(both(L::less(none, m.at[0]), L::less(none, determinant)),
                L::less(none, m.at[0] * m.at[2] - m.at[1] * m.at[1]));
  }
  ASTERISM_INLINE Vector times(const Matrix& m, const Vector& v) {
    Vector product;
    for (int i = 0; i < D; ++i) {
      product[i] = m(i, 0) * v[0];
      for (int j = 1; j < D; ++j) product[i] = L::fma(m(i, j), v[j], product[i]);
    }
    return product;
  }
  ASTERISM_INLINE Matrix inverted(const Matrix& m) {
    Matrix result = adjugate(m);
    const V factor = L::inverse(determinant(m, result));
    for (V& a : result.at) a = a * factor;
    return result;
  }
};

// The closed forms of position_search.hpp, whose facts and names are those here. A lane whose tag is unusual
// in any way, or not proven, is left to the scalar search.
template <typename L, int D>
class FixLanes : LaneAlgebra<L, D> {
  using Algebra = LaneAlgebra<L, D>;
  using Algebra::add, Algebra::adjugate, Algebra::both, Algebra::determinant, Algebra::dot, Algebra::empty,
      Algebra::inverted, Algebra::is_definite, Algebra::kSize, Algebra::set, Algebra::shifted, Algebra::times,
      Algebra::trace, Algebra::zero;
  using typename Algebra::M, typename Algebra::Matrix, typename Algebra::V, typename Algebra::Vector;
  static constexpr int kLanes = L::kLanes;
  static constexpr double kBarrier = 1e-6, kLargest = 1e8;

  // e^T a e + 2 t e.m + n t^2
  struct Form {
    Matrix a;
    Vector m;
    V n;
  };

 public:
  explicit FixLanes(const FixTask& task) : task_(task) {}

  void run() {
    for (int first = 0; first < task_.tags; first += kLanes) {
      const int used = task_.tags - first < kLanes ? task_.tags - first : kLanes;
      read(first, used);
      turn();
      is_open_ = both(is_open_, descend(start()));
      prove();
      write(first, used);
    }
  }

 private:
  ASTERISM_INLINE void add(Form& form, V factor, const Vector& p) {
    add(form.a, factor, p);
    for (int k = 0; k < D; ++k) form.m[k] = L::fma(factor, p[k], form.m[k]);
    form.n = form.n + factor;
  }

  V weight(int i) const { return L::load(weight_[i]); }
  V range(int i) const { return L::load(range_[i]); }
  Vector beacon(int i) const {
    Vector b;
    for (int k = 0; k < D; ++k) b[k] = L::load(beacon_[i][k]);
    return b;
  }
  Vector from_beacon(const Vector& x, int i) const {
    Vector p;
    for (int k = 0; k < D; ++k) p[k] = x[k] - L::load(beacon_[i][k]);
    return p;
  }
  struct Values {
    V energy, mu, scale;
    Vector gradient;
    Matrix sum;
  };
  // Also keeps d and v of each range.
  Values evaluate(const Vector& x) {
    Values at{set(0), set(0), set(0), zero(), empty()};
    for (int i = 0; i < task_.beacons; ++i) {
      const Vector p = from_beacon(x, i);
      // A beacon itself is a little away from it.
      const V w = weight(i), r = range(i), square = L::max(dot(p, p), smallest_);
      const V per_d = L::inverse_sqrt(square), d = square * per_d, v = w * r * per_d, stretch = d - r;
      L::store(distance_[i], d);
      L::store(share_[i], v);
      at.energy = L::fma(set(0.5) * w * stretch, stretch, at.energy);
      at.mu = at.mu + (w - v);
      at.scale = at.scale + v;
      for (int k = 0; k < D; ++k) at.gradient[k] = L::fma(w - v, p[k], at.gradient[k]);
      add(at.sum, v * per_d * per_d, p);
    }
    return at;
  }

  // A range that was not heard has no weight.
  void read(int first, int used) {
    for (int l = 0; l < kLanes; ++l) {
      const std::ptrdiff_t tag = first + (l < used ? l : 0);
      const double* const ranges = task_.ranges + tag * task_.beacons;
      const double* const sigma = task_.sigma + tag * task_.sigma_stride;
      const double* const places = task_.places + tag * task_.places_stride;
      for (int i = 0; i < task_.beacons; ++i) {
        range_[i][l] = ranges[i];
        sigma_[i][l] = sigma[i];
        for (int k = 0; k < D; ++k) beacon_[i][k][l] = places[D * i + k];
      }
    }
    const V none = set(0), least = set(1 / kLargest), most = set(kLargest);
    V heard = none;
    M is_wrong = L::less(none, none);
    total_ = reach_ = largest_ = none;
    centre_ = zero();
    for (int i = 0; i < task_.beacons; ++i) {
      const V r = range(i), s = L::load(sigma_[i]);
      const M is_heard = L::at_most(r, r);
      M is_fine = both(both(L::at_most(none, r), L::at_most(r, most)),
                       both(L::at_most(least, s), L::at_most(s, most)));
      const V w = L::select(is_heard, L::inverse(s * s), none);
      for (int k = 0; k < D; ++k) {
        const V b = L::select(is_heard, L::load(beacon_[i][k]), none);
        is_fine = both(is_fine, L::at_most(L::abs(b), most));
        largest_ = L::max(largest_, L::abs(b));
        centre_[k] = L::fma(w, b, centre_[k]);
      }
      is_wrong = L::either(is_wrong, L::without(is_heard, is_fine));
      heard = heard + L::select(is_heard, set(1), none);
      const V known = L::select(is_heard, r, none);
      total_ = total_ + w;
      reach_ = L::fma(w, known, reach_);
      L::store(weight_[i], w);
      L::store(range_[i], known);
      L::store(sigma_[i], L::select(is_heard, s, none));
    }
    is_open_ = L::without(L::at_most(set(D), heard), is_wrong);
    const V inverse = L::inverse(total_);
    reach_ = reach_ * inverse;
    for (int k = 0; k < D; ++k) centre_[k] = centre_[k] * inverse;
  }

  ASTERISM_INLINED Vector mirrored(Vector x) const {
    const V q = factor_ * dot(normal_, x);
    for (int k = 0; k < D; ++k) x[k] = L::fnma(q, normal_[k], x[k]);
    return x;
  }

  // The last coordinate becomes that along the direction in which the beacons extend least.
  void turn() {
    const V none = set(0);
    Matrix scatter = empty();
    V square = none;
    for (int i = 0; i < task_.beacons; ++i) {
      Vector b = beacon(i);
      const M is_heard = L::less(none, weight(i));
      for (int k = 0; k < D; ++k) {
        b[k] = L::select(is_heard, b[k] - centre_[k], none);
        L::store(beacon_[i][k], b[k]);
      }
      add(scatter, set(1), b);
      square = L::max(square, dot(b, b));
    }
    const V size = trace(scatter), extent = L::sqrt(square);
    is_open_ = both(is_open_, both(L::less(set(1e-9) * largest_, extent), L::less(set(1e-8), extent)));
    if constexpr (D == 3)
      is_open_ = both(is_open_, L::less(set(1e-9) * size * size, trace(adjugate(scatter))));
    const Matrix powers = adjugate(shifted(scatter, set(1e-10) * size));
    for (int k = 0; k < D; ++k) normal_[k] = set(1 + 0.37 * k);
    for (int round = 0; round < 3; ++round) {
      normal_ = times(powers, normal_);
      const V inverse = L::inverse(L::sqrt(dot(normal_, normal_)));
      for (int k = 0; k < D; ++k) normal_[k] = normal_[k] * inverse;
    }
    V height = none;
    for (int i = 0; i < task_.beacons; ++i) height = L::max(height, L::abs(dot(normal_, beacon(i))));
    is_flat_ = L::at_most(height, L::fma(set(1e-10), extent, set(1e-13) * largest_));
    const V last = normal_[D - 1];
    normal_[D - 1] = last + L::select(L::at_most(none, last), set(1), set(-1));
    factor_ = set(2) * L::inverse(dot(normal_, normal_));
    extent_ = none;
    for (int i = 0; i < task_.beacons; ++i) {
      const Vector b = mirrored(beacon(i));
      for (int k = 0; k < D; ++k) L::store(beacon_[i][k], k + 1 < D ? b[k] : L::select(is_flat_, none, b[k]));
      extent_ = L::max(extent_, L::sqrt(dot(b, b)) + range(i));
    }
    reach_ = L::fma(set(1e-9), extent_, reach_);
    smallest_ = set(1e-26) * extent_ * extent_;
  }

  // RangeEnergy::from_squares
  Vector start() const {
    const V none = set(0);
    Matrix scatter = empty();
    Vector right = zero();
    V square = none;
    for (int i = 0; i < task_.beacons; ++i) {
      const Vector b = beacon(i);
      const V w = weight(i), r = range(i), q = w * L::fma(r, r, none - dot(b, b));
      square = square + q;
      for (int k = 0; k < D; ++k) right[k] = L::fma(set(-0.5) * q, b[k], right[k]);
      add(scatter, w, b);
    }
    square = square * L::inverse(total_);
    scatter = shifted(scatter, set(1e-9) * trace(scatter));
    Vector best = times(inverted(scatter), right);
    V flat = none;
    for (int k = 0; k + 1 < D; ++k) flat = L::fma(best[k], best[k], flat);
    const V height = L::sqrt(L::max(square - flat, set(0.01) * L::abs(square)));
    const V lasts[3] = {best[D - 1], none - height, height};
    V energies[3] = {none, none, none};
    for (int i = 0; i < task_.beacons; ++i) {
      const Vector p = from_beacon(best, i);
      V beside = none;
      for (int k = 0; k + 1 < D; ++k) beside = L::fma(p[k], p[k], beside);
      for (int n = 0; n < 3; ++n) {
        const V up = lasts[n] - L::load(beacon_[i][D - 1]);
        const V stretch = L::sqrt(L::fma(up, up, beside)) - range(i);
        energies[n] = L::fma(weight(i) * stretch, stretch, energies[n]);
      }
    }
    for (int n = 1; n < 3; ++n) {
      const M is_lower = L::less(energies[n], energies[0]);
      energies[0] = L::select(is_lower, energies[n], energies[0]);
      best[D - 1] = L::select(is_lower, lasts[n], best[D - 1]);
    }
    return best;
  }

  // Newton's method to x_. Returns the lanes in which it has converged.
  M descend(const Vector& from) {
    const V none = set(0);
    Vector step = zero();
    V before = set(1e300), decrease = none, share = none;
    M is_done = L::less(none, none);
    x_ = from;
    for (int iteration = 0; iteration < 16; ++iteration) {
      Vector y;
      for (int k = 0; k < D; ++k) y[k] = L::fnma(share, step[k], x_[k]);
      const Values at = evaluate(y);
      // Where the energy has risen, by more than rounding, a shorter step is tried.
      const M is_small = L::at_most(decrease, set(1e-10) * (set(1) + before));
      const M is_new = L::without(L::either(is_small, L::at_most(at.energy, before)), is_done);
      before = L::select(is_new, at.energy, before);
      Matrix hessian = shifted(at.sum, at.mu);
      const M is_convex = is_definite(hessian, determinant(hessian, adjugate(hessian)));
      hessian = shifted(at.sum, L::select(is_convex, at.mu, L::max(at.mu, none)));
      const Vector newton = times(inverted(hessian), at.gradient);
      decrease = L::select(is_new, set(0.5) * dot(newton, at.gradient), decrease);
      share = L::select(is_new, set(1), set(0.25) * share);
      const M is_last = both(both(is_new, is_convex), L::at_most(decrease, set(1e-20) * (set(1) + before)));
      for (int k = 0; k < D; ++k) {
        step[k] = L::select(is_new, newton[k], step[k]);
        x_[k] = L::select(is_new, y[k], x_[k]);
        x_[k] = L::select(is_last, x_[k] - step[k], x_[k]);
      }
      is_done = L::either(is_done, is_last);
      if (L::bits(L::without(is_open_, is_done)) == 0) break;
    }
    return is_done;
  }

  // Whether a form is above the target for all unit e and low <= t <= high.
  static M is_above(const Form& form, V target, V low, V high) {
    V lambda = target;
    M is_proven = L::less(target, target), is_open = L::at_most(target, target);
    for (int round = 0; round < 4; ++round) {
      const Matrix a = shifted(form.a, set(0) - lambda), inverse = adjugate(a);
      const V size = determinant(a, inverse);
      is_open = both(is_open, is_definite(a, size));
      const V rest = form.n - dot(form.m, times(inverse, form.m)) * L::inverse(size);
      const V t = L::select(L::at_most(set(0), rest), low, high);
      const M is_now = both(is_open, L::less(target, L::fma(t * t, rest, lambda)));
      is_proven = L::either(is_proven, is_now);
      is_open = L::without(is_open, is_now);
      if (L::bits(is_open) == 0) break;
      const V sum = trace(a);
      // At least this is the least eigenvalue: the product of the others is at most that of equal ones.
      const V least = D == 2 ? size * L::inverse(sum) : set(4) * size * L::inverse(sum * sum);
      lambda = L::fma(set(0.3), least, lambda);
    }
    return is_proven;
  }

  // excluded_about() for one shell about x_: the lanes in which nothing is between inner and outer.
  M is_excluded(V inner, V outer) const {
    const V none = set(0), ceiling = energy_ + gap_;
    const V slack_of_sigma = L::sqrt(set(2) * ceiling), more = set(1e-9) * extent_;
    const V square = set(0.125) * outer * outer, per_inner = L::inverse(L::max(inner, set(1e-30)));
    Form height{empty(), zero(), none}, slope = height;
    V extra = none;
    for (int i = 0; i < task_.beacons; ++i) {
      const Vector p = from_beacon(x_, i);
      const V r = range(i), d = L::load(distance_[i]), v = L::load(share_[i]);
      const V slack = L::fma(slack_of_sigma, L::load(sigma_[i]), more);
      const V most = L::min(d + outer, r + slack), least = L::max(L::max(d - outer, r - slack), none);
      const V per_sum = L::inverse(d + most);
      add(height, set(4) * v * per_sum * per_sum, p);
      const V of_form = square * L::inverse(L::max(least * (d + least), set(1e-30)));
      const V of_all = L::min(set(1), L::max(most - d, d - least) * per_inner);
      const M is_near = L::less(of_form, of_all);
      add(slope, L::select(is_near, set(2) * v * per_sum * L::inverse(most), none), p);
      extra = L::fma(v, L::select(is_near, of_form, of_all), extra);
    }
    const M is_sloped = is_above(slope, extra - mu_ + rounding_, set(0.75) * inner, set(0.75) * outer);
    if (L::bits(L::without(is_open_, is_sloped)) == 0) return is_sloped;
    const V target = set(2) * gap_ * per_inner * per_inner - mu_ + rounding_;
    return L::either(is_sloped, is_above(height, target, set(0.5) * inner, set(0.5) * outer));
  }

  // At x_, leaves those lanes open in which that proves everything.
  void prove() {
    const V none = set(0), reach = reach_ + L::sqrt(dot(x_, x_));
    x_[D - 1] = L::select(is_flat_, L::abs(x_[D - 1]), x_[D - 1]);  // the same one of two mirror images
    const Values at = evaluate(x_);
    const V left = L::sqrt(dot(at.gradient, at.gradient)) * reach;  // of the energy, as x_ is rounded
    energy_ = at.energy;
    mu_ = at.mu;
    rounding_ = set(1e-9) * at.scale;
    hessian_ = shifted(at.sum, at.mu);
    gap_ = set(task_.within + 2 * kBarrier) + left;
    is_open_ = both(is_open_, is_definite(hessian_, determinant(hessian_, adjugate(hessian_))));
    settle_flat(left, reach);
    V inner = none, outer = set(1.0000001 / 32) * reach;
    for (int shell = 0; shell < kShells; ++shell) {
      const V width = set(1.0 / kShells) * (outer - inner);
      const M is_left = L::without(L::without(is_open_, is_excluded(inner, outer)), is_flat_);
      M is_cleared = is_left;  // in parts
      for (int k = 0; k < kShells && L::bits(is_cleared) != 0; ++k)
        is_cleared =
            both(is_cleared, is_excluded(L::fma(set(k), width, inner), L::fma(set(k + 1), width, inner)));
      is_open_ = L::either(L::without(is_open_, is_left), is_cleared);
      if (L::bits(L::without(is_open_, is_flat_)) == 0) return;
      inner = outer;
      outer = outer + outer;
    }
  }

  // settle_flat(): beside flat beacons, mu is 0, or it is positive and the tag is at them.
  void settle_flat(V left, V reach) {
    const V none = set(0), up = x_[D - 1] * x_[D - 1];
    has_image_ = L::less(none, none);
    if (L::bits(is_flat_) == 0) return;
    V barrier = none - energy_;
    for (int i = 0; i < task_.beacons; ++i) {
      const V d = L::load(distance_[i]), stretch = L::sqrt(L::max(d * d - up, none)) - range(i);
      barrier = L::fma(set(0.5) * weight(i) * stretch, stretch, barrier);
    }
    const V of_mu = set(0.5) * mu_ * reach * reach, most = set(0.5 * kBarrier), much = set(1e3 * kBarrier);
    has_image_ = both(is_flat_, both(L::less(left + L::abs(of_mu), most), L::less(much, barrier)));
    const M is_at = both(both(L::less(left, most), L::less(much, of_mu)),
                         both(is_flat_, L::less(L::abs(barrier), set(1e-3 * kBarrier))));
    x_[D - 1] = L::select(is_at, none, x_[D - 1]);
    is_open_ = L::without(is_open_, L::without(is_flat_, L::either(has_image_, is_at)));
  }

  void write(int first, int used) {
    double energies[kLanes], numbers[2][D + D * D][kLanes];
    Matrix covariance = inverted(hessian_);
    L::store(energies, energy_);
    Vector x = x_;
    for (auto& of : numbers) {
      const Vector place = mirrored(x);
      for (int k = 0; k < D; ++k) L::store(of[k], place[k] + centre_[k]);
      Vector rows[D];
      for (int k = 0; k < D; ++k) {
        for (int l = 0; l < D; ++l) rows[k][l] = covariance(k, l);
        rows[k] = mirrored(rows[k]);
      }
      for (int l = 0; l < D; ++l) {
        Vector column;
        for (int k = 0; k < D; ++k) column[k] = rows[k][l];
        column = mirrored(column);
        for (int k = 0; k <= l; ++k) {
          L::store(of[D + D * k + l], column[k]);
          L::store(of[D + D * l + k], column[k]);
        }
      }
      x[D - 1] = set(0) - x[D - 1];
      for (int k = 0; k + 1 < D; ++k) covariance.at[kSize - D + k] = set(0) - covariance.at[kSize - D + k];
    }
    const unsigned proven = L::bits(is_open_), images = L::bits(has_image_);
    for (int l = 0; l < used; ++l) {
      LaneFix& fix = task_.fixes[first + l];
      fix.count = (proven >> l & 1U) == 0 ? 0 : (images >> l & 1U) != 0 ? 2 : 1;
      fix.energy = energies[l];
      for (int n = 0; n < fix.count; ++n) {
        for (int k = 0; k < D; ++k) fix.x[n][k] = numbers[n][k][l];
        for (int k = 0; k < D * D; ++k) fix.covariance[n][k] = numbers[n][D + k][l];
      }
    }
  }

  static constexpr int kShells = 6;

  const FixTask& task_;
  double beacon_[kMostBeacons][D][kLanes], range_[kMostBeacons][kLanes], sigma_[kMostBeacons][kLanes],
      weight_[kMostBeacons][kLanes], distance_[kMostBeacons][kLanes], share_[kMostBeacons][kLanes];
  M is_open_, is_flat_, has_image_;  // open: what may still be proven
  V total_, reach_, extent_, largest_, smallest_, factor_, energy_, mu_, rounding_, gap_;
  Vector centre_, normal_, x_;
  Matrix hessian_;
};

// Bounds on cells by the facts 2 and 4 of position_search.hpp, about their centres.
template <typename L, int D>
class CellLanes : LaneAlgebra<L, D> {
  using Algebra = LaneAlgebra<L, D>;
  using Algebra::add, Algebra::adjugate, Algebra::both, Algebra::determinant, Algebra::dot, Algebra::empty,
      Algebra::inverted, Algebra::is_definite, Algebra::set, Algebra::shifted, Algebra::times, Algebra::trace,
      Algebra::zero;
  using typename Algebra::M, typename Algebra::Matrix, typename Algebra::V, typename Algebra::Vector;

 public:
  CellLanes(Cells& cells, int first)
      : cells_(cells),
        first_(first),
        room_(L::load(cells.room + first)),
        is_partial_(L::less(set(0), L::load(cells.is_partial + first))) {
    const V none = set(0), one = set(1), extent = L::load(cells.extent + first);
    const V smallest = set(1e-26) * extent * extent;
    Vector centre;
    for (int k = 0; k < D; ++k) {
      centre[k] = L::load(cells.centre[k] + first);
      half_[k] = high_[k] = L::load(cells.half[k] + first);
      low_[k] = none - half_[k];
    }
    square_ = dot(half_, half_);
    const V h = L::sqrt(square_), deviations = L::sqrt(room_);
    for (int i = 0; i < cells.beacons; ++i) {
      Vector p;
      for (int k = 0; k < D; ++k)
        p[k] = centre[k] - L::load(cells.places + Cells::kMost * (D * i + k) + first);
      const V square = L::max(dot(p, p), smallest), per_d = L::inverse_sqrt(square), d = square * per_d;
      const V w = L::load(cells.weights + Cells::kMost * i + first),
              r = L::load(cells.ranges + Cells::kMost * i + first);
      const V v = w * r * per_d, q = h * per_d;
      total_ = total_ + w;
      mu_ = mu_ + (w - v);
      for (int k = 0; k < D; ++k) gradient_[k] = L::fma(w - v, p[k], gradient_[k]);
      add(sum_, v * per_d * per_d, p);

      const M is_apart = L::less(q, one);
      const V growth = L::select(is_apart, q * L::inverse(L::max(one - q, set(1e-9))), none);
      const V change = set(1.1547006) * growth;
      const V kept = L::max(one - change, (one - q) * L::inverse(one + q));
      most_ = L::fma(v, L::select(is_apart, kept, none), most_);
      least_ = L::fma(v, one + change, least_);
      const V near = set(0.57735027) * q * q * L::fma(set(0.66666667), growth, one), far = set(2) + q;
      remainder_ = L::fma(v * d, L::select(is_apart, L::min(near, far), far), remainder_);
      has_beacon_ = L::either(has_beacon_, L::without(L::less(none, v), is_apart));

      const V slack = deviations * L::inverse_sqrt(L::max(w, set(1e-200)));
      const V per_sum = set(2) * L::inverse(r + L::min(d + h, set(1.000001) * (r + slack)));
      const V omega = w * per_sum * per_sum, excess = set(0.5) * (d - r) * (d + r),
              of_excess = omega * excess;
      add(form_, omega, p);
      for (int k = 0; k < D; ++k) {
        by_kappa_[k] = L::fma(omega, p[k], by_kappa_[k]);
        by_one_[k] = L::fma(of_excess, p[k], by_one_[k]);
      }
      kappas_ = kappas_ + omega;
      ones_ = ones_ + of_excess;
      squares_ = L::fma(of_excess, excess, squares_);
    }
  }

  void judge() {
    const Matrix hessian = shifted(sum_, mu_), of_hessian = inverted(hessian);
    const Vector newton = times(of_hessian, gradient_);
    M is_without = has_negative(shifted(sum_, total_ - most_));
    const Vector directions[] = {gradient_, newton, times(of_hessian, newton)};
    for (const Vector& along : directions) is_without = L::either(is_without, is_sloped(hessian, along));
    is_without = L::without(is_without, is_partial_);
    meet_gradient(of_hessian, set(0));
    // Along a valley, the inverse is large.
    const V damping = set(0.1) * total_;
    meet_gradient(inverted(shifted(hessian, damping)), damping);
    meet_energy();
    const Matrix least = shifted(sum_, total_ - least_);
    M is_convex = L::without(is_definite(least, determinant(least, adjugate(least))), has_beacon_);
    is_convex = L::without(is_convex, is_partial_);
    cells_.convex |= L::bits(is_convex) << first_;
    L::store(cells_.slope + first_, L::sqrt(dot(gradient_, gradient_)));
    const V none = set(0);
    V share = L::select(is_without, none, set(1));
    for (int k = 0; k < D; ++k) {
      const V left = set(0.5) * (high_[k] - low_[k]), centre = L::load(cells_.centre[k] + first_);
      share = L::select(L::less(left, none), none, share * L::max(set(1e-99), left * L::inverse(half_[k])));
      L::store(cells_.centre[k] + first_, L::fma(set(0.5), low_[k] + high_[k], centre));
      L::store(cells_.half[k] + first_, left);
      L::store(cells_.newton[k] + first_, newton[k]);
    }
    L::store(cells_.share + first_, share);
  }

 private:
  // Whether an eigenvalue is negative, beyond rounding.
  static M has_negative(const Matrix& m) {
    const V none = set(0), size = trace(m), least = set(-1e-14) * size * size;
    M is_negative = L::less(m(0, 0), none);
    for (int i = 1; i < D; ++i) {
      is_negative = L::either(is_negative, L::less(m(i, i), none));
      for (int j = 0; j < i; ++j)
        is_negative = L::either(is_negative, L::less(m(i, i) * m(j, j) - m(i, j) * m(i, j), least));
    }
    if constexpr (D == 3)
      is_negative = L::either(is_negative, L::less(determinant(m, adjugate(m)), least * size));
    return is_negative;
  }

  // Whether along . grad E is not 0 in the cell.
  M is_sloped(const Matrix& hessian, const Vector& along) const {
    const Vector turned = times(hessian, along);
    V rest = L::abs(dot(along, gradient_));
    for (int k = 0; k < D; ++k) rest = L::fnma(L::abs(turned[k]), half_[k], rest);
    return both(L::less(set(0), rest), L::less(remainder_ * remainder_ * dot(along, along), rest * rest));
  }

  // The part that is left is in this interval, too, unless that is NaN.
  void meet(int k, V low, V high) {
    low_[k] = L::max(low, low_[k]);
    high_[k] = L::min(high, high_[k]);
  }

  // Where the gradient vanishes, (H + damping) z = -gradient +- remainder + damping z.
  void meet_gradient(const Matrix& inverse, V damping) {
    for (int j = 0; j < D; ++j) {
      V square = set(0), reach = square, step = square;
      for (int k = 0; k < D; ++k) {
        square = L::fma(inverse(j, k), inverse(j, k), square);
        reach = L::fma(L::abs(inverse(j, k)), half_[k], reach);
        step = L::fnma(inverse(j, k), gradient_[k], step);
      }
      const V by = L::fma(remainder_ + L::load(cells_.rounding + first_), L::sqrt(square), damping * reach);
      meet(j, L::select(is_partial_, low_[j], step - by), L::select(is_partial_, high_[j], step + by));
    }
  }

  // Fact 4, with a little more on the form's diagonal, against rounding, and an allowance for it. For each
  // kappa the form bounds the energy, and z to an ellipsoid.
  void meet_energy() {
    const V none = set(0), most = set(0.5) * square_, more = set(0.01) * room_ * L::inverse(square_);
    const Matrix model = shifted(form_, more), of_model = inverted(model);
    const Vector at = times(of_model, by_one_), by_kappa = times(of_model, by_kappa_);
    const V bend = L::max(kappas_ - dot(by_kappa_, by_kappa), set(1e-12) * kappas_ + set(1e-200));
    const V slope = ones_ - dot(by_one_, by_kappa);
    const V kappa = L::max(none, L::min(most, (none - slope) * L::inverse(bend)));
    const V least = L::fma(kappa, L::fma(kappa, bend, set(2) * slope), squares_ - dot(by_one_, at));
    const V rounding = set(1e-14) * trace(model) * L::inverse(more) * L::fma(kappas_ * most, most, squares_);
    const V allowance = L::fma(set(0.01), room_, rounding), left = L::max(room_ + allowance - least, none);
    L::store(cells_.bound + first_, set(0.5) * (least - allowance));
    for (int k = 0; k < D; ++k) {
      const V first = none - at[k], last = L::fnma(most, by_kappa[k], first);
      const V width = set(1.000001) * L::sqrt(left * of_model(k, k));
      meet(k, L::min(first, last) - width, L::max(first, last) + width);
    }
  }

  Cells& cells_;
  int first_;
  V room_, square_, total_ = set(0), mu_ = set(0), most_ = set(0), least_ = set(0), remainder_ = set(0);
  V kappas_ = set(0), ones_ = set(0), squares_ = set(0);
  Vector half_, low_, high_, gradient_ = zero(), by_kappa_ = zero(), by_one_ = zero();
  M is_partial_, has_beacon_ = L::less(set(0), set(0));
  Matrix sum_ = empty(), form_ = empty();
};

template <int D>
void judge_in(Cells& cells) {
  cells.convex = 0;
  for (int first = 0; first < Cells::kMost; first += DoubleLanes::kLanes)
    CellLanes<DoubleLanes, D>(cells, first).judge();
}

void run_with_these_instructions(const FixTask& task) {
  if (task.dim == 2)
    FixLanes<DoubleLanes, 2>(task).run();
  else
    FixLanes<DoubleLanes, 3>(task).run();
}

void run_with_these_instructions(Cells& cells) {
  if (cells.dim == 2)
    judge_in<2>(cells);
  else
    judge_in<3>(cells);
}

}  // namespace
}  // namespace asterism::lanes_v0_1
