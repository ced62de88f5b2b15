#pragma once

// Reverse mode of sensitivity.hpp for several solutions at once, one per SIMD lane. A lane computes where
// every test of Sensitivity is passed with room to spare; all other systems are left to it, which also says
// why a solution has no derivatives. Verdicts therefore do not depend on the lanes.
#include "batch_system.hpp"

namespace asterism::lanes_v0_1 {
namespace {

/// Derivatives of solutions of systems as in LaneSystem, connected and of at least two nodes.
template <typename L, int kDim, int kFixed>
class LaneSensitivity : LaneSystem<L, kDim, kFixed> {
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
  using Base::nodes;
  using Base::plane;
  using Base::stride_;
  using typename Base::M;
  using typename Base::R;
  using typename Base::T;
  using typename Base::V;

  // Limits of Sensitivity times these are passed whatever the order of a sum.
  static constexpr T kStationary = T(0.5);
  static constexpr T kPivot = T(1) / 64;
  static constexpr T kApart = 8;
  static constexpr T kHold = 512 * R::kEpsilon;
  static constexpr T kRoom = 1 << 20;  // below the range's end

 public:
  /// The systems first, ..., last - 1.
  static void differentiate(const GradientPlanes<T>& planes, double stationarity, std::ptrdiff_t first,
                            std::ptrdiff_t last) {
    const LaneSensitivity self(planes, stationarity);
    for (std::ptrdiff_t s = first; s < last; s += kLanes) self.differentiate(s);
  }

 private:
  LaneSensitivity(const GradientPlanes<T>& planes, double stationarity) : Base(planes), planes_(planes) {
    constexpr T kLeast = 64 * R::kEpsilon;  // as StoppingRule
    tolerance_ = static_cast<T>(stationarity);
    if (!(tolerance_ >= kLeast)) tolerance_ = kLeast;
    tolerance_ *= kStationary;
  }

  struct Springs {
    V a[kSize];
    V k[kNodes];
    V mu[kLinks];
    V kl[kLinks];
  };

  // There are more planes than a processor's own prefetchers follow.
  ASTERISM_IN_KERNEL void prefetch(std::ptrdiff_t s) const {
    constexpr int kAhead = 64;  // systems
    constexpr int kPerLine = 64 / sizeof(T);
    if (s % kPerLine != 0) return;
    const auto fetch = [&](const T* planes, int which)
                           ASTERISM_IN_KERNEL { __builtin_prefetch(planes + which * stride_ + s + kAhead); };
    each_coordinate([&](auto c) ASTERISM_IN_KERNEL {
      fetch(planes_.x, c);
      fetch(planes_.anchors, c);
      fetch(planes_.grad_x, c);
    });
    each_node([&](auto i) ASTERISM_IN_KERNEL { fetch(planes_.anchor_stiffness, i); });
    each_link([&](auto l, auto, auto) ASTERISM_IN_KERNEL {
      fetch(planes_.rest_length, l);
      fetch(planes_.link_stiffness, l);
    });
  }

  // Whatever is not finite fails a comparison below, or makes a result that is not.
  ASTERISM_KERNEL void differentiate(std::ptrdiff_t s) const {
    prefetch(s);
    const V zero = L::set(0);
    Springs springs;
    V x[kSize], right[kSize], stiffness[kNodes];
    V least = L::set(R::kMax), strongest = zero, link_total = zero, farthest = zero;
    each_node([&](auto i) ASTERISM_IN_KERNEL {
      springs.k[i] = stiffness[i] = plane(planes_.anchor_stiffness, i, s);
      least = L::min(springs.k[i], least);
      V square = zero;
      unroll<0, kDim>([&](auto d) ASTERISM_IN_KERNEL {
        const int c = kDim * i + d;
        x[c] = plane(planes_.x, c, s);
        springs.a[c] = plane(planes_.anchors, c, s);
        right[c] = plane(planes_.grad_x, c, s);
        square = L::fma(x[c], x[c], square);
      });
      farthest = L::max(square, farthest);
    });
    M good = L::mask(kAll);
    each_link([&](auto l, auto i, auto j) ASTERISM_IN_KERNEL {
      const V k = springs.kl[l] = plane(planes_.link_stiffness, l, s);
      springs.mu[l] = plane(planes_.rest_length, l, s);
      least = L::min(k, least);
      good = L::both(good, L::at_most(zero, springs.mu[l]));
      stiffness[i] = stiffness[i] + k;
      stiffness[j] = stiffness[j] + k;
      link_total = link_total + k;
      strongest = L::max(k, strongest);
    });
    good = L::both(good, L::less(zero, least));
    const V length = this->length(s, springs.a, springs.k, stiffness, link_total, strongest);

    V h[kHessian], g[kSize];
    V inverse_length[kLinks], stretch[kLinks];
    const V extent = L::fma(length, length, L::set(2) * farthest);
    const V apart = L::max(L::set(kApart * kRounding * kRounding) * extent, L::set(kApart * R::kTiny));
    this->assemble(springs, x, L::set(R::kMax), h, g,
                   [&](auto l, V square, V inverse, V difference) ASTERISM_IN_KERNEL {
                     good = L::both(good, L::less(apart, square));
                     inverse_length[l] = inverse;
                     stretch[l] = difference;
                   });

    // |g_i| <= tolerance A_ii L, without overflow or underflow
    const V reach = L::set(tolerance_) * length;
    V rounding[kNodes];
    each_node([&](auto i) ASTERISM_IN_KERNEL {
      rounding[i] = L::set(kRounding) * stiffness[i];
      V square = zero;
      unroll<0, kDim>([&](auto d)
                          ASTERISM_IN_KERNEL { square = L::fma(g[kDim * i + d], g[kDim * i + d], square); });
      const V force = reach * stiffness[i];
      const V most = force * force;
      good = L::both(good, L::both(L::at_most(square, most), L::less(most, L::set(R::kMax))));
      good = L::both(good, L::less(L::set(R::kTiny), most));
    });
    good = L::both(good, L::less(zero, hold(springs, stiffness, x)));

    V lambda[kSize];
    const auto factors = this->solve_linear(h, right, rounding, lambda);
    good = L::both(good, L::both(factors.definite, L::less(factors.flattest, L::set(kPivot))));

    V finite = zero;
    const V room = L::set(kRoom);
    const auto put = [&](T* values, int which, V value) ASTERISM_IN_KERNEL {
      finite = L::fma(room * value, zero, finite);
      L::store(values + which * stride_ + s, value);
    };
    each_node([&](auto i) ASTERISM_IN_KERNEL {
      V work = zero;
      unroll<0, kDim>([&](auto d) ASTERISM_IN_KERNEL {
        const int c = kDim * i + d;
        put(planes_.by_anchors, c, springs.k[i] * lambda[c]);
        work = L::fma(lambda[c], springs.a[c] - x[c], work);
      });
      put(planes_.by_anchor_stiffness, i, work);
    });
    each_link([&](auto l, auto i, auto j) ASTERISM_IN_KERNEL {
      V apart_by = zero;  // how fast lambda moves the ends apart
      unroll<0, kDim>([&](auto d) ASTERISM_IN_KERNEL {
        apart_by =
            L::fma(x[kDim * i + d] - x[kDim * j + d], lambda[kDim * i + d] - lambda[kDim * j + d], apart_by);
      });
      apart_by = apart_by * inverse_length[l];
      put(planes_.by_rest_length, l, springs.kl[l] * apart_by);
      put(planes_.by_link_stiffness, l, zero - stretch[l] * apart_by);
    });
    good = L::both(good, L::at_most(finite, zero));
    const unsigned computed = L::bits(good);
    for (int lane = 0; lane < kLanes; ++lane) {
      planes_.outcome[s + lane] = (computed >> lane & 1U) != 0 ? kConverged : kLeft;
    }
  }

