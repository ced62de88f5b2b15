#pragma once

#include <asterism/solver/base/export.hpp>
#include <asterism/solver/energy/link_rows.hpp>
#include <asterism/solver/energy/newton_kernels.hpp>
#include <cstddef>

// The border to kernels for wide instructions; see asterism/solver/batch/batch_kernels.hpp for what may not
// be on it.
namespace asterism::lanes_v0_1 {

/// No instructions have more bytes, or numbers of type double, in a vector.
inline constexpr int kMostBytes = 64;
inline constexpr int kMostLanes = kMostBytes / static_cast<int>(sizeof(double));

/// New points, each of which is to be placed by itself among points that are held.
struct PlacedPoints {
  int held;          ///< the number of those that are held
  int dim;           ///< of coordinates
  const double* at;  ///< the held points, one after the other
  int count;         ///< of new points
  /// Of a new point from all that are held, NaN where it is not known; and from one new point to the next.
  const double* distances;
  std::ptrdiff_t distances_stride;
  const double* weights;          ///< of the distances
  std::ptrdiff_t weights_stride;  ///< 0 where all new points have the same
  bool have_starts;
  double* places;  ///< starts, if there are, and in the end the places; NaN if no distance is known
  double* room;    ///< for kMostLanes (2 held + 6 + 9 dim + 3 dim (dim + 1) / 2) numbers
};

ASTERISM_API void place(const PlacedPoints& points);

/// A symmetric matrix, n x n in memory, column after column, of which the lower triangle counts.
template <typename T>
struct SymmetricMatrix {
  T* data;
  std::ptrdiff_t n;
  std::ptrdiff_t columns;  ///< the first ones, which are eliminated
};

/// The first columns of the lower triangle become those of L of L L^T (Cholesky), and the other ones what is
/// left of the matrix, their Schur complement; the upper triangle stays. Returns the number of columns, or of
/// those before the first pivot that is not positive; this one, and what is above and left of it, are as if
/// it were the last.
ASTERISM_API std::ptrdiff_t factorize(const SymmetricMatrix<double>& matrix);
ASTERISM_API std::ptrdiff_t factorize(const SymmetricMatrix<float>& matrix);

/// Right-hand sides of systems of equations with L L^T.
template <typename T>
struct RightHandSides {
  const T* factor;          ///< L, as `factorize` leaves it
  const T* inverse_pivots;  ///< one over its diagonal
  std::ptrdiff_t n;
  T* values;  ///< n numbers for each right-hand side; in the end, the solutions
  int count;
};

ASTERISM_API void solve(const RightHandSides<double>& right);
ASTERISM_API void solve(const RightHandSides<float>& right);

/// The product of two matrices.
struct MatrixProduct {
  const double* left;                  ///< rows x inner, column after column
  std::ptrdiff_t stride, rows, inner;  ///< stride: from one of these columns to the next
  const double* right;                 ///< inner x columns, row after row
  std::ptrdiff_t columns;
  double* result;  ///< rows x columns, column after column
};

void multiply(const MatrixProduct& product);

/// The diagonal of (L L^T)^-1, each entry of which is the square of the norm of a column of L^-1.
struct InverseDiagonal {
  const double* factor;  ///< L, as `factorize` leaves it
  std::ptrdiff_t n;
  double* diagonal;
  double* room;  ///< for n kMostLanes numbers
};

void invert(const InverseDiagonal& inverse);

/// (L L^T)^-1.
template <typename T>
struct Inverse {
  const T* factor;  ///< L, as `factorize` leaves it
  std::ptrdiff_t n;
  T* values;  ///< n x n
  T* room;    ///< for n kMostBytes bytes
};

ASTERISM_API void invert(const Inverse<double>& inverse);
ASTERISM_API void invert(const Inverse<float>& inverse);

}  // namespace asterism::lanes_v0_1
