#pragma once

#include <asterism/solver/config.hpp>
#include <opencv2/core.hpp>
#include <vector>

namespace asterism::inline ASTERISM_ABI {

/// Felzenszwalb's histogram of oriented gradients (PAMI 2010, Sec. 6), 31 channels a cell: 18 contrast-sensitive
/// orientations, 9 contrast-insensitive ones, 4 gradient-energy (texture) channels.
///
/// Unlike the common implementations no border cells are lost: a patch of rows x cols pixels gives
/// (rows / cell_size) x (cols / cell_size) cells (rounded down); block energies beyond the border are replicated.
/// In the interior the values are those of dlib::extract_fhog_features.
class Fhog {
 public:
  static constexpr int kChannels = 31;

  /// cell_size in pixels, >= 1; std::invalid_argument otherwise.
  explicit Fhog(int cell_size = 4);

  int cell_size() const { return cell_size_; }

  /// patch: CV_8UC1 or CV_32FC1 (any scale: the features are invariant to contrast), at least one cell in each
  /// direction. features: kChannels planes of (rows / cell_size) x (cols / cell_size) floats, row-major,
  /// contiguous, overwritten. Allocates only when the patch is larger than any before.
  void compute(const cv::Mat& patch, float* features);

 private:
  int cell_size_;
  std::vector<float> histogram_, energy_, scratch_;
};

}  // namespace asterism::inline ASTERISM_ABI
