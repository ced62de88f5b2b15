#pragma once

// Newton's method of newton.hpp for several systems at once, one per SIMD lane. All lanes iterate in step; a
// lane that is done takes the next system. Each iteration computes everything at the trial point (energy,
// gradient, Hessian, factors and the next step), so that lanes which backtrack stay in step with the others.
// A system that does not converge within kMostTrials evaluations is left to the scalar solver.
#include "batch_sensitivity_kernel.hpp"
#include "batch_system.hpp"

namespace asterism::lanes_v0_1 {
namespace {

/// Newton's method of systems as in LaneSystem.
template <typename L, int kDim, int kFixed>
class LaneNewton : LaneSystem<L, kDim, kFixed> {
  using Base = LaneSystem<L, kDim, kFixed>;
  using Base::each_coordinate;
  using Base::each_link;
  using Base::each_node;
  using Base::kAll;
  using Base::kHessian;
  using Base::kLanes;
  using Base::kLinks;
  using Base::kNodes;
  using Base::kRounding;
  using Base::kSize;
  using Base::links;
  using Base::nodes;
  using Base::plane;
  using Base::size;
  using Base::stride_;
  using typename Base::M;
  using typename Base::R;
  using typename Base::T;
  using typename Base::V;

  static constexpr int kClampedSteps = 2;
  static constexpr int kMostTrials = 60;  // evaluations of a system in its lane

 public:
  static void solve(const Planes<T>& planes, const Settings& settings, std::ptrdiff_t first,
                    std::ptrdiff_t last) {
    const LaneNewton self(planes, settings);
    for (std::ptrdiff_t s = first; s < last; s += kLanes) self.prepare(s);
    self.iterate(first, last);
    for (std::ptrdiff_t s = first; s < last; s += kLanes) self.judge(s);
    if constexpr (sizeof(T) == sizeof(double)) {
      for (std::ptrdiff_t s = first; settings.prove && s < last; s += kLanes) self.prove(s);
    }
  }

 private:
  LaneNewton(const Planes<T>& planes, const Settings& settings) : Base(planes), planes_(planes) {
    const double floor = 64 * R::kEpsilon;  // as StoppingRule
    tolerance_ = static_cast<T>(settings.tolerance);
    if (!(tolerance_ >= static_cast<T>(floor))) tolerance_ = static_cast<T>(floor);
    // The square of Newton's kFlatShare, in the units of short_step and of the rounding of pivots.
    flat_share_ = T(1e-3) * T(1e-3) * (8 * R::kEpsilon) * (8 * R::kEpsilon) * 4 / tolerance_;
    max_iterations_ = static_cast<T>(settings.max_iterations);
    align_ = settings.align && settings.max_iterations > 0;
    T* work = planes.work;
    final_x_ = work;
    work += size() * stride_;
    rounding_ = work;
    work += nodes() * stride_;
    reach_ = work;
    floor_ = work + stride_;
    mode_ = work + 2 * stride_;
    energy_before_ = work + 3 * stride_;
    extent_ = work + 4 * stride_;
    short_step_ = work + 5 * stride_;
  }

