#include <asterism/parts/fft.hpp>
#include <cstddef>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>

namespace asterism::inline ASTERISM_ABI {

// OpenCV's dft packs the Hermitian spectrum of a real image into an image of the same size: column 0 holds
// the bins (r, 0) as Re 0, Re 1, Im 1, Re 2, Im 2, .. downwards (the last one real where rows is even), the
// last column of an even number of columns holds the bins (r, cols / 2) likewise, and between them columns 2
// c - 1 and 2 c hold real and imaginary part of bin (r, c). Half the work of a complex transform.
template <typename Scalar>
struct RealFft2<Scalar>::Plans {
  using Complex = std::complex<Scalar>;

  static cv::Mat buffer(int rows, int cols) { return {rows, cols, cv::traits::Type<Scalar>::value}; }

  // Column `packed_col` of the packed image <-> column `bin` of the half spectrum, both conjugate-symmetric
  // in r.
  static void unpack_column(const cv::Mat& packed, int packed_col, Complex* spectrum, int bin) {
    const int rows = packed.rows, stride = packed.cols / 2 + 1;
    const auto at = [&](int r) { return packed.at<Scalar>(r, packed_col); };
    spectrum[bin] = at(0);
    for (int r = 1; 2 * r < rows; ++r) {
      const Complex value(at(2 * r - 1), at(2 * r));
      spectrum[r * stride + bin] = value;
      spectrum[(rows - r) * stride + bin] = std::conj(value);
    }
    if (rows % 2 == 0) spectrum[rows / 2 * stride + bin] = at(rows - 1);
  }
  static void pack_column(const Complex* spectrum, int bin, cv::Mat& packed, int packed_col) {
    const int rows = packed.rows, stride = packed.cols / 2 + 1;
    const auto at = [&](int r) -> Scalar& { return packed.at<Scalar>(r, packed_col); };
    at(0) = spectrum[bin].real();
    for (int r = 1; 2 * r < rows; ++r) {
      at(2 * r - 1) = spectrum[r * stride + bin].real();
      at(2 * r) = spectrum[r * stride + bin].imag();
    }
    if (rows % 2 == 0) at(rows - 1) = spectrum[rows / 2 * stride + bin].real();
  }

  static void unpack(const cv::Mat& packed, Complex* spectrum) {
    const int cols = packed.cols, stride = cols / 2 + 1;
    for (int r = 0; r < packed.rows; ++r) {
      const Scalar* const row = packed.ptr<Scalar>(r);
      for (int c = 1; 2 * c < cols; ++c) spectrum[r * stride + c] = {row[2 * c - 1], row[2 * c]};
    }
    unpack_column(packed, 0, spectrum, 0);
    if (cols % 2 == 0) unpack_column(packed, cols - 1, spectrum, cols / 2);
  }
  static void pack(const Complex* spectrum, cv::Mat& packed) {
    const int cols = packed.cols, stride = cols / 2 + 1;
    for (int r = 0; r < packed.rows; ++r) {
      Scalar* const row = packed.ptr<Scalar>(r);
      for (int c = 1; 2 * c < cols; ++c) {
        row[2 * c - 1] = spectrum[r * stride + c].real();
        row[2 * c] = spectrum[r * stride + c].imag();
      }
    }
    pack_column(spectrum, 0, packed, 0);
    if (cols % 2 == 0) pack_column(spectrum, cols / 2, packed, cols - 1);
  }
};

template <typename Scalar>
RealFft2<Scalar>::RealFft2(int rows, int cols, int channels) : rows_(rows), cols_(cols), channels_(channels) {
  if (rows < 1 || cols < 1 || channels < 1) {
    throw std::invalid_argument("RealFft2: rows, cols and channels must be > 0, are " + std::to_string(rows) +
                                ", " + std::to_string(cols) + ", " + std::to_string(channels));
  }
}

template <typename Scalar>
void RealFft2<Scalar>::forward(const Scalar* image, std::complex<Scalar>* spectrum) const {
  const std::ptrdiff_t pixels = std::ptrdiff_t{rows_} * cols_, bins = std::ptrdiff_t{rows_} * spectrum_cols();
  cv::Mat packed = Plans::buffer(rows_, cols_);
  for (int k = 0; k < channels_; ++k) {
    const cv::Mat plane(rows_, cols_, packed.type(), const_cast<Scalar*>(image + k * pixels));
    cv::dft(plane, packed);
    Plans::unpack(packed, spectrum + k * bins);
  }
}

template <typename Scalar>
void RealFft2<Scalar>::inverse(std::complex<Scalar>* spectrum, Scalar* image) const {
  const std::ptrdiff_t pixels = std::ptrdiff_t{rows_} * cols_, bins = std::ptrdiff_t{rows_} * spectrum_cols();
  cv::Mat packed = Plans::buffer(rows_, cols_);
  for (int k = 0; k < channels_; ++k) {
    Plans::pack(spectrum + k * bins, packed);
    cv::Mat plane(rows_, cols_, packed.type(), image + k * pixels);
    cv::dft(packed, plane, cv::DFT_INVERSE | cv::DFT_SCALE | cv::DFT_REAL_OUTPUT);
  }
}

template class RealFft2<float>;
template class RealFft2<double>;

}  // namespace asterism::inline ASTERISM_ABI
