#pragma once

#include <algorithm>
#include <array>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/base/numbers.hpp>
#include <asterism/solver/energy/full_links.hpp>
#include <asterism/solver/energy/spring_element.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>
#include <type_traits>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// The linear system H p = g of a Newton step. H's columns, from the diagonal down, are factored in place to
/// those of L D, where L D L^T = H + repair; the elimination runs over g too and so does the forward
/// substitution. Where the size is neither fixed nor small, g borders H as one more row.
template <typename System>
class NewtonMatrix {
 public:
  using Scalar = typename System::Scalar;
  using Point = typename System::Point;
  using Points = typename System::Points;

  /// Takes the size and, from the nodes' stiffness, the rounding of the pivots.
  void reset(const typename System::NodeVector& stiffness) {
    size_ = kDim * static_cast<int>(stiffness.size());
    if constexpr (kMaxSize == Eigen::Dynamic) {
      const auto size = static_cast<std::size_t>(size_);
      if (inverse_pivots_.size() != size) require_memory(double(sizeof(Scalar)) * size_ * (size_ + 1.0));
      values_.resize(size * (size + 1));
      inverse_pivots_.resize(size);
    }
    rounding_ = kRounding * stiffness;
  }

  /// Writes energy, gradient and Hessian at x. With `clamp`, negative curvatures count as 0, as that of a
  /// short spring across its axis, k_ij (1 - mu_ij / r_ij): the matrix is not the Hessian then, but positive
  /// definite.
  Scalar assemble(const System& system, const Points& x, bool clamp, Points& gradient) {
    Scalar energy = 0;
    if (!assemble_full(system, x, clamp, gradient, energy)) {
      energy = assemble_links(system, x, clamp, gradient);
    }
    if (system.fixed_count() != 0) [[unlikely]]
      isolate_fixed(system, gradient);
    if constexpr (kUnrolled) {
      Eigen::Map<Points>(right_.data()) = gradient;
    } else {
      for (int k = 0; k < size(); ++k) at(size(), k) = gradient.data()[k];
    }
    return energy;
  }

  /// L D L^T without pivoting. A pivot that is negative is replaced by its absolute value, one that is
  /// rounding alone by the node's stiffness; true if there was none, that is if the matrix is positive
  /// definite.
  [[gnu::flatten]] bool factorize() {
    repaired_ = false;
    negative_ = -1;
    most_negative_ = -1;
    if constexpr (kUnrolled) {
      unroll<0, kSize / 2>([this](auto pair) { this->template eliminate_pair<2 * pair>(); });
      if constexpr (kSize % 2 == 1) inverse_pivots_[kSize - 1] = 1 / repair(kSize - 1);
    } else {
      for (int k = 0; k < size(); ++k) {
        inverse_pivots_[static_cast<std::size_t>(k)] = 1 / repair(k);
        for (int j = k + 1; j < size(); ++j) subtract(k, j);
      }
    }
    return !repaired_;
  }

  /// p of (L D L^T) p = g into `step`; returns g . p, Newton's decrement squared.
  Scalar solve(Points& step) const {
    step.resize(kDim, size() / kDim);
    Scalar* p = step.data();
    Scalar decrement = 0;
    const auto substitute = [&](int k) {
      const Scalar* column = &at(0, k);
      const Scalar inverse = inverse_pivots_[static_cast<std::size_t>(k)];
      Scalar value = right(k) * inverse;
      decrement += right(k) * value;
      // The column is divided by its pivot here, where no p is waited for.
      for (int i = size() - 1; i > k; --i) value -= (column[i] * inverse) * p[i];
      p[k] = value;
    };
    if constexpr (kUnrolled) {
      unroll<0, kSize>([&](auto k) { substitute(kSize - 1 - k); });
    } else {
      for (int k = size() - 1; k >= 0; --k) substitute(k);
    }
    return decrement;
  }

  /// p of (L D L^T) p = right, for another right-hand side than g.
  [[gnu::flatten]] void solve(const Points& right, Points& p) const {
    p = right;
    Scalar* const values = p.data();
    const auto eliminate = [&](auto k) {
      const Scalar* column = &at(0, k);
      const Scalar scaled = values[k] * inverse_pivots_[static_cast<std::size_t>(k)];
      for (int i = k + 1; i < size(); ++i) values[i] -= column[i] * scaled;
    };
    const auto substitute = [&](auto k) {
      const Scalar* column = &at(0, k);
      const Scalar inverse = inverse_pivots_[static_cast<std::size_t>(k)];
      Scalar value = values[k] * inverse;
      for (int i = size() - 1; i > k; --i) value -= (column[i] * inverse) * values[i];
      values[k] = value;
    };
    if constexpr (kUnrolled) {
      unroll<0, kSize>(eliminate);
      unroll<0, kSize>([&](auto k) { substitute(std::integral_constant<int, kSize - 1 - k>()); });
    } else {
      for (int k = 0; k < size(); ++k) eliminate(k);
      for (int k = size() - 1; k >= 0; --k) substitute(k);
    }
  }