  /// Validates the inputs, aligns x, and computes the scales of the stopping rule (stationarity.hpp).
  ASTERISM_KERNEL void prepare(std::ptrdiff_t s) const {
    V x[kSize], a[kSize], k[kNodes], stiffness[kNodes];
    V finite = L::set(0), least = L::set(0), extent = L::set(0), total = L::set(0);
    M all_held = L::mask(kAll);
    each_node([&](auto i) ASTERISM_IN_KERNEL {
      k[i] = stiffness[i] = plane(planes_.anchor_stiffness, i, s);
      finite = L::fma(k[i], L::set(0), finite);
      least = L::min(k[i], least);
      total = total + k[i];
      const M held = L::less(L::set(0), k[i]);
      all_held = L::both(all_held, held);
      unroll<0, kDim>([&](auto d) ASTERISM_IN_KERNEL {
        const int c = kDim * i + d;
        x[c] = plane(planes_.x, c, s);
        const V given = plane(planes_.anchors, c, s);
        finite = L::fma(x[c], L::set(0), L::fma(given, L::set(0), finite));
        a[c] = L::select(held, given, x[c]);  // an anchor without stiffness has no position
        extent = L::max(L::max(L::abs(x[c]), L::abs(a[c])), extent);
      });
    });
    V link_total = L::set(0), strongest = L::set(0);
    each_link([&](auto l, auto i, auto j) ASTERISM_IN_KERNEL {
      const V kl = plane(planes_.link_stiffness, l, s);
      const V mu = plane(planes_.rest_length, l, s);
      finite = L::fma(kl, L::set(0), L::fma(mu, L::set(0), finite));
      least = L::min(kl, L::min(mu, least));
      stiffness[i] = stiffness[i] + kl;
      stiffness[j] = stiffness[j] + kl;
      link_total = link_total + kl;
      strongest = L::max(kl, strongest);
    });
    const V length = this->length(s, a, k, stiffness, link_total, strongest);
    const V reach = L::set(tolerance_) * length;
    V stiffness_total = L::set(0);
    V least_stiffness = stiffness[0];
    each_node([&](auto i) ASTERISM_IN_KERNEL {
      stiffness_total = stiffness_total + stiffness[i];
      least_stiffness = L::min(stiffness[i], least_stiffness);
      L::store(rounding_ + i * stride_ + s, L::set(kRounding) * stiffness[i]);
    });
    M good = L::both(L::at_most(finite, L::set(0)), L::at_most(L::set(0), least));
    good = L::both(good, L::both(L::less(L::set(0), reach), L::less(reach, L::set(R::kMax))));
    good = L::both(good, L::less(L::set(0), least_stiffness));
    // Squared lengths, and energies made of them, must not underflow.
    const V least_square = L::min(reach * reach, stiffness_total * reach * reach);
    good = L::both(good, L::less(L::set(R::kTiny), least_square));
    if (L::bits(L::without(good, all_held)) != 0) [[unlikely]]
      good = L::both(good, connected(s, k));
    if (align_) {
      align(x, a, k, extent, good);
      // A distant start has been moved near the anchors.
      extent = L::set(0);
      each_coordinate(
          [&](auto c) ASTERISM_IN_KERNEL { extent = L::max(L::max(L::abs(x[c]), L::abs(a[c])), extent); });
    }
    const V rounding = L::set(kRounding) * extent;
    const V floor = stiffness_total * rounding * rounding;
    good = L::both(good, L::less(floor, L::set(R::kMax)));
    each_coordinate([&](auto c) ASTERISM_IN_KERNEL { L::store(final_x_ + c * stride_ + s, x[c]); });
    const M loose = L::less(L::set(10) * total, link_total);
    const V mode = L::select(loose, L::set(align_ ? 2 : 1), L::set(1));
    L::store(mode_ + s, L::select(good, mode, L::set(0)));
    L::store(reach_ + s, reach);
    L::store(floor_ + s, floor);
    L::store(extent_ + s, extent);
    // The square of a step after which the gradient is within the tolerance: it changes second derivatives by
    // a share of about step / length.
    L::store(short_step_ + s, L::max(L::set(T(0.25)) * reach * length, rounding * rounding));
  }

  /// The lanes in which every node has a path of positive stiffness to an anchor.
  ASTERISM_KERNEL M connected(std::ptrdiff_t s, const V* k) const {
    V held[kNodes] = {};
    each_node([&](auto i) ASTERISM_IN_KERNEL {
      held[i] = L::select(L::less(L::set(0), k[i]), L::set(1), L::set(0));
    });
    for (int sweep = 1; sweep < nodes(); ++sweep) {
      each_link([&](auto l, auto i, auto j) ASTERISM_IN_KERNEL {
        const V kl = plane(planes_.link_stiffness, l, s);
        const V either = L::select(L::less(L::set(0), kl), L::max(held[i], held[j]), L::set(0));
        held[i] = L::max(held[i], either);
        held[j] = L::max(held[j], either);
      });
    }
    V all = held[0];
    each_node([&](auto i) ASTERISM_IN_KERNEL { all = L::min(all, held[i]); });
    return L::less(L::set(0), all);
  }

