#pragma once

#include <cstddef>

// The border to kernels for wide instructions; see asterism/solver/batch/batch_kernels.hpp for what may not
// be on it.
namespace asterism::lanes_v0_1 {

/// No tag whose minima the kernels find has more beacons.
inline constexpr int kMostBeacons = 64;

/// What is known of a tag if the closed forms of position_search.hpp prove it all. The second minimum is a
/// mirror image.
struct LaneFix {
  int count;  ///< of minima, 1 or 2; 0 where the tag is left to the scalar search
  double energy;
  double x[2][3];
  double covariance[2][9];  ///< (dim, dim)
};

/// Least squares of many tags.
struct FixTask {
  int dim, beacons, tags;
  const double* places;          ///< (beacons, dim)
  std::ptrdiff_t places_stride;  ///< from one tag to the next, 0 where all have the same
  const double* ranges;          ///< (tags, beacons)
  const double* sigma;           ///< (beacons)
  std::ptrdiff_t sigma_stride;
  double within;
  LaneFix* fixes;  ///< (tags)
};

/// Boxes that position_search.hpp searches, side by side: of one tag, also one box for several sets of
/// inliers, or of several tags.
struct Cells {
  static constexpr int kMost = 8;

  int dim, beacons;
  double* places;   ///< (beacons, dim, kMost)
  double* ranges;   ///< (beacons, kMost)
  double* weights;  ///< (beacons, kMost): of each range in each cell, 0 for an outlier
  double extent[kMost];
  double rounding[kMost];                   ///< of a gradient
  double is_partial[kMost];                 ///< 1: the weights bound the energy only, not its derivatives
  double room[kMost];                       ///< twice the energy that is asked for
  double centre[3][kMost], half[3][kMost];  ///< become those of the part where the gradient may vanish
  double bound[kMost];                      ///< of the energy of the ranges that have weights, from below
  double slope[kMost];                      ///< the gradient's length at the centre
  double share[kMost];                      ///< of the volume that is left, 0 where the cell has no minimum
  double newton[3][kMost];                  ///< the step from the centre
  unsigned convex;                          ///< bits of the cells in which the energy is convex
};

void fix(const FixTask& task);
void judge(Cells& cells);

}  // namespace asterism::lanes_v0_1
