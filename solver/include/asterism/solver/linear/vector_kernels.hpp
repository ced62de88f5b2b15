#pragma once

#include <asterism/solver/base/export.hpp>
#include <cstddef>

// The border between descent methods and the compiled kernels of what they do with vectors and a symmetric
// matrix; see asterism/solver/batch/batch_kernels.hpp for what may not be on it.
namespace asterism::lanes_v0_1 {

/// From so many numbers in a vector on, a call of these kernels pays.
inline constexpr int kLeastKernelSize = 12;

/// An even number of columns, in each of which `size` numbers are followed by zeros up to `stride`.
struct Columns {
  const double* data;     ///< of the first
  std::ptrdiff_t stride;  ///< from one column to the next, a multiple of kAlignedRows
  int count;              ///< of columns
  int size;               ///< of each
};

/// The last step of a descent and the change of its metric's, as two of the columns, and the products of all
/// columns with the gradient there.
struct DescentPair {
  Columns columns;      ///< all of them
  double* step_column;  ///< one of the columns, which becomes step * direction; null to leave all as they are
  double* change_column;          ///< another one, which becomes descent_before - descent
  double step;                    ///< how many times the direction the step was
  const double* direction;        ///< `size` numbers, as all that follow
  const double* descent;          ///< -M^-1 g after the step, for the metric M
  const double* descent_before;   ///< and before it
  const double* gradient;         ///< g after the step
  const double* gradient_before;  ///< and before it
  double* products;               ///< `count` numbers
};

/// Writes the two columns and the products. The product of the change with `gradient_before`, or 0.
ASTERISM_API double update(const DescentPair& pair);

/// scale * first + the columns times their weights.
struct ColumnSum {
  Columns columns;         ///< as they are
  const double* weights;   ///< of each
  double scale;            ///< of `first`
  const double* first;     ///< `size` numbers
  const double* gradient;  ///< likewise
  double* sum;             ///< likewise
};

/// Writes the sum. Its product with `gradient`.
ASTERISM_API double add(const ColumnSum& sum);

/// The number of rows of a symmetric matrix of which the inverse is used.
inline constexpr int kMostInverted = 64;

/// A symmetric matrix, all of which is in memory, in columns that are followed by zeros up to `stride`. It
/// becomes its inverse by sweeps (Goodnight 1979), whose pivots are the squares of Cholesky's.
struct MatrixInverse {
  double* matrix;          ///< then its inverse
  std::ptrdiff_t stride;   ///< as of Columns
  int n;                   ///< 1 to kMostInverted
  double rounding;         ///< the least pivot as a share of its diagonal
  const double* diagonal;  ///< as it was
};

/// Inverts the matrix; false where a pivot is smaller than it may be.
ASTERISM_API bool invert(const MatrixInverse& inverse);

/// Points become those less other points times such a matrix.
struct PointsLessProduct {
  const double* matrix;   ///< as MatrixInverse leaves it
  std::ptrdiff_t stride;  ///< as of Columns
  int n;                  ///< of rows and of points
  int dim;                ///< of the points, 1 to 3, whose coordinates are side by side
  const double* factor;   ///< n points
  double* points;         ///< n points
};

/// Subtracts the product.
ASTERISM_API void subtract(const PointsLessProduct& product);

}  // namespace asterism::lanes_v0_1