  /// detail::align of align.hpp in the lanes of `which`.
  template <typename Coordinates, typename Anchors, typename Stiffness>
  ASTERISM_KERNEL void align(Coordinates& x, const Anchors& a, const Stiffness& k, V extent, M which) const {
    V total = L::set(0);
    V centre[kDim], anchor_centre[kDim];
    unroll<0, kDim>([&](auto d) ASTERISM_IN_KERNEL { centre[d] = anchor_centre[d] = L::set(0); });
    each_node([&](auto i) ASTERISM_IN_KERNEL {
      total = total + k[i];
      unroll<0, kDim>([&](auto d) ASTERISM_IN_KERNEL {
        centre[d] = L::fma(k[i], x[kDim * i + d], centre[d]);
        anchor_centre[d] = L::fma(k[i], a[kDim * i + d], anchor_centre[d]);
      });
    });
    const V inverse_total = L::inverse(total);
    unroll<0, kDim>([&](auto d) ASTERISM_IN_KERNEL {
      centre[d] = centre[d] * inverse_total;
      anchor_centre[d] = anchor_centre[d] * inverse_total;
    });
    V product[kDim * kDim];  // sum k q p^T
    unroll<0, kDim * kDim>([&](auto e) ASTERISM_IN_KERNEL { product[e] = L::set(0); });
    V spread = L::set(0), anchor_spread = L::set(0), before = L::set(0);
    each_node([&](auto i) ASTERISM_IN_KERNEL {
      V p[kDim], kq[kDim];
      unroll<0, kDim>([&](auto d) ASTERISM_IN_KERNEL {
        p[d] = x[kDim * i + d] - centre[d];
        const V q = a[kDim * i + d] - anchor_centre[d];
        kq[d] = k[i] * q;
        anchor_spread = L::fma(kq[d], q, anchor_spread);
        spread = L::fma(k[i] * p[d], p[d], spread);
        const V offset = x[kDim * i + d] - a[kDim * i + d];
        before = L::fma(k[i] * offset, offset, before);
      });
      unroll<0, kDim>([&](auto row) ASTERISM_IN_KERNEL {
        unroll<0, kDim>([&](auto column) ASTERISM_IN_KERNEL {
          product[kDim * row + column] = L::fma(kq[row], p[column], product[kDim * row + column]);
        });
      });
    });
    V rotation[kDim * kDim];
    const V rounding = L::set(8 * R::kEpsilon) * extent;
    const V on_a_point = total * rounding * rounding;
    const M turns = L::both(L::less(on_a_point, spread), L::less(on_a_point, anchor_spread));
    nearest_rotation(product, turns, rotation);

    V after = L::set(0);
    V moved[kSize];
    each_node([&](auto i) ASTERISM_IN_KERNEL {
      V p[kDim];
      unroll<0, kDim>([&](auto d) ASTERISM_IN_KERNEL { p[d] = x[kDim * i + d] - centre[d]; });
      unroll<0, kDim>([&](auto row) ASTERISM_IN_KERNEL {
        V y = anchor_centre[row];
        unroll<0, kDim>([&](auto column)
                            ASTERISM_IN_KERNEL { y = L::fma(rotation[kDim * row + column], p[column], y); });
        moved[kDim * i + row] = y;
        const V offset = y - a[kDim * i + row];
        after = L::fma(k[i] * offset, offset, after);
      });
    });
    const M nearer = L::both(which, L::less(after, before));
    each_coordinate([&](auto c) ASTERISM_IN_KERNEL { x[c] = L::select(nearer, moved[c], x[c]); });
  }

  /// nearest_rotation of align.hpp; the identity in lanes where `turns` is not set.
  ASTERISM_IN_KERNEL static void nearest_rotation(const V* product, M turns, V* rotation) {
    V square = L::set(0);
    unroll<0, kDim * kDim>([&](auto e)
                               ASTERISM_IN_KERNEL { square = L::fma(product[e], product[e], square); });
    if constexpr (kDim == 2) {
      const V cosine = product[0] + product[3];
      const V sine = product[2] - product[1];
      const V both = L::fma(cosine, cosine, sine * sine);
      const M angle = L::both(turns, L::less(L::set(64 * R::kEpsilon * R::kEpsilon) * square, both));
      const V inverse = L::inverse_sqrt(L::select(angle, both, L::set(1)));
      const V c = L::select(angle, cosine * inverse, L::set(1));
      const V s = L::select(angle, sine * inverse, L::set(0));
      rotation[0] = rotation[3] = c;
      rotation[1] = L::set(0) - s;
      rotation[2] = s;
    } else {
      static_assert(kDim == 3);
      // Horn's matrix, shifted to be positive semidefinite, to the power 2^8: each of its columns is a
      // multiple of the quaternion, or of a mixture if two rotations are nearly as good.
      const M any = L::both(turns, L::less(L::set(0), square));
      const V inverse = L::inverse_sqrt(L::select(any, square, L::set(1)));
      V m[9];
      unroll<0, 9>([&](auto e) ASTERISM_IN_KERNEL { m[e] = product[e] * inverse; });
      const V shift = L::set(static_cast<T>(1.7320508075688772));  // |eigenvalues| <= sqrt(3) |M|
      V q[10] = {m[0] + m[4] + m[8] + shift,
                 m[7] - m[5],
                 m[2] - m[6],
                 m[3] - m[1],
                 m[0] - m[4] - m[8] + shift,
                 m[1] + m[3],
                 m[2] + m[6],
                 m[4] - m[0] - m[8] + shift,
                 m[5] + m[7],
                 m[8] - m[0] - m[4] + shift};
      constexpr int kAt[4][4] = {{0, 1, 2, 3}, {1, 4, 5, 6}, {2, 5, 7, 8}, {3, 6, 8, 9}};
      for (int power = 0; power < 8; ++power) {
        V p[10];
        unroll<0, 4>([&](auto row) ASTERISM_IN_KERNEL {
          unroll<row, 4>([&](auto column) ASTERISM_IN_KERNEL {
            V sum = q[kAt[row][0]] * q[kAt[0][column]];
            sum = L::fma(q[kAt[row][1]], q[kAt[1][column]], sum);
            sum = L::fma(q[kAt[row][2]], q[kAt[2][column]], sum);
            p[kAt[row][column]] = L::fma(q[kAt[row][3]], q[kAt[3][column]], sum);
          });
        });
        const V scale = L::inverse(p[0] + p[4] + p[7] + p[9]);
        unroll<0, 10>([&](auto e) ASTERISM_IN_KERNEL { q[e] = p[e] * scale; });
      }
      V h[4] = {q[0], q[1], q[2], q[3]};
      V largest = q[0];
      unroll<1, 4>([&](auto c) ASTERISM_IN_KERNEL {
        const V diagonal = q[kAt[c][c]];
        const M larger = L::less(largest, diagonal);
        largest = L::max(largest, diagonal);
        unroll<0, 4>([&](auto r) ASTERISM_IN_KERNEL { h[r] = L::select(larger, q[kAt[r][c]], h[r]); });
      });
      const V norm = L::inverse_sqrt(h[0] * h[0] + h[1] * h[1] + h[2] * h[2] + h[3] * h[3]);
      const V w = L::select(any, h[0] * norm, L::set(1)), x = L::select(any, h[1] * norm, L::set(0)),
              y = L::select(any, h[2] * norm, L::set(0)), z = L::select(any, h[3] * norm, L::set(0));
      const V one = L::set(1), two = L::set(2);
      rotation[0] = one - two * (y * y + z * z);
      rotation[1] = two * (x * y - w * z);
      rotation[2] = two * (x * z + w * y);
      rotation[3] = two * (x * y + w * z);
      rotation[4] = one - two * (x * x + z * z);
      rotation[5] = two * (y * z - w * x);
      rotation[6] = two * (x * z - w * y);
      rotation[7] = two * (y * z + w * x);
      rotation[8] = one - two * (x * x + y * y);
    }
  }

