#pragma once

// Cholesky's factorisation by one instruction set's vectors. No standard library, see batch_lanes.hpp.
#include "../batch_lanes.hpp"
#include "kernels.hpp"

namespace asterism::lanes_v0_1 {
namespace {

template <typename L>
class Cholesky {
  using T = typename L::T;
  using V = typename L::V;
  using Index = std::ptrdiff_t;
  static constexpr int kLanes = L::kLanes, kRows = 2 * kLanes;      // of a tile, whose sums stay in registers
  static constexpr int kColumns = sizeof(V) == kMostBytes ? 8 : 4;  // the widest vectors are twice as many
  static constexpr int kPanel = 64;                                 // columns that stay in the cache

 public:
  explicit Cholesky(const SymmetricMatrix<T>& matrix)
      : matrix_(matrix.data), n_(matrix.n), columns_(matrix.columns) {}

  Index factorize() {
    for (Index first = 0; first < columns_; first += kPanel) {
      const Index last = least(columns_, first + kPanel);
      for (Index c = first; c < last; c += kColumns) {
        subtract(first, c, c, last);
        const Index done = factorize_columns(c, last);
        if (done < least(kColumns, last - c)) return c + done;
      }
      for (Index c = last; c < n_; c += kColumns) subtract(first, last, c, n_);
    }
    return columns_;
  }

 private:
  ASTERISM_INLINE Index least(Index a, Index b) { return a < b ? a : b; }
  T* at(Index row, Index column) const { return matrix_ + column * n_ + row; }

  // The product of columns first to last - 1 of L with their transpose, from kColumns columns from c on, or
  // as many as there are before `end`.
  void subtract(Index first, Index last, Index c, Index end) const {
    if (first == last) return;
    if (end - c >= kColumns) {
      subtract_tiles<true>(first, last, c, kColumns);
    } else {
      subtract_tiles<false>(first, last, c, end - c);
    }
  }

  template <bool kAllColumns>
  void subtract_tiles(Index first, Index last, Index c, Index columns) const {
    Index i = c;
    tile<kAllColumns, false>(first, last, i, c, columns, true);
    for (i += kRows; i + kRows <= n_; i += kRows) tile<kAllColumns, true>(first, last, i, c, columns, false);
    if (i < n_) tile<kAllColumns, false>(first, last, i, c, columns, false);
  }

  // The same for kRows rows from i on, of which kAllRows are in the matrix, and so many columns.
  template <bool kAllColumns, bool kAllRows>
  [[gnu::always_inline]] inline void tile(Index first, Index last, Index i, Index c, Index columns,
                                          bool is_diagonal) const {
    const Index rows = n_ - i;
    const auto low = lanes_between<L>(0, rows), high = lanes_between<L>(0, rows - kLanes);
    V sums[kColumns][2];
    for (auto& sum : sums) sum[0] = sum[1] = L::set(0);
    for (Index k = first; k < last; ++k) {
      const T* const row = at(i, k);
      const V lower = kAllRows ? L::load(row) : L::load(row, low);
      const V upper = kAllRows ? L::load(row + kLanes) : L::load(row + kLanes, high);
      const T* const of = at(c, k);
      for (int s = 0; s < kColumns; ++s) {
        if (!kAllColumns && s >= columns) break;
        const V factor = L::set(of[s]);
        sums[s][0] = L::fma(factor, lower, sums[s][0]);
        sums[s][1] = L::fma(factor, upper, sums[s][1]);
      }
    }
    for (int s = 0; s < columns; ++s) {
      T* const to = at(i, c + s);
      if (kAllRows) {
        L::store(to, L::load(to) - sums[s][0]);
        L::store(to + kLanes, L::load(to + kLanes) - sums[s][1]);
        continue;
      }
      T values[kRows];
      L::store(values, sums[s][0]);
      L::store(values + kLanes, sums[s][1]);
      for (Index r = is_diagonal ? s : 0; r < least(rows, kRows); ++r) to[r] -= values[r];
    }
  }