  /// The least pivot beside its node's stiffness, of a matrix that is positive definite.
  Scalar least_pivot() const {
    Scalar most = 0;
    for (int k = 0; k < size(); ++k)
      most = std::max(most, inverse_pivots_[static_cast<std::size_t>(k)] * rounding_[k / kDim]);
    return kRounding / most;
  }

  /// The energy of displacing every node of x by its rounding, some units in the last place.
  Scalar energy_of_rounding(const Points& x) const {
    const Scalar rounding = kRounding * largest_size(x);
    return rounding_.sum() / kRounding * rounding * rounding;
  }

  /// A direction v along which the matrix H that was factored has negative curvature, from the most negative
  /// pivot d_k: v = L^-T e_k has v^T (H + R) v = |d_k|, where R, what pivots were repaired by, is not
  /// negative and has 2 |d_k| at k. Returns -|d_k|, which v^T H v is not above; 0 if no pivot was negative
  /// beyond rounding.
  Scalar negative_curvature(Points& direction) const {
    if (negative_ < 0) return 0;
    direction_of_pivot(negative_, direction);
    return -at(negative_, negative_);  // its sign was repaired
  }

  /// Calls visit(v) with v = L^-T e_k for every pivot that was rounding alone, until it returns true, and
  /// returns whether it did. v^T H v is then 0 or less, up to rounding, as the repaired pivots may hide
  /// negative curvature.
  template <typename Visit>
  bool any_flat_direction(Points& direction, Visit&& visit) const {
    for (int k = 0; k < size(); ++k) {
      if (at(k, k) != flat(k)) continue;
      direction_of_pivot(k, direction);
      if (visit(direction)) return true;
    }
    return false;
  }

 private:
  static constexpr int kDim = System::kDim;
  static constexpr int kSize = times<System::kNodes>(kDim);
  static constexpr int kMaxSize = times<System::kMaxNodes>(kDim);
  static constexpr bool kUnrolled = kSize != Eigen::Dynamic && kSize <= 12;
  static constexpr int kPadded = kSize + kSize % 2;  // to whole pairs of rows, if unrolled
  static constexpr Scalar kRounding = 8 * std::numeric_limits<Scalar>::epsilon();

  template <int kLength>
  using Storage = std::conditional_t<
      kMaxSize == Eigen::Dynamic, std::vector<Scalar>,
      std::array<Scalar, static_cast<std::size_t>(kMaxSize == Eigen::Dynamic ? 1 : kLength)>>;

  using Block = Eigen::Matrix<Scalar, kDim, kDim, Eigen::ColMajor>;
  typedef Scalar Pair [[gnu::vector_size(2 * sizeof(Scalar))]];
  // A constant for loads by pairs, where Eigen's own stores one number at a time first.
  static constexpr auto kIdentity = [] {
    std::array<Scalar, std::size_t{kDim} * kDim> values{};
    for (std::size_t c = 0; c < kDim; ++c) values[c * (kDim + 1)] = 1;
    return values;
  }();

  int size() const {
    if constexpr (kSize != Eigen::Dynamic) return kSize;
    return size_;
  }
  int stride() const {
    if constexpr (kUnrolled) return kPadded;
    return size() + 1;
  }
  // Not of int: dense matrices of some 23,000 nodes have more entries than that counts.
  std::size_t index(int row, int column) const {
    return static_cast<std::size_t>(column) * static_cast<std::size_t>(stride()) +
           static_cast<std::size_t>(row);
  }
  Scalar& at(int row, int column) { return values_[index(row, column)]; }
  const Scalar& at(int row, int column) const { return values_[index(row, column)]; }
  Scalar right(int k) const {
    if constexpr (kUnrolled) return right_[static_cast<std::size_t>(k)];
    return at(size(), k);
  }
  // Two numbers side by side, such as rows `row` and `row + 1` of a column.
  static Pair load(const Scalar* first) {
    Pair pair;
    std::memcpy(&pair, first, sizeof pair);
    return pair;
  }
  static void store(Scalar* first, Pair pair) { std::memcpy(first, &pair, sizeof pair); }
  // Block of the coordinates of two nodes.
  auto block(int i, int j) {
    return Eigen::Map<Block, 0, Eigen::OuterStride<>>(&at(kDim * i, kDim * j),
                                                      Eigen::OuterStride<>(stride()));
  }