  /// One system per lane.
  struct State {
    V x[kSize];  // the last accepted point
    V p[kSize];  // the step from there: the trial point is x - t p
    V a[kSize];
    V k[kNodes];
    V rounding[kNodes];  // of pivots
    V mu[kLinks];
    V kl[kLinks];
    V energy;  // at x; infinite before the first evaluation
    V decrement;
    V t;
    V floor;
    V short_step;
    V extent;
    V mode;
    V clamped;  // steps left with curvature across springs clamped
    V iterations;
    V trials;
    std::ptrdiff_t index[kLanes];
    unsigned live;
  };

  void iterate(std::ptrdiff_t first, std::ptrdiff_t last) const {
    State state;
    clear(state);
    std::ptrdiff_t next = first;
    refill(state, kAll, next, last);
    while (state.live != 0) {
      const unsigned done = advance(state);
      if (done != 0) {
        state.live &= ~done;
        refill(state, done, next, last);
      }
    }
  }

  static void clear(State& state) {
    V* values = state.x;
    constexpr int kCount = 3 * kSize + 2 * kNodes + 2 * kLinks + 10;
    for (int v = 0; v < kCount; ++v) values[v] = L::set(0);
    state.live = 0;
  }

  // Puts the next systems into free lanes.
  ASTERISM_KERNEL void refill(State& state, unsigned free, std::ptrdiff_t& next, std::ptrdiff_t last) const {
    for (; free != 0 && next < last; free &= free - 1) {
      const int lane = __builtin_ctz(free);
      state.index[lane] = next;
      state.live |= 1U << lane;
      insert(state, lane, next++);
    }
  }

  // Puts system s into a lane, number by number.
  ASTERISM_IN_KERNEL void insert(State& state, int lane, std::ptrdiff_t s) const {
    const auto put = [lane](V& values, T value)
                         ASTERISM_IN_KERNEL { reinterpret_cast<T*>(&values)[lane] = value; };
    const auto take = [s, put](V& values, const T* source) ASTERISM_IN_KERNEL { put(values, source[s]); };
    // Without stiffness, an anchor's position and a link's rest length mean nothing, and may overflow.
    each_node([&](auto i) ASTERISM_IN_KERNEL {
      take(state.k[i], planes_.anchor_stiffness + i * stride_);
      take(state.rounding[i], rounding_ + i * stride_);
      const bool held = planes_.anchor_stiffness[i * stride_ + s] > 0;
      unroll<0, kDim>([&](auto d) ASTERISM_IN_KERNEL {
        const int c = kDim * i + d;
        take(state.x[c], final_x_ + c * stride_);
        take(state.a[c], (held ? planes_.anchors : final_x_) + c * stride_);
        put(state.p[c], 0);
      });
    });
    each_link([&](auto l, auto, auto) ASTERISM_IN_KERNEL {
      const bool pulls = planes_.link_stiffness[l * stride_ + s] > 0;
      take(state.mu[l], (pulls ? planes_.rest_length : planes_.link_stiffness) + l * stride_);  // else 0
      take(state.kl[l], planes_.link_stiffness + l * stride_);
    });
    take(state.floor, floor_);
    take(state.short_step, short_step_);
    take(state.extent, extent_);
    take(state.mode, mode_);
    put(state.energy, R::kMax);
    put(state.decrement, 0);
    put(state.t, 0);
    put(state.iterations, 0);
    put(state.trials, 0);
    put(state.clamped, kClampedSteps);
  }