  // kColumns columns from c on, or as many as there are before `end`, from which all before are subtracted.
  // Returns how many of them have positive pivots before the first one that has not.
  Index factorize_columns(Index c, Index end) const {
    const int columns = static_cast<int>(least(kColumns, end - c));
    T inverse[kColumns] = {}, factors[kColumns][kColumns] = {};
    for (int s = 0; s < columns; ++s) {
      T* const pivot = at(c + s, c + s);
      if (!(*pivot > 0)) return s;
      *pivot = root(*pivot);
      inverse[s] = 1 / *pivot;
      for (int r = s + 1; r < columns; ++r) {
        factors[r][s] = *at(c + r, c + s) *= inverse[s];
        for (int q = s + 1; q <= r; ++q) *at(c + r, c + q) -= factors[r][s] * factors[q][s];
      }
    }
    for (Index i = c + columns; i < n_; i += kLanes) {
      const bool is_whole = i + kLanes <= n_;
      const auto rows = lanes_between<L>(0, n_ - i);
      V x[kColumns];
#pragma GCC unroll 8
      for (int s = 0; s < kColumns; ++s) {
        if (s >= columns) break;
        V value = is_whole ? L::load(at(i, c + s)) : L::load(at(i, c + s), rows);
        for (int q = 0; q < s; ++q) value = L::fnma(L::set(factors[s][q]), x[q], value);
        x[s] = value * L::set(inverse[s]);
        if (is_whole) {
          L::store(at(i, c + s), x[s]);
        } else {
          L::store(at(i, c + s), x[s], rows);
        }
      }
    }
    return columns;
  }

  ASTERISM_INLINE T root(T a) {
    if constexpr (sizeof(T) == sizeof(float)) {
      return __builtin_sqrtf(a);
    } else {
      return __builtin_sqrt(a);
    }
  }

