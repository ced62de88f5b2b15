#pragma once

#include <memory>
#include <vector>

#include "part_kernels.hpp"

namespace asterism::part_kernels_v0_1 {

/// What filters of one size share: the transform's passes and twiddles, and the kernels that it is for.
struct ASTERISM_API FilterPlan {
  const KernelSet& kernels;
  Transform transform{};

  /// Filters of equal size get the same plan; from any thread. rows and cols > 0 and multiples of four.
  static std::shared_ptr<const FilterPlan> shared(int rows, int cols);

  /// Floats of the spectra of `channels` maps, of a split spectrum and of a plane.
  std::ptrdiff_t spectra_floats(int channels) const {
    return std::ptrdiff_t{2} * channels * transform.rows * transform.bins;
  }
  std::ptrdiff_t half_floats() const { return std::ptrdiff_t{transform.padded_rows} * transform.padded_bins; }
  std::ptrdiff_t plane_floats() const { return std::ptrdiff_t{transform.padded_rows} * transform.cols; }
  /// Where a plane has the element (row, col).
  std::ptrdiff_t plane_index(int row, int col) const {
    const int lanes = kernels.lanes;
    return (std::ptrdiff_t{row / lanes} * transform.cols + col) * lanes + row % lanes;
  }

  FilterPlan(const KernelSet& kernel_set, int rows, int cols);
  FilterPlan(const FilterPlan&) = delete;
  FilterPlan& operator=(const FilterPlan&) = delete;

 private:
  std::vector<float> down_, across_, real_;
};

}  // namespace asterism::part_kernels_v0_1
