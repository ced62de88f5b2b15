#pragma once

// What the batch kernels share: the systems of the lanes, one per lane, their Hessians and the factors of
// these.
#include <utility>  // types alone

#include "batch_lanes.hpp"

// Kernels, and what is inlined into them. GCC inlines always_inline functions level by level, and optimises
// each level again, which takes a third of all the time; flatten inlines all levels at once. In clang, it
// inlines one level alone.
#if defined(__GNUC__) && !defined(__clang__)
#define ASTERISM_KERNEL [[gnu::noinline, gnu::flatten]]
#define ASTERISM_IN_KERNEL
#define ASTERISM_UNROLL _Pragma("GCC unroll 16")
#else
#define ASTERISM_KERNEL [[gnu::noinline]]
#define ASTERISM_IN_KERNEL __attribute__((always_inline))
#define ASTERISM_UNROLL _Pragma("unroll")
#endif

namespace asterism::lanes_v0_1 {
namespace {

template <int k>
struct Index {
  [[gnu::always_inline]] constexpr operator int() const { return k; }
};

template <int kFrom, typename F, int... k>
ASTERISM_IN_KERNEL inline void call_each(F&& f, std::integer_sequence<int, k...>) {
  (f(Index<kFrom + k>()), ...);
}

/// f(Index<kFrom>()), ..., f(Index<kTo - 1>()).
template <int kFrom, int kTo, typename F>
ASTERISM_IN_KERNEL inline void unroll(F&& f) {
  call_each<kFrom>(static_cast<F&&>(f), std::make_integer_sequence<int, (kFrom < kTo ? kTo - kFrom : 0)>());
}

template <typename T>
struct Real;
template <>
struct Real<double> {
  static constexpr double kEpsilon = __DBL_EPSILON__;
  static constexpr double kTiny = __DBL_MIN__ / __DBL_EPSILON__;
  static constexpr double kMax = __DBL_MAX__;
  static constexpr double kCoincident = 1e100;  // nodes coincide if mu / r is at least this
};
template <>
struct Real<float> {
  static constexpr float kEpsilon = __FLT_EPSILON__;
  static constexpr float kTiny = __FLT_MIN__ / __FLT_EPSILON__;
  static constexpr float kMax = __FLT_MAX__;
  static constexpr float kCoincident = 1e10F;
};

/// The largest systems that the kernels without a fixed size take.
constexpr int kMostCoordinates = 30;
constexpr int kMostLinks = 120;

/// `kFixed` nodes, every pair linked; if 0, any topology within kMostCoordinates and kMostLinks.
template <typename L, int kDim, int kFixed>
class LaneSystem {
 protected:
  using T = typename L::T;
  using V = typename L::V;
  using M = typename L::M;
  using R = Real<T>;

  static constexpr bool kFull = kFixed > 0;
  static constexpr int kLanes = L::kLanes;
  static constexpr int kNodes = kFull ? kFixed : kMostCoordinates / kDim;
  static constexpr int kSize = kDim * kNodes;
  static constexpr int kLinks = kFull ? kFixed * (kFixed - 1) / 2 : kMostLinks;
  static constexpr int kHessian = kFull ? kSize * (kSize + 1) : kSize * (kSize + 3) / 2;
  static constexpr unsigned kAll = static_cast<unsigned>((1ULL << kLanes) - 1);
  static constexpr T kRounding = 8 * R::kEpsilon;

  explicit LaneSystem(const SystemPlanes<T>& system)
      : system_(system), stride_(system.stride), nodes_(system.nodes), links_(system.link_count) {}

  // Sizes, known to the compiler where they are fixed.
  [[gnu::always_inline]] int nodes() const {
    if constexpr (kFull) return kNodes;
    return nodes_;
  }
  [[gnu::always_inline]] int size() const { return kDim * nodes(); }
  [[gnu::always_inline]] int links() const {
    if constexpr (kFull) return kLinks;
    return links_;
  }

  template <int kFrom = 0, typename F>
  ASTERISM_IN_KERNEL void each_node(F&& f) const {
    if constexpr (kFull) {
      unroll<kFrom, kNodes>(static_cast<F&&>(f));
    } else {
      for (int i = kFrom; i < nodes_; ++i) f(i);
    }
  }
  template <typename F>
  ASTERISM_IN_KERNEL void each_coordinate(F&& f) const {
    if constexpr (kFull) {
      unroll<0, kSize>(static_cast<F&&>(f));
    } else {
      for (int i = 0; i < size(); ++i) f(i);
    }
  }
  // Calls f(link, i, j) with the link's two nodes.
  template <typename F>
  ASTERISM_IN_KERNEL void each_link(F&& f) const {
    if constexpr (kFull) {
      unroll<0, kNodes>([&](auto i) ASTERISM_IN_KERNEL {
        unroll<i + 1, kNodes>(
            [&](auto j) ASTERISM_IN_KERNEL { f(Index<i * kNodes - i*(i + 1) / 2 + j - i - 1>(), i, j); });
      });
    } else {
      for (int l = 0; l < links_; ++l) f(l, system_.ends[2 * l], system_.ends[2 * l + 1]);
    }
  }