  // A link's curvature into the lower triangle.
  void add_link(const Link& link, const Block& curvature) {
    const int low = kDim * std::min(link.i, link.j);
    const int high = kDim * std::max(link.i, link.j);
    Scalar* const low_low = &at(low, low);
    Scalar* const high_low = &at(high, low);
    Scalar* const high_high = &at(high, high);
    for (int column = 0; column < kDim; ++column) {
      for (int row = 0; row < kDim; ++row) {
        const int entry = column * stride() + row;
        high_low[entry] -= curvature(row, column);
        if (row < column) continue;
        low_low[entry] += curvature(row, column);
        high_high[entry] += curvature(row, column);
      }
    }
  }

  // Energy, gradient and Hessian for any links.
  Scalar assemble_links(const System& system, const Points& x, bool clamp, Points& gradient) {
    std::fill_n(values_.begin(), index(0, size()), Scalar(0));
    gradient.resize(kDim, system.nodes());
    Scalar energy = 0;
    for_each_spring(
        system, x,
        [&](int i, const Point& offset) {
          const auto node = node_force(system, i, x, offset);
          gradient.col(i) = node.gradient;
          energy += node.energy;
          block(i, i) = anchor_curvature(system, i, offset, clamp);
        },
        [&](int, const Link& link, const auto& force, const auto& spring) {
          energy += force.energy;
          const Point pull = force.tension * spring.direction;
          gradient.col(link.i) += pull;
          gradient.col(link.j) -= pull;
          add_link(link, link_curvature(clamp ? force.clamped() : force, spring));
        });
    return energy;
  }

  // The same for a small full topology: each block is written once. False where it does not serve. Whatever
  // the elimination loads as a pair of rows is also stored as one: the processor would wait for two stores to
  // reach the cache before it loads across them.
  [[gnu::flatten]] bool assemble_full(const System& system, const Points& x, bool clamp, Points& gradient,
                                      Scalar& energy) {
    using Links = FullLinks<System>;
    if constexpr (!kUnrolled || !Links::kServes) {
      return false;
    } else {
      Links links;
      if (!Links::serve(system) || !links.set(system, x)) return false;
      constexpr int kNodes = System::kNodes;
      const Eigen::Map<const Block> identity(kIdentity.data());
      std::array<Point, kNodes> pulls;
      std::array<Block, kNodes> diagonal;
      Scalar sum = 0;
      unroll<0, kNodes>([&](auto i) {
        const Point d = anchor_offset(system, i, x);
        const auto anchor = anchor_force(system, i, d);
        pulls[i] = anchor.gradient;
        sum += anchor.energy;
        if constexpr (System::kPlainAnchors) {
          diagonal[i] = system.anchor_stiffness[i] * identity;
        } else {
          diagonal[i] = anchor_curvature(system, i, d, clamp);
        }
      });
      const auto curvatures = links.curvatures(clamp);
      Links::for_each([&](auto i, auto j, auto l) {
        sum += links.energy(l);
        const Point pull = links.pull(l);
        pulls[i] += pull;
        pulls[j] -= pull;
        for (int c = 0; c < kDim; ++c) {
          Point curvature;
          for (int r = 0; r < kDim; ++r) curvature[r] = curvatures(r, c)[l];
          diagonal[i].col(c) += curvature;
          diagonal[j].col(c) += curvature;
          block(j, i).col(c) = -curvature;
        }
      });
      unroll<0, kNodes>([&](auto i) {
        gradient.col(i) = pulls[i];
        block(i, i) = diagonal[i];
      });
      energy = sum;
      return true;
    }
  }

  // A fixed node is coupled to none, and its step is zero.
  void isolate_fixed(const System& system, Points& gradient) {
    clear_fixed(system, gradient);
    for (int i = 0; i < system.nodes(); ++i) {
      if (!system.is_fixed(i)) continue;
      for (int k = kDim * i; k < kDim * (i + 1); ++k) {
        for (int j = 0; j < k; ++j) at(k, j) = 0;
        for (int j = k; j < size(); ++j) at(j, k) = 0;
        at(k, k) = rounding_[i] > 0 ? rounding_[i] / kRounding : Scalar(1);
      }
    }
  }