  struct Evaluation {
    V energy;
    V decrement;  // the square of the Newton decrement
    M definite;   // no pivot was repaired, no curvature clamped
    V flattest;   // the greatest ratio of a pivot's rounding to the pivot
  };

  /// Energy, gradient, Hessian, its factors and Newton's step at x. The energy is NaN if nodes coincide.
  template <typename Coordinates>
  ASTERISM_IN_KERNEL Evaluation evaluate(const State& s, const Coordinates& x, V limit, V* step) const {
    V h[kHessian];
    V g[kSize];
    const auto [twice, most] = this->assemble(s, x, limit, h, g, [](auto, V, V, V) ASTERISM_IN_KERNEL {});
    const auto [decrement, definite, flattest] = this->solve_linear(h, g, s.rounding, step);
    const M apart = L::less(most, L::set(R::kCoincident));
    const V energy = L::select(apart, L::set(T(0.5)) * twice, L::set(static_cast<T>(__builtin_nan(""))));
    return {energy, decrement, L::both(definite, L::at_most(most, limit)), flattest};
  }

  // Evaluates the trial point of every lane. Returns the lanes that are done with their systems.
  ASTERISM_KERNEL unsigned advance(State& s) const {
    V y[kSize], q[kSize];
    each_coordinate([&](auto c) ASTERISM_IN_KERNEL { y[c] = L::fnma(s.t, s.p[c], s.x[c]); });
    const M loose = L::less(L::set(1), s.mode);
    if ((L::bits(loose) & s.live) != 0) [[unlikely]]
      align(y, s.a, s.k, s.extent, loose);
    const V zero = L::set(0), one = L::set(1);
    const V limit = L::select(L::less(zero, s.clamped), one, L::set(R::kMax));
    const Evaluation e = evaluate(s, y, limit, q);

    // Armijo's condition; once the decrement is near the energy's rounding, a rise by rounding is allowed.
    const T terms = static_cast<T>(nodes() + links()) * R::kEpsilon;
    const V rounding = L::set(terms) * s.energy;
    const V slack = L::select(L::less(s.decrement, L::set(8) * rounding), rounding, zero);
    const V target = L::fnma(L::set(T(1e-4)) * s.t, s.decrement, s.energy + slack);
    const M falls = L::at_most(e.energy, target);
    V longest = zero;  // the square of the longest step of a node
    each_node([&](auto i) ASTERISM_IN_KERNEL {
      V square = q[kDim * i] * q[kDim * i];
      unroll<1, kDim>([&](auto d)
                          ASTERISM_IN_KERNEL { square = L::fma(q[kDim * i + d], q[kDim * i + d], square); });
      longest = L::max(longest, square);
    });
    const V count = s.iterations + L::select(L::both(falls, L::less(zero, s.t)), one, zero);
    const M in_time = L::less(count, L::set(max_iterations_));
    M close = L::at_most(e.decrement, L::set(2) * L::max(L::set(tolerance_) * e.energy, s.floor));
    close = L::both(close, L::at_most(longest, s.short_step));
    // A nearly singular Hessian may become indefinite within a step of that length: it has to be shorter.
    const V flat_step = longest * e.flattest * e.flattest;
    close = L::both(close, L::at_most(flat_step, L::set(flat_share_) * s.short_step));
    const M finished = L::both(L::both(falls, in_time), L::both(close, e.definite));

    // If the energy did not fall enough, the step is shortened to the minimum of the interpolating parabola.
    const V vertex =
        s.t * s.t * s.decrement * L::inverse(L::set(2) * (e.energy - s.energy + s.t * s.decrement));
    const V shorter = L::max(L::min(vertex, L::set(T(0.5)) * s.t), L::set(T(0.1)) * s.t);
    const M stuck = L::without(L::at_most(s.t, L::set(T(1e-5))), falls);
    const V trials = s.trials + one;
    s.trials = trials;
    const M late = L::without(falls, in_time);
    const M lost = L::either(L::either(L::at_most(L::set(kMostTrials), trials), stuck),
                             L::either(L::less(s.mode, one), late));
    s.iterations = count;
    s.energy = L::select(falls, e.energy, s.energy);
    s.decrement = L::select(falls, e.decrement, s.decrement);
    s.t = L::select(falls, one, shorter);
    s.clamped = L::select(falls, L::max(s.clamped - one, zero), s.clamped);
    each_coordinate([&](auto c) ASTERISM_IN_KERNEL {
      s.x[c] = L::select(falls, y[c], s.x[c]);
      s.p[c] = L::select(falls, q[c], s.p[c]);
    });
    const unsigned done = L::bits(L::either(finished, lost)) & s.live;
    if (done != 0) write(s, done, L::bits(finished), L::bits(late));
    return done;
  }

