#pragma once

#include <memory>
#include <vector>

#include "part_kernels.hpp"

namespace asterism::part_kernels_v0_1 {

/// What filters of one size share: the passes and twiddle factors of the transform, and the kernels that run
/// it.
struct ASTERISM_API FilterPlan {
  const KernelSet& kernels;
  Transform transform{};

  /// Returns the same plan for equal sizes; thread-safe. rows and cols are > 0 and multiples of four.
  static std::shared_ptr<const FilterPlan> shared(int rows, int cols);

  /// Number of floats in the spectra of `channels` maps, in a split spectrum and in a plane.
  std::ptrdiff_t spectra_floats(int channels) const {
    return std::ptrdiff_t{2} * channels * transform.rows * transform.bins;
  }
  std::ptrdiff_t half_floats() const { return std::ptrdiff_t{transform.padded_rows} * transform.padded_bins; }
  std::ptrdiff_t plane_floats() const { return std::ptrdiff_t{transform.padded_rows} * transform.cols; }
  /// Index of element (row, col) in a plane.
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
