#pragma once

#include <asterism/solver/config.hpp>
#include <complex>
#include <memory>

namespace asterism::inline ASTERISM_ABI {

/// Batched 2-D discrete Fourier transform of real images, half spectra (Hermitian symmetry), unnormalised
/// forward, inverse divided by rows * cols. Deterministic: plans depend on nothing but the sizes.
///
/// Real images are `channels` planes of rows x cols, row-major, contiguous; spectra are `channels` planes of
/// rows x (cols / 2 + 1). Scalar: float or double.
///
/// Copies, and objects of equal size, share their (immutable) plans. `forward` and `inverse` may be called
/// from several threads with different buffers, and objects may be made in several threads; with FFTW, no
/// other code may plan at the same time unless it called fftw_make_planner_thread_safe.
///
/// Neither allocates by itself, but FFTW takes buffers of its own for some sizes, OpenCV for all. With FFTW,
/// powers of two and multiples of 8 are fastest and most odd sizes cost two to three times as much a pixel.
///
/// Buffers should be aligned as FFTW's SIMD code wants it (16 bytes: Eigen, cv::Mat and the default operator
/// new are). Others are correct too, but slower and equal only up to rounding.
template <typename Scalar>
class ASTERISM_API RealFft2 {
 public:
  RealFft2() = default;
  /// All three > 0, or std::invalid_argument is thrown.
  RealFft2(int rows, int cols, int channels = 1);

  /// The size that it is for.
  int rows() const { return rows_; }
  int cols() const { return cols_; }
  int channels() const { return channels_; }
  /// cols / 2 + 1
  int spectrum_cols() const { return cols_ / 2 + 1; }

  /// image (channels x rows x cols) -> spectrum (channels x rows x spectrum_cols).
  void forward(const Scalar* image, std::complex<Scalar>* spectrum) const;
  /// spectrum -> image; the spectrum's content is destroyed.
  void inverse(std::complex<Scalar>* spectrum, Scalar* image) const;

 private:
  struct Plans;
  int rows_ = 0, cols_ = 0, channels_ = 0;
  std::shared_ptr<const Plans> plans_;
};

extern template class RealFft2<float>;
extern template class RealFft2<double>;

}  // namespace asterism::inline ASTERISM_ABI
