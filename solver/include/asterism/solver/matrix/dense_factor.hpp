#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/export.hpp>
#include <cmath>
#include <cstddef>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// to -= A f for the first four columns of A, which are `stride` apart and have `count` rows.
template <typename Scalar>
void subtract_columns(Scalar* to, const Scalar* A, Eigen::Index stride, Scalar f0, Scalar f1, Scalar f2,
                      Scalar f3, Eigen::Index count) {
  constexpr int kWidth = 4;
  using Pack = Eigen::Array<Scalar, kWidth, 1>;
  using Row = Eigen::Map<const Pack>;
  const Scalar* const B = A + stride;
  const Scalar* const C = B + stride;
  const Scalar* const D = C + stride;
  Eigen::Index i = 0;
  for (; i + kWidth <= count; i += kWidth)
    Eigen::Map<Pack>(to + i) -= f0 * Row(A + i) + f1 * Row(B + i) + f2 * Row(C + i) + f3 * Row(D + i);
  for (; i < count; ++i) to[i] -= f0 * A[i] + f1 * B[i] + f2 * C[i] + f3 * D[i];
}

/// The Cholesky factorisation L L^T of symmetric positive definite matrices, n x n in memory, column after
/// column. As fast as Eigen's, which takes a compiler four seconds for each scalar.
template <typename Scalar>
struct DenseFactor {
  /// The lower triangle of `matrix` becomes L; the upper one stays. False where it is not positive definite.
  static bool factorize(Scalar* matrix, Eigen::Index n);

  /// right = (L L^T)^-1 right for some vectors, one after the other in memory. `inverse_pivots` is one over
  /// the diagonal of L.
  static void solve(const Scalar* factor, const Scalar* inverse_pivots, Eigen::Index n, Scalar* right,
                    int count);

  /// The inverse of L L^T.
  static void invert(const Scalar* factor, Eigen::Index n, Scalar* inverse);

 private:
  using Matrix = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor>;
  static constexpr Eigen::Index kPanel = 64;  // columns that are subtracted one by one
  static constexpr int kRows = 32 / sizeof(Scalar);

  static bool factorize_panel(Scalar* matrix, Eigen::Index n, Eigen::Index first, Eigen::Index last);
  static void subtract_panel(Scalar* matrix, Eigen::Index n, Eigen::Index first, Eigen::Index last,
                             Scalar* packed);
};

template <typename Scalar>
bool DenseFactor<Scalar>::factorize(Scalar* matrix, Eigen::Index n) {
  if (n <= kPanel) return factorize_panel(matrix, n, 0, n);
  std::vector<Scalar> packed(static_cast<std::size_t>((n + kRows) * kPanel));
  for (Eigen::Index first = 0; first < n; first += kPanel) {
    const Eigen::Index last = std::min(n, first + kPanel);
    if (!factorize_panel(matrix, n, first, last)) return false;
    subtract_panel(matrix, n, first, last, packed.data());
  }
  return true;
}

// Columns first to last - 1 of L, from which all before `first` are subtracted.
template <typename Scalar>
bool DenseFactor<Scalar>::factorize_panel(Scalar* matrix, Eigen::Index n, Eigen::Index first,
                                          Eigen::Index last) {
  for (Eigen::Index c = first; c < last; ++c) {
    Scalar* const column = matrix + c * n;
    Eigen::Index k = first;
    for (; k + 4 <= c; k += 4) {
      const Scalar* const of = matrix + k * n + c;
      subtract_columns(column + c, of, n, of[0], of[n], of[2 * n], of[3 * n], n - c);
    }
    for (; k < c; ++k) {
      const Scalar* const of = matrix + k * n;
      const Scalar factor = of[c];
      for (Eigen::Index i = c; i < n; ++i) column[i] -= factor * of[i];
    }
    if (!(column[c] > 0)) return false;
    const Scalar root = std::sqrt(column[c]);
    column[c] = root;
    for (Eigen::Index i = c + 1; i < n; ++i) column[i] /= root;
  }
  return true;
}