  /// hold_of_body of free_motion.hpp, less what is rounding beside the links' stiffness: where anchors hold a
  /// rotation by little more than that, rounding decides whether the Hessian is positive definite.
  ASTERISM_IN_KERNEL V hold(const Springs& springs, const V* stiffness, const V* x) const {
    const V zero = L::set(0), half = L::set(T(0.5));
    V total = zero;
    V anchor_centre[kDim], centre[kDim];
    unroll<0, kDim>([&](auto d) ASTERISM_IN_KERNEL { anchor_centre[d] = centre[d] = zero; });
    each_node([&](auto i) ASTERISM_IN_KERNEL {
      const V k = springs.k[i];
      total = total + k;
      unroll<0, kDim>([&](auto d) ASTERISM_IN_KERNEL {
        anchor_centre[d] = L::fma(k, springs.a[kDim * i + d], anchor_centre[d]);
        centre[d] = L::fma(k, x[kDim * i + d], centre[d]);
      });
    });
    const V inverse = L::inverse(total);
    unroll<0, kDim>([&](auto d) ASTERISM_IN_KERNEL {
      anchor_centre[d] = anchor_centre[d] * inverse;
      centre[d] = centre[d] * inverse;
    });
    V m[kDim * kDim];  // in the plane its diagonal alone
    unroll<0, kDim * kDim>([&](auto e) ASTERISM_IN_KERNEL { m[e] = zero; });
    V size = zero, body = zero;
    each_node([&](auto i) ASTERISM_IN_KERNEL {
      const V k = springs.k[i];
      V q[kDim], p[kDim];
      V square = zero, anchor_square = zero;
      unroll<0, kDim>([&](auto d) ASTERISM_IN_KERNEL {
        q[d] = springs.a[kDim * i + d] - anchor_centre[d];
        p[d] = x[kDim * i + d] - centre[d];
        square = L::fma(p[d], p[d], square);
        anchor_square = L::fma(q[d], q[d], anchor_square);
      });
      size = L::fma(k, square + anchor_square, size);
      body = L::fma(stiffness[i], square, body);
      unroll<0, kDim>([&](auto r) ASTERISM_IN_KERNEL {
        const V weighted = k * q[r];
        unroll<0, kDim>([&](auto c) ASTERISM_IN_KERNEL {
          if constexpr (kDim == 3 || r == c) m[kDim * r + c] = L::fma(weighted, p[c], m[kDim * r + c]);
        });
      });
    });
    size = half * size;
    const V margin = L::fma(L::set(T(1e-4)), size, L::set(kHold) * body);
    if constexpr (kDim == 2) {
      return m[0] + m[3] - margin;
    } else {
      const V xy = half * (m[1] + m[3]), xz = half * (m[2] + m[6]), yz = half * (m[5] + m[7]);  // negated
      const V xx = m[4] + m[8], yy = m[0] + m[8], zz = m[0] + m[4];
      const V two = L::fnma(xy, xy, xx * yy);
      const V three = two * zz - xx * yz * yz - yy * xz * xz - L::set(2) * xy * xz * yz;
      return L::min(L::min(xx - margin, L::fnma(margin, size, two)), L::fnma(margin * size, size, three));
    }
  }

  const GradientPlanes<T>& planes_;
  T tolerance_;
};

}  // namespace
}  // namespace asterism::lanes_v0_1