  // Writes the systems of the lanes in `done`. A converged one takes its last step, too, which is so short
  // that it needs no evaluation.
  ASTERISM_KERNEL void write(State& s, unsigned done, unsigned finished, unsigned late) const {
    const V last_step = L::select(L::mask(finished), L::set(1), L::set(0));
    T out[kSize][kLanes];
    each_coordinate([&](auto c) ASTERISM_IN_KERNEL { L::store(out[c], L::fnma(last_step, s.p[c], s.x[c])); });
    T energy[kLanes], iterations[kLanes], mode[kLanes];
    L::store(energy, s.energy);
    L::store(iterations, s.iterations + last_step);
    L::store(mode, s.mode);
    for (unsigned rest = done; rest != 0; rest &= rest - 1) {
      const int lane = __builtin_ctz(rest);
      const std::ptrdiff_t index = s.index[lane];
      each_coordinate([&](auto c) ASTERISM_IN_KERNEL { final_x_[c * stride_ + index] = out[c][lane]; });
      energy_before_[index] = energy[lane];
      planes_.iterations[index] = static_cast<std::int32_t>(iterations[lane]);
      const bool is_in = mode[lane] >= 1;
      const unsigned bit = 1U << lane;
      planes_.outcome[index] = !is_in                  ? kLeft
                               : (finished & bit) != 0 ? kConverged
                               : (late & bit) != 0     ? kStopped
                                                       : kLeft;
    }
  }

  /// Checks the results from the energy and gradient at x, computed afresh, as session.hpp does.
  ASTERISM_KERNEL void judge(std::ptrdiff_t s) const {
    V start[kSize], x[kSize], a[kSize], g[kSize];
    V k[kNodes];
    V twice = L::set(0), twice_start = L::set(0);
    each_node([&](auto i) ASTERISM_IN_KERNEL {
      k[i] = plane(planes_.anchor_stiffness, i, s);
      const M held = L::less(L::set(0), k[i]);
      unroll<0, kDim>([&](auto d) ASTERISM_IN_KERNEL {
        const int c = kDim * i + d;
        start[c] = plane(planes_.x, c, s);
        x[c] = plane(final_x_, c, s);
        a[c] = L::select(held, plane(planes_.anchors, c, s), x[c]);
        const V e = x[c] - a[c];
        g[c] = k[i] * e;
        twice = L::fma(g[c], e, twice);
        const V f = start[c] - a[c];
        twice_start = L::fma(k[i] * f, f, twice_start);
      });
    });
    V most = L::set(0);
    each_link([&](auto l, auto i, auto j) ASTERISM_IN_KERNEL {
      const V kl = plane(planes_.link_stiffness, l, s);
      const V mu = L::select(L::less(L::set(0), kl), plane(planes_.rest_length, l, s), L::set(0));
      V d[kDim];
      V square = L::set(0), square_start = L::set(0);
      unroll<0, kDim>([&](auto c) ASTERISM_IN_KERNEL {
        d[c] = x[kDim * i + c] - x[kDim * j + c];
        square = L::fma(d[c], d[c], square);
        const V f = start[kDim * i + c] - start[kDim * j + c];
        square_start = L::fma(f, f, square_start);
      });
      const V inverse = L::inverse_sqrt(L::max(square, L::set(R::kTiny)));
      const V ratio = mu * inverse;
      most = L::max(most, ratio);
      const V stretch = L::fma(square, inverse, L::set(0) - mu);
      twice = L::fma(kl * stretch, stretch, twice);
      const V pull = L::fnma(kl, ratio, kl);
      const V stretch_start =
          L::fma(square_start, L::inverse_sqrt(L::max(square_start, L::set(R::kTiny))), L::set(0) - mu);
      twice_start = L::fma(kl * stretch_start, stretch_start, twice_start);
      unroll<0, kDim>([&](auto c) ASTERISM_IN_KERNEL {
        g[kDim * i + c] = L::fma(pull, d[c], g[kDim * i + c]);
        g[kDim * j + c] = L::fnma(pull, d[c], g[kDim * j + c]);
      });
    });
    // The stopping rule: max_i |g_i| / A_ii against tolerance times length.
    V largest = L::set(0);
    each_node([&](auto i) ASTERISM_IN_KERNEL {
      const V inverse = L::inverse(plane(rounding_, i, s)) * L::set(8 * R::kEpsilon);
      V square = L::set(0);
      unroll<0, kDim>([&](auto d) ASTERISM_IN_KERNEL {
        const V e = g[kDim * i + d] * inverse;
        square = L::fma(e, e, square);
      });
      largest = L::max(largest, square);
    });
    const V reach = L::load(reach_ + s);
    const V ratio = L::sqrt(largest) * L::inverse(reach);  // stationarity / tolerance
    const V half = L::set(T(0.5));
    const V energy = half * twice, initial = half * twice_start, before = L::load(energy_before_ + s);
    const T terms = static_cast<T>(nodes() + links()) * R::kEpsilon;
    M sound = L::both(L::less(most, L::set(R::kCoincident)), L::at_most(energy, initial));
    sound = L::both(sound, L::at_most(energy, L::fma(L::set(4 * terms), before, before)));
    sound = L::both(sound, L::less(initial, L::set(R::kMax)));
    const unsigned is_sound = L::bits(sound), is_stationary = L::bits(L::at_most(ratio, L::set(1)));
    unsigned taken = 0;
    for (int lane = 0; lane < kLanes; ++lane) {
      std::int32_t& outcome = planes_.outcome[s + lane];
      const bool stationary = (is_stationary >> lane & 1U) != 0;
      if ((is_sound >> lane & 1U) == 0 || stationary != (outcome == kConverged)) outcome = kLeft;
      if (outcome != kLeft) taken |= 1U << lane;
    }
    const M which = L::mask(taken);
    each_coordinate([&](auto c) ASTERISM_IN_KERNEL {
      L::store(planes_.x + c * stride_ + s, L::select(which, x[c], start[c]));
    });
    L::store(planes_.initial_energy + s, initial);
    L::store(planes_.final_energy + s, energy);
    L::store(planes_.stationarity + s, ratio * L::set(tolerance_));
  }

