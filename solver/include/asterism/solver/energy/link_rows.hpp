#pragma once

#include <asterism/solver/base/export.hpp>
#include <cstddef>

// The border between the energy of links and its compiled kernels; see
// asterism/solver/batch/batch_kernels.hpp for what may not be on it.
namespace asterism::lanes_v0_1 {

/// Squares of lengths below are left to others: rounding takes too much of them.
inline constexpr double kLeastLengthSquare = 0x1p-970;
/// No links have more coordinates.
inline constexpr int kMostCoordinates = 64;
/// More finite numbers than points in each row of coordinates, which are not used.
inline constexpr int kBeyond = 8;

/// Numbers of links; `stride` is 0 where all have the same, of which there are kBeyond more copies than
/// nodes.
struct LinkNumbers {
  const double* data;     ///< of the first link
  std::ptrdiff_t stride;  ///< from one link to the next
};

/// Links of which many are in rows, (i, j), (i, j + 1), ..., as all pairs of nodes are.
struct LinkRows {
  const int* pairs;       ///< the nodes of each link; null where they are all pairs
  int count;              ///< of links
  int nodes;              ///< the number of nodes that may be linked
  int dim;                ///< 1 to kMostCoordinates
  std::ptrdiff_t stride;  ///< from one row of points and of forces to the next, nodes + kBeyond at least
  const double* points;   ///< a row of finite numbers for each coordinate
  double* forces;         ///< on the points, to which those of the links are added; or null
  /// A stretch is r - lower for lengths r below `lower`, r - upper above `upper`, and 0 between them. Hooke's
  /// law has upper = lower.
  bool is_hooke;
  LinkNumbers lower;      ///< of each link
  LinkNumbers upper;      ///< read where is_hooke is false
  LinkNumbers stiffness;  ///< of each link
  /// Is told of each link that is too short, which is left out.
  void (*left_out)(void* context, int link);
  void* context;
};

/// Twice the energy of the links; not finite if a force is not.
ASTERISM_API double sum(const LinkRows& links);

}  // namespace asterism::lanes_v0_1
