#pragma once

#include <algorithm>
#include <array>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/base/numbers.hpp>
#include <asterism/solver/energy/full_links.hpp>
#include <asterism/solver/energy/full_springs.hpp>
#include <asterism/solver/energy/newton_kernels.hpp>
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
/// substitution. With the compiled library, this is done in the machine's widest vectors, in double, but for
/// a few nodes whose number is fixed.
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
      const auto size = static_cast<std::size_t>(size_), rows = static_cast<std::size_t>(stride());
      if (inverse_pivots_.size() != size) require_memory(double(sizeof(Scalar)) * size_ * stride());
      values_.resize(size * rows);
      right_.resize(rows);
      inverse_pivots_.resize(size);
    }
    rounding_ = kRounding * stiffness;
    has_springs_ = false;
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
    std::copy_n(gradient.data(), size(), right_.data());
    return energy;
  }

  /// L D L^T without pivoting. A pivot that is negative is replaced by its absolute value, one that is
  /// rounding alone by the node's stiffness; true if there was none, that is if the matrix is positive
  /// definite.
  [[gnu::flatten]] bool factorize() {
    repaired_ = false;
    negative_ = -1;
    most_negative_ = -1;
    if constexpr (kByKernels) {
      const lanes_v0_1::Pivots pivots = lanes_v0_1::eliminate({.size = size(),
                                                               .dim = kDim,
                                                               .rows = stride(),
                                                               .matrix = values_.data(),
                                                               .right = right_.data(),
                                                               .inverse_pivots = inverse_pivots_.data(),
                                                               .rounding = rounding_.data(),
                                                               .flat = 1 / kRounding});
      repaired_ = pivots.repaired;
      negative_ = pivots.negative;
    } else if constexpr (kUnrolled) {
      unroll<0, kSize / 2>([this](auto pair) { this->template eliminate_pair<2 * pair>(); });
      if constexpr (kSize % 2 == 1) inverse_pivots_[kSize - 1] = 1 / repair(kSize - 1);
    } else {
      for (int k = 0; k < size(); ++k) {
        inverse_pivots_[static_cast<std::size_t>(k)] = 1 / repair(k);
        subtract(k);
      }
    }
    return !repaired_;
  }

  /// p of (L D L^T) p = g into `step`; returns g . p, Newton's decrement squared.
  Scalar solve(Points& step) const {
    step.resize(kDim, size() / kDim);
    if constexpr (kByKernels) {
      return lanes_v0_1::substitute(
          {size(), stride(), values_.data(), right_.data(), inverse_pivots_.data(), step.data()});
    }
    Scalar* p = step.data();
    Scalar decrement = 0;
    const auto substitute = [&](int k) {
      const Scalar* column = &at(0, k);
      const Scalar inverse = inverse_pivots_[static_cast<std::size_t>(k)];
      const Scalar right = right_[static_cast<std::size_t>(k)];
      Scalar value = right * inverse;
      decrement += right * value;
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

  /// Whether energies and gradients of `assemble` are rounded as those of all methods.
  static constexpr bool rounds_alike() { return !kByKernels; }

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
  // A few nodes, whose loops are unrolled.
  static constexpr bool kUnrolled = kSize != Eigen::Dynamic && kSize <= 12;
  // Whether it is laid out for the kernels, as objects are also where these are not linked.
  static constexpr bool kWide = std::is_same_v<Scalar, double> && !kUnrolled;
  static constexpr bool kByKernels = kIsCompiled && kWide;
  struct Nothing {};
  using Springs = std::conditional_t<kWide && FullSprings<System>::kServes, FullSprings<System>, Nothing>;
  // From one column to the next; to whole pairs of rows, if unrolled.
  static constexpr int stride_of(int size) {
    if (kWide) return kDim * static_cast<int>(lanes_v0_1::aligned_rows(size / kDim));
    return kUnrolled ? size + size % 2 : size;
  }
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
  int stride() const { return stride_of(size()); }
  // Not of int: dense matrices of some 23,000 nodes have more entries than that counts.
  std::size_t index(int row, int column) const {
    return static_cast<std::size_t>(column) * static_cast<std::size_t>(stride()) +
           static_cast<std::size_t>(row);
  }
  Scalar& at(int row, int column) { return values_[index(row, column)]; }
  const Scalar& at(int row, int column) const { return values_[index(row, column)]; }
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

  // The same for all pairs of nodes. False where it does not serve.
  bool assemble_full(const System& system, const Points& x, bool clamp, Points& gradient, Scalar& energy) {
    if constexpr (kByKernels && !std::is_same_v<Springs, Nothing>) {
      if (!springs_.serve(system)) return false;
      if (!has_springs_) springs_.set(system);
      has_springs_ = true;
      return springs_.differentiate(system, x, clamp, gradient, values_.data(), stride(), energy);
    } else {
      return assemble_few(system, x, clamp, gradient, energy);
    }
  }

  // The same for a small full topology: each block is written once. False where it does not serve. Whatever
  // the elimination loads as a pair of rows is also stored as one: the processor would wait for two stores to
  // reach the cache before it loads across them.
  [[gnu::flatten]] bool assemble_few(const System& system, const Points& x, bool clamp, Points& gradient,
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

  // The columns behind a pivot's, and the right-hand side, less the outer product of it over its pivot.
  void subtract(int pivot) {
    const Scalar* pivot_column = &at(0, pivot);
    const Scalar inverse = inverse_pivots_[static_cast<std::size_t>(pivot)];
    const auto subtract_from = [&](Scalar* column, int first, Scalar factor) {
      for (int i = first; i < size(); ++i) column[i] -= factor * pivot_column[i];
    };
    for (int j = pivot + 1; j < size(); ++j) subtract_from(&at(0, j), j, pivot_column[j] * inverse);
    subtract_from(right_.data(), pivot + 1, right_[static_cast<std::size_t>(pivot)] * inverse);
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
    constexpr int kPairs = (stride_of(kSize) - k - 2) / 2;
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
  static constexpr int kMaxStride = kMaxSize == Eigen::Dynamic ? 0 : stride_of(kMaxSize);
  Storage<kMaxStride*(kUnrolled ? kMaxStride : kMaxSize)> values_{};  // column-major
  Storage<kMaxStride> right_{};                                       // g, then L^-1 g
  Storage<kMaxSize> inverse_pivots_{};
  bool has_springs_ = false;
  Springs springs_;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
