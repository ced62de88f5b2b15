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
  static constexpr int kLanes = L::kLanes, kRows = 2 * kLanes;  // of a tile, whose sums stay in registers
  static constexpr int kColumns = 4;
  static constexpr int kPanel = 64;  // columns that stay in the cache

 public:
  explicit Cholesky(const SymmetricMatrix<T>& matrix) : matrix_(matrix.data), n_(matrix.n) {}

  bool factorize() {
    for (Index first = 0; first < n_; first += kPanel) {
      const Index last = least(n_, first + kPanel);
      for (Index c = first; c < last; c += kColumns) {
        subtract(first, c, c);
        if (!factorize_columns(c)) return false;
      }
      for (Index c = last; c < n_; c += kColumns) subtract(first, last, c);
    }
    return true;
  }

 private:
  ASTERISM_INLINE Index least(Index a, Index b) { return a < b ? a : b; }
  T* at(Index row, Index column) const { return matrix_ + column * n_ + row; }

  // The product of columns first to last - 1 of L with their transpose, from the columns from c on.
  void subtract(Index first, Index last, Index c) const {
    if (first == last) return;
    Index i = c;
    tile<false>(first, last, i, c, true);
    for (i += kRows; i + kRows <= n_; i += kRows) tile<true>(first, last, i, c, false);
    if (i < n_) tile<false>(first, last, i, c, false);
  }

  // The same for kRows rows from i on; kWhole: all of them, in kColumns columns, are in the matrix.
  template <bool kWhole>
  [[gnu::always_inline]] inline void tile(Index first, Index last, Index i, Index c, bool is_diagonal) const {
    const Index rows = n_ - i;
    const int low = static_cast<int>(least(rows, kLanes));
    const int high = rows > kLanes ? static_cast<int>(least(rows - kLanes, kLanes)) : 0;
    V sums[kColumns][2];
    for (auto& sum : sums) sum[0] = sum[1] = L::set(0);
    for (Index k = first; k < last; ++k) {
      const T* const row = at(i, k);
      const V lower = kWhole ? L::load(row) : L::load_first(row, low);
      const V upper = kWhole ? L::load(row + kLanes) : L::load_first(row + kLanes, high);
      const T* const of = at(c, k);
      for (int s = 0; s < kColumns; ++s) {
        const V factor = L::set(of[s]);
        sums[s][0] = L::fma(factor, lower, sums[s][0]);
        sums[s][1] = L::fma(factor, upper, sums[s][1]);
      }
    }
    if (kWhole) {
      for (int s = 0; s < kColumns && c + s < n_; ++s) {
        T* const to = at(i, c + s);
        L::store(to, L::load(to) - sums[s][0]);
        L::store(to + kLanes, L::load(to + kLanes) - sums[s][1]);
      }
      return;
    }
    for (int s = 0; s < kColumns && c + s < n_; ++s) {
      T values[kRows];
      L::store(values, sums[s][0]);
      L::store(values + kLanes, sums[s][1]);
      T* const to = at(i, c + s);
      for (Index r = is_diagonal ? s : 0; r < least(rows, kRows); ++r) to[r] -= values[r];
    }
  }

  // kColumns columns from c on, or as many as there are, from which all before are subtracted.
  bool factorize_columns(Index c) const {
    const int columns = static_cast<int>(least(kColumns, n_ - c));
    T inverse[kColumns] = {}, factors[kColumns][kColumns] = {};
    for (int s = 0; s < columns; ++s) {
      T* const pivot = at(c + s, c + s);
      if (!(*pivot > 0)) return false;
      *pivot = root(*pivot);
      inverse[s] = 1 / *pivot;
      for (int r = s + 1; r < columns; ++r) {
        factors[r][s] = *at(c + r, c + s) *= inverse[s];
        for (int q = s + 1; q <= r; ++q) *at(c + r, c + q) -= factors[r][s] * factors[q][s];
      }
    }
    if (columns < kColumns) return true;
    for (Index i = c + kColumns; i < n_; i += kLanes) {
      const int rows = static_cast<int>(least(n_ - i, kLanes));
      V x[kColumns];
      for (int s = 0; s < kColumns; ++s) {
        V value = rows == kLanes ? L::load(at(i, c + s)) : L::load_first(at(i, c + s), rows);
        for (int q = 0; q < s; ++q) value = L::fnma(L::set(factors[s][q]), x[q], value);
        x[s] = value * L::set(inverse[s]);
        if (rows == kLanes) {
          L::store(at(i, c + s), x[s]);
        } else {
          L::store_first(at(i, c + s), x[s], rows);
        }
      }
    }
    return true;
  }

  ASTERISM_INLINE T root(T a) {
    if constexpr (sizeof(T) == sizeof(float)) {
      return __builtin_sqrtf(a);
    } else {
      return __builtin_sqrt(a);
    }
  }

  T* matrix_;
  Index n_;
};