  /// The lower bound of certificate.hpp at x, from the factors L D L^T of W; 0 if W is not positive definite.
  /// kSlack allows for inverses and roots with errors of a few epsilon, and for a node that has every link.
  ASTERISM_KERNEL void prove(std::ptrdiff_t s) const {
    constexpr T kSlack = 4 * R::kEpsilon;
    const V zero = L::set(0), half = L::set(T(0.5));
    const T n = static_cast<T>(nodes()), terms = static_cast<T>(links() + 2);
    V x[kSize], g[kSize], scale[kNodes], force[kNodes];
    V W[kNodes * (kNodes + 1) / 2];
    const auto at = [](auto row, auto column) ASTERISM_IN_KERNEL { return row * (row + 1) / 2 + column; };
    V energy = zero, rounding = zero;
    M good = L::mask(kAll);
    each_node([&](auto i) ASTERISM_IN_KERNEL {
      const V k = plane(planes_.anchor_stiffness, i, s);
      const M held = L::less(zero, k);
      V reach = zero;
      unroll<0, kDim>([&](auto d) ASTERISM_IN_KERNEL {
        const int c = kDim * i + d;
        x[c] = plane(planes_.x, c, s);
        const V e = x[c] - L::select(held, plane(planes_.anchors, c, s), x[c]);
        g[c] = k * e;
        energy = L::fma(half * g[c], e, energy);
        reach = reach + L::abs(e);
      });
      force[i] = k * reach;
      scale[i] = k;
      for (int j = 0; j < i; ++j) W[at(static_cast<int>(i), j)] = zero;
      W[at(static_cast<int>(i), static_cast<int>(i))] = k;
    });
    rounding = L::set(4) * energy;
    each_link([&](auto l, auto i, auto j) ASTERISM_IN_KERNEL {
      const V k = plane(planes_.link_stiffness, l, s);
      const V mu = L::select(L::less(zero, k), plane(planes_.rest_length, l, s), zero);
      V d[kDim];
      V square = zero;
      unroll<0, kDim>([&](auto c) ASTERISM_IN_KERNEL {
        d[c] = x[kDim * i + c] - x[kDim * j + c];
        square = L::fma(d[c], d[c], square);
      });
      good = L::both(good, L::less(L::set(R::kTiny), square));
      const V inverse = L::inverse_sqrt(square);
      const V length = square * inverse, reach = k * (length + mu);
      const V pressure = k * (mu * inverse);
      const V w = k - pressure;
      const V stretch = length - mu;
      const V tension = k * stretch;
      energy = L::fma(half * tension, stretch, energy);
      rounding = L::fma(L::set(8) * (L::abs(tension) + L::set(R::kEpsilon) * reach), length + mu, rounding);
      const int low = i < j ? int(i) : int(j), high = i < j ? int(j) : int(i);
      W[at(high, low)] = W[at(high, low)] - w;
      const auto add = [&](int end) ASTERISM_IN_KERNEL {
        W[at(end, end)] = W[at(end, end)] + w;
        scale[end] = scale[end] + (k + pressure);
        force[end] = force[end] + reach;
      };
      add(i), add(j);
      unroll<0, kDim>([&](auto c) ASTERISM_IN_KERNEL {
        g[kDim * i + c] = L::fma(w, d[c], g[kDim * i + c]);
        g[kDim * j + c] = L::fnma(w, d[c], g[kDim * j + c]);
      });
    });
    rounding = L::set(kSlack) * L::fma(L::set(n + static_cast<T>(links())), energy, rounding);

    // Factors M = W - 2 shift scale, with 1 / D on the diagonal, and computes g^T M^-1 g in the same sweep.
    const V shift = L::set(kSlack * (n * (n + 3) + terms + 16));
    each_node([&](auto i) ASTERISM_IN_KERNEL {
      V& pivot = W[at(static_cast<int>(i), static_cast<int>(i))];
      pivot = L::fnma(shift + shift, scale[i], pivot);
    });
    V square = zero;
    for (int j = 0; j < nodes(); ++j) {
      good = L::both(good, L::less(L::set(R::kTiny), W[at(j, j)]));
      const V inverse = W[at(j, j)] = L::inverse(W[at(j, j)]);
      unroll<0, kDim>([&](auto c) ASTERISM_IN_KERNEL {
        square = L::fma(g[kDim * j + c] * inverse, g[kDim * j + c], square);
      });
      for (int k = j + 1; k < nodes(); ++k) {
        const V factor = W[at(k, j)] * inverse;
        for (int i = k; i < nodes(); ++i) W[at(i, k)] = L::fnma(factor, W[at(i, j)], W[at(i, k)]);
        unroll<0, kDim>([&](auto c) ASTERISM_IN_KERNEL {
          g[kDim * k + c] = L::fnma(factor, g[kDim * j + c], g[kDim * k + c]);
        });
      }
      for (int i = j + 1; i < nodes(); ++i) W[at(i, j)] = W[at(i, j)] * inverse;
    }
    V trace = zero;  // the trace of M^-1
    for (int column = 0; column < nodes(); ++column) {
      V v[kNodes];
      v[column] = L::set(1);
      for (int i = column + 1; i < nodes(); ++i) v[i] = zero - W[at(i, column)];
      trace = trace + W[at(column, column)];
      for (int j = column + 1; j < nodes(); ++j) {
        trace = L::fma(v[j] * W[at(j, j)], v[j], trace);
        for (int i = j + 1; i < nodes(); ++i) v[i] = L::fnma(v[j], W[at(i, j)], v[i]);
      }
    }
    // What the gradient's rounding adds, measured by W >= shift scale or by W >= 1 / trace.
    V scaled = zero, plain = zero;
    each_node([&](auto i) ASTERISM_IN_KERNEL {
      const V f = L::set(kSlack * (8 + terms)) * force[i];
      scaled = L::fma(f * L::inverse(shift * scale[i]), f, scaled);
      plain = L::fma(f * (L::set(T(1.02)) * trace), f, plain);
    });
    const V norm = L::sqrt(square) * L::set(T(1) + T(1e-6)) + L::sqrt(L::min(scaled, plain));
    const V bound = energy - half * norm * norm - rounding;
    good = L::both(good, L::less(zero, bound));
    L::store(planes_.lower_bound + s, L::select(good, bound, zero));
  }