  T* matrix_;
  Index n_, columns_;
};

// By panels of columns of the left matrix, which stay in the cache, and tiles of the result, whose sums stay
// in registers.
void run_with_these_instructions(const MatrixProduct& product) {
  using L = DoubleLanes;
  using V = typename L::V;
  using Index = std::ptrdiff_t;
  constexpr Index kLanes = L::kLanes, kRows = 2 * kLanes, kPanel = 64;
  constexpr int kColumns = sizeof(V) == kMostBytes ? 8 : 4;
  const Index n = product.rows, width = product.columns;
  for (Index first = 0; first < product.inner; first += kPanel) {
    const Index last = first + kPanel < product.inner ? first + kPanel : product.inner;
    for (Index c = 0; c < width; c += kColumns) {
      const int columns = static_cast<int>(width - c < kColumns ? width - c : kColumns);
      for (Index i = 0; i < n; i += kRows) {
        const auto low = lanes_between<L>(0, n - i), high = lanes_between<L>(0, n - i - kLanes);
        const bool is_whole = i + kRows <= n;
        V sums[kColumns][2];
        for (auto& sum : sums) sum[0] = sum[1] = L::set(0);
        for (Index k = first; k < last; ++k) {
          const double* const row = product.left + k * product.stride + i;
          const V lower = is_whole ? L::load(row) : L::load(row, low);
          const V upper = is_whole ? L::load(row + kLanes) : L::load(row + kLanes, high);
          const double* const of = product.right + k * width + c;
#pragma GCC unroll 8
          for (int s = 0; s < kColumns; ++s) {
            if (s >= columns) break;
            const V factor = L::set(of[s]);
            sums[s][0] = L::fma(factor, lower, sums[s][0]);
            sums[s][1] = L::fma(factor, upper, sums[s][1]);
          }
        }
        for (int s = 0; s < columns; ++s) {
          double* const to = product.result + (c + s) * n + i;
          double values[kRows];
          L::store(values, sums[s][0]);
          L::store(values + kLanes, sums[s][1]);
          for (Index r = 0; r < kRows && i + r < n; ++r) to[r] = (first == 0 ? 0 : to[r]) + values[r];
        }
      }
    }
  }
}

// right <- (L L^T)^-1 right, four columns of L at a time.
template <typename L, int kRight>
void substitute(const RightHandSides<typename L::T>& right) {
  using T = typename L::T;
  using V = typename L::V;
  using Index = std::ptrdiff_t;
  constexpr Index kLanes = L::kLanes;
  constexpr int kColumns = 4;
  const Index n = right.n, blocked = n - n % kColumns;
  const T* const inverse = right.inverse_pivots;
  const auto at = [&](Index row, Index column) ASTERISM_INLINED { return right.factor + column * n + row; };
  const auto of = [&](int r) ASTERISM_INLINED { return right.values + r * n; };
  // The unknowns from `first` to before `last`, with what others add to them already subtracted.
  const auto forward = [&](T* b, Index first, Index last) {
    for (Index p = first; p < last; ++p) {
      for (Index q = first; q < p; ++q) b[p] -= *at(p, q) * b[q];
      b[p] *= inverse[p];
    }
  };
  const auto backward = [&](T* b, Index first, Index last) {
    for (Index p = last; p-- > first;) {
      for (Index q = p + 1; q < last; ++q) b[p] -= *at(q, p) * b[q];
      b[p] *= inverse[p];
    }
  };
  typename L::M rest;  // the lanes of the last rows below a block
  const auto load = [&](const T* from, Index i) ASTERISM_INLINED {
    return i + kLanes <= n ? L::load(from + i) : L::load(from + i, rest);
  };

  for (Index j = 0; j < blocked; j += kColumns) {
    rest = lanes_between<L>(0, (n - j - kColumns) % kLanes);
    V factors[kRight][kColumns];
    for (int r = 0; r < kRight; ++r) {
      forward(of(r), j, j + kColumns);
      for (int c = 0; c < kColumns; ++c) factors[r][c] = L::set(of(r)[j + c]);
    }
    for (Index i = j + kColumns; i < n; i += kLanes) {
      V columns[kColumns];
      for (int c = 0; c < kColumns; ++c) columns[c] = load(at(0, j + c), i);
      for (int r = 0; r < kRight; ++r) {
        V b = load(of(r), i);
        for (int c = 0; c < kColumns; ++c) b = L::fnma(columns[c], factors[r][c], b);
        if (i + kLanes <= n) {
          L::store(of(r) + i, b);
        } else {
          L::store(of(r) + i, b, rest);
        }
      }
    }
  }
  for (int r = 0; r < kRight; ++r) {
    forward(of(r), blocked, n);
    backward(of(r), blocked, n);
  }
  for (Index j = blocked; (j -= kColumns) >= 0;) {
    rest = lanes_between<L>(0, (n - j - kColumns) % kLanes);
    V sums[kRight][kColumns];
    for (auto& each : sums) {
      for (V& sum : each) sum = L::set(0);
    }
    for (Index i = j + kColumns; i < n; i += kLanes) {
      V columns[kColumns];
      for (int c = 0; c < kColumns; ++c) columns[c] = load(at(0, j + c), i);
      for (int r = 0; r < kRight; ++r) {
        const V b = load(of(r), i);
        for (int c = 0; c < kColumns; ++c) sums[r][c] = L::fma(columns[c], b, sums[r][c]);
      }
    }
    for (int r = 0; r < kRight; ++r) {
      for (int c = 0; c < kColumns; ++c) of(r)[j + c] -= L::sum(sums[r][c]);
      backward(of(r), j, j + kColumns);
    }
  }
}

template <typename L>
void substitute_all(const RightHandSides<typename L::T>& right) {
  constexpr int kMost = 3;  // at a time, which stay in registers
  for (RightHandSides<typename L::T> rest = right; rest.count > 0;) {
    const int count = rest.count == 4 ? 2 : rest.count < kMost ? rest.count : kMost;
    if (count == 1) substitute<L, 1>(rest);
    if (count == 2) substitute<L, 2>(rest);
    if (count == 3) substitute<L, 3>(rest);
    rest.values += count * rest.n;
    rest.count -= count;
  }
}

void run_with_these_instructions(const RightHandSides<double>& right) { substitute_all<DoubleLanes>(right); }
void run_with_these_instructions(const RightHandSides<float>& right) { substitute_all<FloatLanes>(right); }

// Some columns of L^-1 or of (L L^T)^-1 at a time, one in each lane, from row `first` on, the number of the
// first of them.
template <typename L>
class InverseColumns {
  using T = typename L::T;
  using V = typename L::V;
  using Index = std::ptrdiff_t;
  static constexpr Index kLanes = L::kLanes;
  static constexpr int kRows = 4;  // at a time

 public:
  InverseColumns(const T* factor, Index n, Index first, T* room)
      : factor_(factor), n_(n), first_(first), room_(room) {}

