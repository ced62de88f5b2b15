#pragma once

#include <Eigen/Core>
#include <asterism/solver/base/config.hpp>
#include <opencv2/core.hpp>
#include <vector>

namespace asterism::part_kernels_v0_1 {
struct KernelSet;
}

namespace asterism {
inline namespace ASTERISM_ABI {

/// Felzenszwalb's histogram of oriented gradients (PAMI 2010, Sec. 6), 31 channels a cell:
/// 0..17 contrast-sensitive orientations (channel o: gradient towards 20 o degrees, from +x towards +y),
/// 18..26 contrast-insensitive ones (18 + o: 20 o degrees, either sense), 27..30 gradient energy (texture),
/// normalised by the blocks towards the lower right, upper right, lower left and upper left.
/// All are in [0, 0.4], texture in [0, 0.85].
///
/// Unlike the common implementations no border cells are lost: a patch of rows x cols pixels gives
/// (rows / cell_size) x (cols / cell_size) cells (rounded down); pixels and block energies beyond the border
/// are replicated, pixels beyond the last whole cell serve as neighbours only. In the interior (two cells
/// from the border) the values are those of dlib::extract_fhog_features, in the same order of channels.
///
/// Gray values are taken to span 0..255: the features are invariant to contrast as far as a cell's squared
/// gradient sum is large against the regulariser 1e-4 of the block energy. Scale [0, 1] images by 255.
class ASTERISM_API Fhog {
 public:
  /// Channels of a cell.
  static constexpr int kChannels = 31;

  /// cell_size in pixels, >= 1; std::invalid_argument otherwise.
  explicit Fhog(int cell_size = 4);

  /// Side of a cell [px].
  int cell_size() const { return cell_size_; }

  /// patch: CV_8UC1 or CV_32FC1 in units of 0..255, at least one cell in each direction, or
  /// std::invalid_argument is thrown. Float values are clamped to +-1e8, so that every finite patch has
  /// finite features. features: kChannels planes of (rows / cell_size) x (cols / cell_size) floats,
  /// row-major, contiguous, overwritten. Allocates only when the patch is larger than any before; one object
  /// is for one thread at a time.
  void compute(const cv::Mat& patch, float* features);

 private:
  void reserve(int cells_x);
  void load_row(const cv::Mat& patch, int y);
  void vote_row(int y, int rows);
  void collect(int interval_row);
  void normalise_blocks(int block_row, int rows);
  void emit_row(int cell_row, float* features, std::ptrdiff_t plane) const;

  int cell_size_;
  const part_kernels_v0_1::KernelSet* kernels_;

  // Workspace of the current patch; see fhog.cpp for the layout.
  int cells_x_ = 0;    // cells of a row
  int intervals_ = 0;  // cells_x_ + 1: gaps between neighbouring cell centres, and the two half ones outside
  int stride_ = 0;     // floats of a padded row of cells
  int row_ = 0;        // floats of a padded row of pixels
  std::vector<Eigen::Array4f> votes_;
  std::vector<float> phase_weights_, pixels_, magnitude_, open_row_, histogram_, energy_, normaliser_;
  std::vector<int> slot_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