  const Planes<T>& planes_;
  T tolerance_;
  T flat_share_;
  T max_iterations_;
  bool align_;
  T *final_x_, *rounding_, *reach_, *floor_, *mode_, *energy_before_, *extent_, *short_step_;
};

// Each fixed size takes seconds to compile. x86 processors without AVX2 are older than 2013: for them only
// the size that DPT uses is compiled.
#if defined(__SSE2__) && !defined(ASTERISM_LANES_AVX2) && !defined(ASTERISM_LANES_AVX512)
constexpr bool kFourPartsAlone = true;
#else
constexpr bool kFourPartsAlone = false;
#endif

template <typename L, int kDim, int kFixed>
constexpr Kernels<typename L::T> kKernelsOf{&LaneNewton<L, kDim, kFixed>::solve,
                                            &LaneSensitivity<L, kDim, kFixed>::differentiate};

/// The kernels for a topology: those of its fixed size, if there are any, else the general ones.
template <typename L, int kDim>
Kernels<typename L::T> kernels_of(int nodes, int link_count, bool is_full) {
  if constexpr (kFourPartsAlone) {
    if constexpr (kDim == 2) {
      if (is_full && nodes == 4) return kKernelsOf<L, kDim, 4>;
    }
  } else if (is_full) {
    switch (kDim * nodes) {
      case kDim * 2:
        return kKernelsOf<L, kDim, 2>;
      case kDim * 3:
        return kKernelsOf<L, kDim, 3>;
      case kDim * 4:
        return kKernelsOf<L, kDim, 4>;
      default:
        break;
    }
    if constexpr (kDim == 2) {
      if (nodes == 5) return kKernelsOf<L, kDim, 5>;
      if (nodes == 6) return kKernelsOf<L, kDim, 6>;
    }
  }
  if (nodes < 1 || kDim * nodes > kMostCoordinates || link_count > kMostLinks) return {};
  return kKernelsOf<L, kDim, 0>;
}

template <typename L>
Kernels<typename L::T> kernels_for(int dim, int nodes, int link_count, bool is_full) {
  if (dim == 2) return kernels_of<L, 2>(nodes, link_count, is_full);
  if (dim == 3) return kernels_of<L, 3>(nodes, link_count, is_full);
  return {};
}

constexpr KernelSet kKernels{&kernels_for<FloatLanes>, &kernels_for<DoubleLanes>};

}  // namespace
}  // namespace asterism::lanes_v0_1
