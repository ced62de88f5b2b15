#pragma once

#include <asterism/solver/base/export.hpp>
#include <cstddef>

// The border between what is computed of fully linked systems and its compiled kernels; see
// asterism/solver/batch/batch_kernels.hpp for what may not be on it.
namespace asterism::lanes_v0_1 {

/// Rows and columns of what the kernels read and write begin at multiples of these many numbers.
inline constexpr int kAlignedRows = 8;

/// `count` rounded up to such a multiple.
constexpr std::ptrdiff_t aligned_rows(std::ptrdiff_t count) {
  return (count + kAlignedRows - 1) / kAlignedRows * kAlignedRows;
}

/// Hooke's springs between all pairs of nodes. What has a number for each node is followed by zeros up to
/// `stride`.
struct SpringHessian {
  int nodes;                       ///< their number
  int dim;                         ///< 2 or 3
  std::ptrdiff_t stride;           ///< aligned_rows(nodes)
  const double* stiffness;         ///< `stride` numbers for each node, its springs to all nodes; 0 to itself
  const double* rest_length;       ///< likewise
  const double* points;            ///< a row of `stride` numbers for each coordinate
  const double* anchors;           ///< as `points`; null where they are in `gradient` and `own` before
  const double* anchor_stiffness;  ///< a number for each node
  bool clamp;                      ///< without negative curvature
  double* gradient;                ///< as `points`
  /// The nodes' own blocks of the Hessian, symmetric: a row for each of (0, 0), (0, 1), (1, 1), (0, 2), ...
  double* own;
  /// Its lower triangle, column after column, the nodes' coordinates side by side.
  double* hessian;
  std::ptrdiff_t rows;  ///< from one column to the next: at least dim * stride
};

/// The energy of springs and `anchors`; not finite where a spring is shorter than the root of
/// kLeastLengthSquare, or the gradient is not finite. Numbers of the Hessian above the diagonal and below its
/// last row are finite.
ASTERISM_API double differentiate(const SpringHessian& springs);

/// Numbers of type double in a vector of the kernels for this machine, at most kAlignedRows.
ASTERISM_API int lanes();

/// Hooke's springs between all pairs of nodes, each once: tiles of lanes() x lanes() pairs, of which the
/// vectors are the diagonals. Of the groups a <= b of so many nodes, diagonal s has the springs of node i of
/// a and node (i + s) % lanes() of b, for s = 0, 1, ..., and in the tile of one group for s = 1 to lanes() /
/// 2, the last of which is half empty.
struct SpringTiles {
  int nodes;              ///< their number
  int dim;                ///< 2 or 3
  std::ptrdiff_t stride;  ///< aligned_rows(nodes)
  /// For each diagonal, of the tiles (0, 0), (0, 1), ..., (1, 1), ...: stiffness and rest length.
  const double* springs;
  const double* anchors;           ///< a row of `stride` numbers for each coordinate; null: see `forces`
  const double* anchor_stiffness;  ///< a number for each node, then zeros
  /// Rows as those of `anchors`, in which places behind the nodes' are finite and apart.
  double* points;
  double* forces;           ///< rows as well; before, those of anchors that are not in `anchors`
  const double* from;       ///< points, whose coordinates are side by side
  const double* direction;  ///< as `from`
  double step;              ///< the springs are between the points from + step direction
  double* to;               ///< in the end these points, as `from`
  double* gradient;         ///< in the end the gradient, as `from`
};

/// What SpringTiles have at the points where they are.
struct EnergyAlong {
  double energy;  ///< of springs and `anchors`
  double slope;   ///< the gradient times the direction
};

/// Writes points and gradient. The energy is not finite where two nodes are nearer than the root of
/// kLeastLengthSquare, or the gradient is not finite.
ASTERISM_API EnergyAlong differentiate(const SpringTiles& springs);

/// A symmetric matrix and a right-hand side.
struct NewtonEquations {
  int size;             ///< of rows and columns
  int dim;              ///< of coordinates: as many rows have one rounding
  std::ptrdiff_t rows;  ///< from one column to the next: a multiple of kAlignedRows, not less than size
  /// The lower triangle counts. In the end, columns of L D, where L D L^T = H + repair.
  double* matrix;
  double* right;           ///< `rows` numbers; in the end L^-1 of the right-hand side
  double* inverse_pivots;  ///< one over D
  const double* rounding;  ///< of a node's pivots
  double flat;  ///< times a node's rounding: what a pivot becomes that is rounding alone; 1 if that is 0
};

/// What became of the pivots.
struct Pivots {
  bool repaired;  ///< one was negative, which is now its absolute value, or rounding alone
  int negative;   ///< the most negative one in units of its rounding; -1 if there is none
};

/// Gauss's elimination without pivoting; pivots that are not positive are repaired.
ASTERISM_API Pivots eliminate(const NewtonEquations& equations);

/// The solution of L D L^T p = g from what `eliminate` leaves.
struct NewtonStep {
  int size;                      ///< as in NewtonEquations
  std::ptrdiff_t rows;           ///< as there
  const double* matrix;          ///< columns of L D
  const double* right;           ///< L^-1 g
  const double* inverse_pivots;  ///< one over D
  double* step;                  ///< `size` numbers
};

/// Returns g . p.
ASTERISM_API double substitute(const NewtonStep& step);

}  // namespace asterism::lanes_v0_1