  // L^-T e_k.
  void direction_of_pivot(int pivot, Points& direction) const {
    direction.setZero(kDim, size() / kDim);
    Scalar* v = direction.data();
    v[pivot] = 1;
    for (int k = pivot - 1; k >= 0; --k) {
      Scalar sum = 0;
      for (int i = pivot; i > k; --i) sum += at(i, k) * v[i];
      v[k] = -sum * inverse_pivots_[static_cast<std::size_t>(k)];
    }
  }

  // The pivot that a direction without curvature gets: IDA's, for steps along it to be short; 1 for a node
  // without stiffness, which stays.
  Scalar flat(int k) const {
    const Scalar rounding = rounding_[k / kDim];
    return rounding > 0 ? rounding / kRounding : Scalar(1);
  }

  Scalar repair(int k) {
    const Scalar pivot = at(k, k);
    const Scalar rounding = rounding_[k / kDim];
    if (pivot > rounding) [[likely]]
      return pivot;
    if (pivot < most_negative_ * rounding) {
      most_negative_ = pivot / rounding;
      negative_ = k;
    }
    repaired_ = true;
    return at(k, k) = pivot < -rounding ? -pivot : flat(k);
  }

  // Column `to`, from its diagonal down, less the outer product of column `from` over its pivot.
  void subtract(int from, int to) {
    const Scalar* pivot_column = &at(0, from);
    const Scalar factor = pivot_column[to] * inverse_pivots_[static_cast<std::size_t>(from)];
    Scalar* column = &at(0, to);
    for (int i = to; i <= size(); ++i) column[i] -= factor * pivot_column[i];
  }

  // Pivots k and k + 1. The reciprocal of the second is the first over the determinant d of both, which is
  // divided by while the first is; elimination is bound by such chains.
  template <int k>
  void eliminate_pair() {
    const Scalar below = at(k + 1, k);
    const Scalar d = at(k, k) * at(k + 1, k + 1) - below * below;
    const Scalar inverse_d = 1 / d;
    const Scalar first = repair(k);
    const Scalar inverse = 1 / first;
    const Scalar ratio = below * inverse;
    const Scalar second = at(k + 1, k + 1) -= ratio * below;
    const Scalar second_inverse = !repaired_ && second > rounding_[(k + 1) / kDim] && std::isnormal(inverse_d)
                                      ? first * inverse_d
                                      : 1 / repair(k + 1);
    inverse_pivots_[k] = inverse;
    inverse_pivots_[k + 1] = second_inverse;
    right_[k + 1] -= ratio * right_[k];

    // The columns below both pivots, by pairs of rows.
    constexpr int kPairs = (kPadded - k - 2) / 2;
    Pair p[kPairs + 1], q[kPairs + 1];  // std::array would forget that they are vectors
    unroll<0, kPairs>([&](auto r) {
      p[r] = load(&at(k + 2 + 2 * r, k));
      q[r] = load(&at(k + 2 + 2 * r, k + 1)) - ratio * p[r];
    });
    const Scalar right_p = right_[k] * inverse;
    const Scalar right_q = right_[k + 1] * second_inverse;
    unroll<0, kPairs>([&](auto c) {
      constexpr int kColumn = k + 2 + 2 * c;
      const Pair factor_p = p[c] * inverse;
      const Pair factor_q = q[c] * second_inverse;
      unroll<c, kPairs>([&](auto r) {
        for (int j = 0; j < 2; ++j) {
          Scalar* const entry = &at(k + 2 + 2 * r, kColumn + j);
          store(entry, load(entry) - p[r] * factor_p[j] - q[r] * factor_q[j]);
        }
      });
      Scalar* const entry = &right_[kColumn];
      store(entry, load(entry) - (p[c] * right_p + q[c] * right_q));
      store(&at(kColumn, k + 1), q[c]);
    });
  }

  int size_ = 0;
  bool repaired_ = false;
  int negative_ = -1;                     // the pivot most negative beside its node's stiffness
  Scalar most_negative_ = -1;             // in units of its rounding
  typename System::NodeVector rounding_;  // of the pivots of a node
  Storage<kUnrolled ? kPadded * kPadded : (kMaxSize + 1) * kMaxSize> values_{};    // column-major
  std::array<Scalar, kUnrolled ? static_cast<std::size_t>(kPadded) : 0> right_{};  // g, if unrolled
  Storage<kMaxSize> inverse_pivots_{};
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