// right <- (L L^T)^-1 right, four columns of L at a time.
template <int kRight>
void substitute(const RightHandSides& right) {
  using L = DoubleLanes;
  using V = L::V;
  using Index = std::ptrdiff_t;
  constexpr Index kLanes = L::kLanes;
  constexpr int kColumns = 4;
  const Index n = right.n, blocked = n - n % kColumns;
  const double* const inverse = right.inverse_pivots;
  const auto at = [&](Index row, Index column) ASTERISM_INLINED { return right.factor + column * n + row; };
  const auto of = [&](int r) ASTERISM_INLINED { return right.values + r * n; };
  // The unknowns from `first` to before `last`, with what others add to them already subtracted.
  const auto forward = [&](double* b, Index first, Index last) {
    for (Index p = first; p < last; ++p) {
      for (Index q = first; q < p; ++q) b[p] -= *at(p, q) * b[q];
      b[p] *= inverse[p];
    }
  };
  const auto backward = [&](double* b, Index first, Index last) {
    for (Index p = last; p-- > first;) {
      for (Index q = p + 1; q < last; ++q) b[p] -= *at(q, p) * b[q];
      b[p] *= inverse[p];
    }
  };
  const auto load = [&](const double* from, Index rows) ASTERISM_INLINED {
    return rows >= kLanes ? L::load(from) : L::load_first(from, int(rows));
  };

  for (Index j = 0; j < blocked; j += kColumns) {
    V factors[kRight][kColumns];
    for (int r = 0; r < kRight; ++r) {
      forward(of(r), j, j + kColumns);
      for (int c = 0; c < kColumns; ++c) factors[r][c] = L::set(of(r)[j + c]);
    }
    for (Index i = j + kColumns; i < n; i += kLanes) {
      V columns[kColumns];
      for (int c = 0; c < kColumns; ++c) columns[c] = load(at(i, j + c), n - i);
      for (int r = 0; r < kRight; ++r) {
        V b = load(of(r) + i, n - i);
        for (int c = 0; c < kColumns; ++c) b = L::fnma(columns[c], factors[r][c], b);
        if (i + kLanes <= n) {
          L::store(of(r) + i, b);
        } else {
          L::store_first(of(r) + i, b, static_cast<int>(n - i));
        }
      }
    }
  }
  for (int r = 0; r < kRight; ++r) {
    forward(of(r), blocked, n);
    backward(of(r), blocked, n);
  }
  for (Index j = blocked; (j -= kColumns) >= 0;) {
    V sums[kRight][kColumns];
    for (auto& each : sums) {
      for (V& sum : each) sum = L::set(0);
    }
    for (Index i = j + kColumns; i < n; i += kLanes) {
      V columns[kColumns];
      for (int c = 0; c < kColumns; ++c) columns[c] = load(at(i, j + c), n - i);
      for (int r = 0; r < kRight; ++r) {
        const V b = load(of(r) + i, n - i);
        for (int c = 0; c < kColumns; ++c) sums[r][c] = L::fma(columns[c], b, sums[r][c]);
      }
    }
    for (int r = 0; r < kRight; ++r) {
      for (int c = 0; c < kColumns; ++c) of(r)[j + c] -= total<L>(sums[r][c]);
      backward(of(r), j, j + kColumns);
    }
  }
}

void run_with_these_instructions(const RightHandSides& right) {
  constexpr int kMost = 3;  // at a time, which stay in registers
  for (RightHandSides rest = right; rest.count > 0;) {
    const int count = rest.count == 4 ? 2 : rest.count < kMost ? rest.count : kMost;
    if (count == 1) substitute<1>(rest);
    if (count == 2) substitute<2>(rest);
    if (count == 3) substitute<3>(rest);
    rest.values += count * rest.n;
    rest.count -= count;
  }
}

// Some columns of L^-1 at a time, one in each lane.
void run_with_these_instructions(const InverseDiagonal& inverse) {
  using L = DoubleLanes;
  using V = L::V;
  using Index = std::ptrdiff_t;
  constexpr Index kLanes = L::kLanes;
  constexpr int kRows = 4;
  const Index n = inverse.n;
  const auto at = [&](Index row, Index column) ASTERISM_INLINED { return inverse.factor + column * n + row; };
  for (Index first = 0; first < n; first += kLanes) {
    V squares = L::set(0);
    for (Index i = first; i < n; i += kRows) {
      V sums[kRows];
      for (int r = 0; r < kRows; ++r) {
        double unit[kLanes] = {};
        if (i + r < first + kLanes) unit[i + r - first] = 1;
        sums[r] = L::load(unit);
      }
      for (Index k = first; k < i; ++k) {
        const V row = L::load(inverse.room + (k - first) * kLanes);
        const double* const factors = at(i, k);  // below the last row there is the next column
        for (int r = 0; r < kRows; ++r) sums[r] = L::fnma(L::set(factors[r]), row, sums[r]);
      }
      for (int r = 0; r < kRows && i + r < n; ++r) {
        for (int q = 0; q < r; ++q) sums[r] = L::fnma(L::set(*at(i + r, i + q)), sums[q], sums[r]);
        sums[r] = sums[r] * L::set(1 / *at(i + r, i + r));
        squares = L::fma(sums[r], sums[r], squares);
        L::store(inverse.room + (i + r - first) * kLanes, sums[r]);
      }
    }
    double diagonal[kLanes];
    L::store(diagonal, squares);
    for (Index c = first; c < n && c < first + kLanes; ++c) inverse.diagonal[c] = diagonal[c - first];
  }
}

bool run_with_these_instructions(const SymmetricMatrix<double>& matrix) {
  return Cholesky<DoubleLanes>(matrix).factorize();
}
bool run_with_these_instructions(const SymmetricMatrix<float>& matrix) {
  return Cholesky<FloatLanes>(matrix).factorize();
}

}  // namespace
}  // namespace asterism::lanes_v0_1