  [[gnu::always_inline]] V plane(const T* planes, int which, std::ptrdiff_t s) const {
    return L::load(planes + which * stride_ + s);
  }

  /// characteristic_length of stationarity.hpp; 0 if the springs do not determine it.
  ASTERISM_IN_KERNEL V length(std::ptrdiff_t s, const V* a, const V* k, const V* stiffness, V link_total,
                              V strongest) const {
    const V zero = L::set(0), one = L::set(1);
    const M no_links = L::at_most(link_total, zero);
    V counted[kNodes];  // k, 0 for a node without links beside others
    each_node([&](auto i) ASTERISM_IN_KERNEL {
      counted[i] = L::select(L::either(no_links, L::less(k[i], stiffness[i])), k[i], zero);
      strongest = L::max(counted[i], strongest);
    });
    // SpringWeight
    const V full = L::set(T(1e-4)) * strongest;
    const V inverse_full = L::inverse(full);
    const auto weight_of = [&](V kl) ASTERISM_IN_KERNEL {
      return L::select(L::less(zero, kl), L::select(L::at_most(full, kl), one, kl * inverse_full), zero);
    };
    V total = zero;
    V centroid[kDim];
    unroll<0, kDim>([&](auto d) ASTERISM_IN_KERNEL { centroid[d] = zero; });
    each_node([&](auto i) ASTERISM_IN_KERNEL {
      counted[i] = weight_of(counted[i]);
      total = total + counted[i];
      unroll<0, kDim>(
          [&](auto d) ASTERISM_IN_KERNEL { centroid[d] = L::fma(counted[i], a[kDim * i + d], centroid[d]); });
    });
    const V inverse_total = L::inverse(total);
    unroll<0, kDim>([&](auto d) ASTERISM_IN_KERNEL { centroid[d] = centroid[d] * inverse_total; });
    V square = zero;
    each_node([&](auto i) ASTERISM_IN_KERNEL {
      V distance = zero;
      unroll<0, kDim>([&](auto d) ASTERISM_IN_KERNEL {
        const V e = a[kDim * i + d] - centroid[d];
        distance = L::fma(e, e, distance);
      });
      square = square + L::select(L::less(zero, counted[i]), counted[i] * distance, zero);
    });
    each_link([&](auto l, auto, auto) ASTERISM_IN_KERNEL {
      const V weight = weight_of(plane(system_.link_stiffness, l, s));
      const V mu = L::select(L::less(zero, weight), plane(system_.rest_length, l, s), zero);
      total = total + weight;
      square = L::fma(weight, mu * mu, square);
    });
    return L::sqrt(square * L::inverse(total));
  }

  // An entry of H on or below the diagonal. Above it, where the size is fixed, factors are stored.
  template <typename Row, typename Column>
  [[gnu::always_inline]] V& at(V* h, Row row, Column column) const {
    if constexpr (kFull) {
      return h[column * (kSize + 1) + row];
    } else {
      return h[column * (size() + 1) - column * (column - 1) / 2 + row - column];
    }
  }

  struct Assembled {
    V twice;  // the energy
    V most;   // the greatest mu / r
  };

  /// Energy, gradient g and Hessian h of springs s (a, k, mu, kl) at x. mu / r in the curvature across
  /// springs is limited to `limit`: 1 clamps the curvature at zero, a huge one does nothing. Calls
  /// on_link(link, r^2, 1 / r, r - mu).
  template <typename Springs, typename Coordinates, typename OnLink>
  ASTERISM_IN_KERNEL Assembled assemble(const Springs& s, const Coordinates& x, V limit, V* h, V* g,
                                        OnLink&& on_link) const {
    const int n = size();
    V twice = L::set(0);
    if constexpr (!kFull) {
      for (int e = 0; e < n * (n + 3) / 2; ++e) h[e] = L::set(0);
    }
    each_node([&](auto i) ASTERISM_IN_KERNEL {
      unroll<0, kDim>([&](auto d) ASTERISM_IN_KERNEL {
        const int c = kDim * i + d;
        const V e = x[c] - s.a[c];
        g[c] = s.k[i] * e;
        twice = L::fma(g[c], e, twice);
        unroll<0, kDim>([&](auto r) ASTERISM_IN_KERNEL {
          if constexpr (r >= d) at(h, kDim * i + r, c) = r == d ? s.k[i] : L::set(0);
        });
      });
    });
    V most = L::set(0);  // the greatest mu / r
    each_link([&](auto l, auto i, auto j) ASTERISM_IN_KERNEL {
      const V k = s.kl[l], mu = s.mu[l];
      V d[kDim];
      V square = L::set(0);
      unroll<0, kDim>([&](auto c) ASTERISM_IN_KERNEL {
        d[c] = x[kDim * i + c] - x[kDim * j + c];
        square = c == 0 ? d[c] * d[c] : L::fma(d[c], d[c], square);
      });
      const V inverse = L::inverse_sqrt(L::max(square, L::set(R::kTiny)));
      const V ratio = mu * inverse;
      most = L::max(most, ratio);
      const V stretch = L::fma(square, inverse, L::set(0) - mu);
      twice = L::fma(k * stretch, stretch, twice);
      on_link(l, square, inverse, stretch);
      const V pull = L::fnma(k, ratio, k);  // k (1 - mu / r)
      const V bend = k * L::min(ratio, limit);
      const V across = k - bend;
      V u[kDim];
      unroll<0, kDim>([&](auto c) ASTERISM_IN_KERNEL { u[c] = d[c] * inverse; });
      unroll<0, kDim>([&](auto c) ASTERISM_IN_KERNEL {
        g[kDim * i + c] = L::fma(pull, d[c], g[kDim * i + c]);
        g[kDim * j + c] = L::fnma(pull, d[c], g[kDim * j + c]);
        const V b = bend * u[c];
        unroll<0, kDim>([&](auto r) ASTERISM_IN_KERNEL {
          if constexpr (r >= c) {
            // The off-diagonal block; the link adds its negative to both diagonal blocks.
            const V value = r == c ? L::fnms(b, u[r], across) : L::set(0) - b * u[r];
            at(h, kDim * i + r, kDim * i + c) = at(h, kDim * i + r, kDim * i + c) - value;
            at(h, kDim * j + r, kDim * j + c) = at(h, kDim * j + r, kDim * j + c) - value;
            if constexpr (kFull) {
              at(h, kDim * j + r, kDim * i + c) = value;
              if constexpr (r != c) at(h, kDim * j + c, kDim * i + r) = value;
            } else {
              const int low = kDim * (i < j ? i : j), high = kDim * (i < j ? j : i);
              at(h, high + r, low + c) = at(h, high + r, low + c) + value;
              if constexpr (r != c) at(h, high + c, low + r) = at(h, high + c, low + r) + value;
            }
          }
        });
      });
    });
    return {twice, most};
  }

