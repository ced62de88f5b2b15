#pragma once

#include <Eigen/Core>
#include <asterism/solver/base/config.hpp>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of `slic`.
struct SlicOptions {
  /// Side of a superpixel [px], in [2, 1024]: one has about side^2 pixels.
  int side = 6;
  /// The paper's m, > 0 [units of the colors]: the larger, the more alike the superpixels are to squares.
  double compactness = 10;
  /// Rounds of assignment and update, in [1, 100].
  int iterations = 5;
};

/// Parts of an image that cover it, each in one piece.
struct SuperpixelMap {
  /// Size of the image [px].
  int cols = 0, rows = 0;
  /// The superpixel of each pixel, row by row: 0 .. areas.size() - 1.
  std::vector<int> labels;
  /// Pixels of each part, and the mean of their colors.
  Eigen::ArrayXf areas;
  Eigen::ArrayX3f colors;
};

/// Superpixels by simple linear iterative clustering (Achanta et al., PAMI 2012): k-means of color and
/// position, in which a centre competes for the pixels within `side` of it only.
///
/// colors: a row for each pixel, row by row of the image, finite; CIELAB, for distances that are those of
/// the eye. Seeds are the middles of a regular grid of about side x side pixels, and not moved off edges.
/// Remaining pieces of less than side^2 / 4 pixels join a neighbour. Throws std::invalid_argument
/// for options out of range, and for pixels that do not fill whole rows of `cols`.
ASTERISM_API SuperpixelMap slic(const Eigen::ArrayX3f& colors, int cols, const SlicOptions& options = {});

}  // namespace ASTERISM_ABI
}  // namespace asterism