// The product of the panel's rows below it with their transpose, from the rest of the matrix: in blocks of
// kRows x 4 that stay in registers, with the panel's rows side by side in memory.
template <typename Scalar>
void DenseFactor<Scalar>::subtract_panel(Scalar* matrix, Eigen::Index n, Eigen::Index first,
                                         Eigen::Index last, Scalar* packed) {
  using Pack = Eigen::Array<Scalar, kRows, 1>;
  using Row = Eigen::Map<const Pack>;
  const Eigen::Index depth = last - first;
  for (Eigen::Index i = last; i < n; i += kRows) {
    Scalar* to = packed + (i - last) * depth;
    for (Eigen::Index k = first; k < last; ++k) {
      for (Eigen::Index r = i; r < i + kRows; ++r) *to++ = r < n ? matrix[k * n + r] : Scalar(0);
    }
  }
  for (Eigen::Index j = last; j < n; j += 4) {
    const Eigen::Index offset = (j - last) % kRows;
    const Scalar* const columns = packed + (j - last - offset) * depth + offset;
    for (Eigen::Index i = j - offset; i < n; i += kRows) {
      const Scalar* row = packed + (i - last) * depth;
      const Scalar* of = columns;
      Pack a = Pack::Zero(), b = a, c = a, d = a;
      for (Eigen::Index k = 0; k < depth; ++k, row += kRows, of += kRows) {
        const Pack values = Row(row);
        a += of[0] * values;
        b += of[1] * values;
        c += of[2] * values;
        d += of[3] * values;
      }
      if (i >= j + 4 && i + kRows <= n) {  // below the diagonal
        Scalar* const to = matrix + j * n + i;
        Eigen::Map<Pack>(to) -= a;
        Eigen::Map<Pack>(to + n) -= b;
        Eigen::Map<Pack>(to + 2 * n) -= c;
        Eigen::Map<Pack>(to + 3 * n) -= d;
        continue;
      }
      const Pack* const sums[] = {&a, &b, &c, &d};
      for (Eigen::Index s = j; s < std::min(j + 4, n); ++s) {
        for (Eigen::Index r = std::max(i, s); r < std::min(i + kRows, n); ++r)
          matrix[s * n + r] -= (*sums[s - j])[r - i];
      }
    }
  }
}

// Four columns of L at a time: for so few right-hand sides faster than Eigen's, which is made for many.
template <typename Scalar>
void DenseFactor<Scalar>::solve(const Scalar* factor, const Scalar* inverse_pivots, Eigen::Index n,
                                Scalar* right, int count) {
  using Vector = Eigen::Map<const Eigen::Matrix<Scalar, Eigen::Dynamic, 1>>;
  constexpr Eigen::Index kBlock = 4;
  const Eigen::Index blocked = n - n % kBlock;
  const auto L = [=](Eigen::Index row, Eigen::Index column) { return factor + column * n + row; };
  for (Scalar* b = right; count > 0; b += n, --count) {
    const auto forward = [&](Eigen::Index first, Eigen::Index last) {
      for (Eigen::Index p = first; p < last; ++p) {
        for (Eigen::Index q = first; q < p; ++q) b[p] -= *L(p, q) * b[q];
        b[p] *= inverse_pivots[p];
      }
    };
    const auto backward = [&](Eigen::Index first, Eigen::Index last) {
      for (Eigen::Index p = last; p-- > first;) {
        for (Eigen::Index q = p + 1; q < last; ++q) b[p] -= *L(q, p) * b[q];
        b[p] *= inverse_pivots[p];
      }
    };
    for (Eigen::Index j = 0; j < blocked; j += kBlock) {
      const Eigen::Index below = j + kBlock;
      forward(j, below);
      if (below < n)
        subtract_columns(b + below, L(below, j), n, b[j], b[j + 1], b[j + 2], b[j + 3], n - below);
    }
    forward(blocked, n);
    backward(blocked, n);
    for (Eigen::Index j = blocked; (j -= kBlock) >= 0;) {
      const Eigen::Index below = j + kBlock, rest = n - below;
      for (Eigen::Index c = j; rest > 0 && c < below; ++c)
        b[c] -= Vector(L(below, c), rest).dot(Vector(b + below, rest));
      backward(j, below);
    }
  }
}

template <typename Scalar>
void DenseFactor<Scalar>::invert(const Scalar* factor, Eigen::Index n, Scalar* inverse) {
  const auto L = Eigen::Map<const Matrix>(factor, n, n).template triangularView<Eigen::Lower>();
  Eigen::Map<Matrix> result(inverse, n, n);
  result.setIdentity();
  L.solveInPlace(result);
  L.transpose().solveInPlace(result);
}

#ifdef ASTERISM_SOLVER_COMPILED
// In the machine's widest vectors.
template <>
ASTERISM_API bool DenseFactor<double>::factorize(double* matrix, Eigen::Index n);
template <>
ASTERISM_API bool DenseFactor<float>::factorize(float* matrix, Eigen::Index n);
template <>
ASTERISM_API void DenseFactor<double>::solve(const double* factor, const double* inverse_pivots,
                                             Eigen::Index n, double* right, int count);
template <>
ASTERISM_API void DenseFactor<float>::solve(const float* factor, const float* inverse_pivots, Eigen::Index n,
                                            float* right, int count);
template <>
ASTERISM_API void DenseFactor<double>::invert(const double* factor, Eigen::Index n, double* inverse);
template <>
ASTERISM_API void DenseFactor<float>::invert(const float* factor, Eigen::Index n, float* inverse);
#endif

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
