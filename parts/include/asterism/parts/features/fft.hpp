#pragma once

#include <asterism/parts/features/aligned.hpp>
#include <asterism/solver/base/config.hpp>
#include <complex>
#include <memory>

namespace asterism::part_kernels_v0_1 {
struct FilterPlan;
}

namespace asterism {
inline namespace ASTERISM_ABI {

/// Batched 2-D discrete Fourier transform of real images, half spectra (Hermitian symmetry), unnormalised
/// forward, inverse divided by rows * cols: the transform of Kcf's kernels, for images and spectra in the
/// usual order. The same input gives the same output, bit for bit, on one instruction set.
///
/// Real images are `channels` planes of rows x cols, row-major, contiguous; spectra are `channels` planes of
/// rows x (cols / 2 + 1). Buffers need no alignment.
///
/// Objects of equal size share their tables; each has a workspace of its own, so that `forward` and `inverse`
/// do not allocate, and an object is for one thread at a time.
class ASTERISM_API RealFft2 {
 public:
  RealFft2() = default;
  /// All three > 0, rows and cols multiples of four, or std::invalid_argument is thrown.
  RealFft2(int rows, int cols, int channels = 1);

  /// The size that it is for.
  int rows() const { return rows_; }
  int cols() const { return cols_; }
  int channels() const { return channels_; }
  /// cols / 2 + 1
  int spectrum_cols() const { return cols_ / 2 + 1; }

  /// image (channels x rows x cols) -> spectrum (channels x rows x spectrum_cols).
  void forward(const float* image, std::complex<float>* spectrum);
  /// spectrum -> image.
  void inverse(const std::complex<float>* spectrum, float* image);

 private:
  int rows_ = 0, cols_ = 0, channels_ = 0;
  std::shared_ptr<const part_kernels_v0_1::FilterPlan> plan_;
  AlignedFloats plane_, split_, work_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