  struct Solution {
    V decrement;  // right^T H^-1 right; of the gradient the square of the Newton decrement
    M definite;   // every pivot is above its rounding
    V flattest;   // the greatest ratio of a pivot's rounding to the pivot
  };

  /// result = H^-1 g by L D L^T, as in NewtonMatrix, with pivots repaired where they are not above
  /// `rounding`, one for each node. Overwrites h and g.
  ASTERISM_IN_KERNEL Solution solve_linear(V* h, V* g, const V* rounding, V* result) const {
    const int n = size();
    M definite = L::mask(kAll);
    V flattest = L::set(0);
    V inverse_pivot[kSize];
    V decrement = L::set(0);
    const auto pivot = [&](auto c) ASTERISM_IN_KERNEL {
      const V least = rounding[c / kDim];
      const V value = at(h, c, c);
      definite = L::both(definite, L::less(least, value));
      inverse_pivot[c] = L::inverse(L::max(L::abs(value), least));
      flattest = L::max(least * inverse_pivot[c], flattest);
      return inverse_pivot[c];
    };
    if constexpr (kFull) {
      unroll<0, kSize>([&](auto c) ASTERISM_IN_KERNEL {
        const V inverse = pivot(c);
        unroll<c + 1, kSize>([&](auto j) ASTERISM_IN_KERNEL {
          const V factor = at(h, j, c) * inverse;
          // A loop: as calls, these are most of what there is to inline.
          ASTERISM_UNROLL for (int i = j; i < kSize; ++i) {
            at(h, i, j) = L::fnma(factor, at(h, i, c), at(h, i, j));
          }
          g[j] = L::fnma(factor, g[c], g[j]);
          at(h, c, j) = factor;
        });
      });
      unroll<0, kSize>([&](auto back) ASTERISM_IN_KERNEL {
        constexpr int c = kSize - 1 - back;
        V value = g[c] * inverse_pivot[c];
        decrement = L::fma(g[c], value, decrement);
        unroll<0, kSize - 1 - c>([&](auto m) ASTERISM_IN_KERNEL {
          constexpr int i = kSize - 1 - m;
          value = L::fnma(at(h, Index<c>(), Index<i>()), result[i], value);
        });
        result[c] = value;
      });
    } else {
      for (int c = 0; c < n; ++c) {
        const V inverse = pivot(c);
        const V* pivot_column = &at(h, c, c) - c;
        for (int j = c + 1; j < n; ++j) {
          const V factor = pivot_column[j] * inverse;
          V* column = &at(h, j, j) - j;
          for (int i = j; i < n; ++i) column[i] = L::fnma(factor, pivot_column[i], column[i]);
          g[j] = L::fnma(factor, g[c], g[j]);
        }
      }
      for (int c = n - 1; c >= 0; --c) {
        V value = g[c];
        decrement = L::fma(value * value, inverse_pivot[c], decrement);
        const V* column = &at(h, c, c) - c;
        for (int i = n - 1; i > c; --i) value = L::fnma(column[i], result[i], value);
        result[c] = value * inverse_pivot[c];
      }
    }
    return {decrement, definite, flattest};
  }

  const SystemPlanes<T>& system_;
  std::ptrdiff_t stride_;
  int nodes_;
  int links_;
};

}  // namespace
}  // namespace asterism::lanes_v0_1