  /// Those of L^-1, by forward substitution of unit vectors. Returns the squares of their norms.
  V invert_triangle() const {
    V squares = L::set(0);
    for (Index i = first_; i < n_; i += kRows) {
      V sums[kRows];
      for (int r = 0; r < kRows; ++r) {
        T unit[kLanes] = {};
        if (i + r < first_ + kLanes) unit[i + r - first_] = 1;
        sums[r] = L::load(unit);
      }
      for (Index k = first_; k < i; ++k) {
        const V row = L::load(at(k));
        const T* const factors = factor(i, k);  // below the last row there is the next column
        for (int r = 0; r < kRows; ++r) sums[r] = L::fnma(L::set(factors[r]), row, sums[r]);
      }
      for (int r = 0; r < kRows && i + r < n_; ++r) {
        for (int q = 0; q < r; ++q) sums[r] = L::fnma(L::set(*factor(i + r, i + q)), sums[q], sums[r]);
        sums[r] = sums[r] * L::set(1 / *factor(i + r, i + r));
        squares = L::fma(sums[r], sums[r], squares);
        L::store(at(i + r), sums[r]);
      }
    }
    return squares;
  }

  /// L^-T times what invert_triangle has left.
  void multiply_by_inverse() const {
    for (Index end = n_; end > first_; end -= kRows) {
      const Index i = end - first_ < kRows ? first_ : end - kRows;
      const int rows = static_cast<int>(end - i);
      V sums[kRows];
      for (int r = 0; r < kRows; ++r) sums[r] = r < rows ? L::load(at(i + r)) : L::set(0);
      for (Index k = end; k < n_; ++k) {
        const V row = L::load(at(k));
        for (int r = 0; r < rows; ++r) sums[r] = L::fnma(L::set(*factor(k, i + r)), row, sums[r]);
      }
      for (int r = rows; r-- > 0;) {
        for (int q = r + 1; q < rows; ++q) sums[r] = L::fnma(L::set(*factor(i + q, i + r)), sums[q], sums[r]);
        sums[r] = sums[r] * L::set(1 / *factor(i + r, i + r));
        L::store(at(i + r), sums[r]);
      }
    }
  }

  /// Row `row`, a number of each column.
  T* at(Index row) const { return room_ + (row - first_) * kLanes; }

 private:
  const T* factor(Index row, Index column) const { return factor_ + column * n_ + row; }

  const T* factor_;
  Index n_, first_;
  T* room_;
};

void run_with_these_instructions(const InverseDiagonal& inverse) {
  constexpr std::ptrdiff_t kLanes = DoubleLanes::kLanes;
  for (std::ptrdiff_t first = 0; first < inverse.n; first += kLanes) {
    double squares[kLanes];
    const InverseColumns<DoubleLanes> columns(inverse.factor, inverse.n, first, inverse.room);
    DoubleLanes::store(squares, columns.invert_triangle());
    for (std::ptrdiff_t c = first; c < inverse.n && c < first + kLanes; ++c)
      inverse.diagonal[c] = squares[c - first];
  }
}

template <typename L>
void invert_all(const Inverse<typename L::T>& inverse) {
  const std::ptrdiff_t n = inverse.n;
  for (std::ptrdiff_t first = 0; first < n; first += L::kLanes) {
    const InverseColumns<L> columns(inverse.factor, n, first, inverse.room);
    columns.invert_triangle();
    columns.multiply_by_inverse();
    const int count = static_cast<int>(n - first < L::kLanes ? n - first : L::kLanes);
    for (std::ptrdiff_t row = first; row < n; ++row) {
      typename L::T* const numbers = columns.at(row);
      L::store(inverse.values + row * n + first, L::load(numbers),
               lanes_between<L>(0, count));  // the same transposed
      for (int c = 0; c < count; ++c) inverse.values[(first + c) * n + row] = numbers[c];
    }
  }
}

void run_with_these_instructions(const Inverse<double>& inverse) { invert_all<DoubleLanes>(inverse); }
void run_with_these_instructions(const Inverse<float>& inverse) { invert_all<FloatLanes>(inverse); }

std::ptrdiff_t run_with_these_instructions(const SymmetricMatrix<double>& matrix) {
  return Cholesky<DoubleLanes>(matrix).factorize();
}
std::ptrdiff_t run_with_these_instructions(const SymmetricMatrix<float>& matrix) {
  return Cholesky<FloatLanes>(matrix).factorize();
}

}  // namespace
}  // namespace asterism::lanes_v0_1
