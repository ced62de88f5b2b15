#include <asterism/parts/features/fft.hpp>
#include <cstddef>
#include <stdexcept>
#include <string>

#include "../kernels/filter_plan.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

RealFft2::RealFft2(int rows, int cols, int channels) : rows_(rows), cols_(cols), channels_(channels) {
  if (rows < 1 || cols < 1 || channels < 1 || rows % 4 != 0 || cols % 4 != 0) {
    throw std::invalid_argument("RealFft2: rows, cols and channels must be > 0, rows and cols multiples of " +
                                ("four, are " + std::to_string(rows)) + ", " + std::to_string(cols) + ", " +
                                std::to_string(channels));
  }
  plan_ = part_kernels_v0_1::FilterPlan::shared(rows, cols);
  plane_.reset(plan_->plane_floats());
  split_.reset(2 * plan_->half_floats());
  work_.reset(part_kernels_v0_1::work_floats(rows, cols));
}

void RealFft2::forward(const float* image, std::complex<float>* spectrum) {
  const part_kernels_v0_1::Transform& t = plan_->transform;
  const std::ptrdiff_t lanes = plan_->kernels.lanes;
  const float *const real = split_.data(), *const imaginary = real + plan_->half_floats();
  for (int channel = 0; channel < channels_; ++channel) {
    for (int r = 0; r < rows_; ++r, image += cols_) {
      float* const to = plane_.data() + plan_->plane_index(r, 0);
      for (int c = 0; c < cols_; ++c) to[c * lanes] = image[c];
    }
    plan_->kernels.forward_plane(t, plane_.data(), split_.data(), work_.data());
    for (int r = 0; r < rows_; ++r, spectrum += t.bins) {
      const std::ptrdiff_t row = std::ptrdiff_t{r} * t.padded_bins;
      for (int b = 0; b < t.bins; ++b) spectrum[b] = {real[row + b], imaginary[row + b]};
    }
  }
}

void RealFft2::inverse(const std::complex<float>* spectrum, float* image) {
  const part_kernels_v0_1::Transform& t = plan_->transform;
  const std::ptrdiff_t lanes = plan_->kernels.lanes;
  float *const real = split_.data(), *const imaginary = real + plan_->half_floats();
  for (int channel = 0; channel < channels_; ++channel) {
    for (int r = 0; r < rows_; ++r, spectrum += t.bins) {
      const std::ptrdiff_t row = std::ptrdiff_t{r} * t.padded_bins;
      for (int b = 0; b < t.bins; ++b) {
        real[row + b] = spectrum[b].real();
        imaginary[row + b] = spectrum[b].imag();
      }
    }
    plan_->kernels.inverse_plane(t, split_.data(), plane_.data(), work_.data());
    for (int r = 0; r < rows_; ++r, image += cols_) {
      const float* const from = plane_.data() + plan_->plane_index(r, 0);
      for (int c = 0; c < cols_; ++c) image[c] = from[c * lanes];
    }
  }
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
