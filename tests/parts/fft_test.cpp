// Compiled once for each FFT back end; FFT_BACK_END names it in the test's names.
#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/parts/fft.hpp>
#include <cmath>
#include <complex>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <numbers>
#include <random>
#include <string>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

#ifdef ASTERISM_TEST_FFTW
#include <fftw3.h>
#endif

namespace {

using asterism::RealFft2;

template <typename Scalar>
std::vector<Scalar> noise(int count, unsigned seed = 1) {
  std::mt19937 generator(seed);
  std::vector<Scalar> values(static_cast<std::size_t>(count));
  for (Scalar& v : values) v = static_cast<Scalar>(generator()) / Scalar(4294967296.0) - Scalar(0.5);
  return values;
}

template <typename Scalar>
std::vector<std::complex<Scalar>> forward(const RealFft2<Scalar>& fft, const std::vector<Scalar>& image) {
  std::vector<std::complex<Scalar>> spectrum(
      static_cast<std::size_t>(fft.channels() * fft.rows() * fft.spectrum_cols()));
  fft.forward(image.data(), spectrum.data());
  return spectrum;
}

template <typename Scalar>
std::vector<Scalar> inverse(const RealFft2<Scalar>& fft, std::vector<std::complex<Scalar>> spectrum) {
  std::vector<Scalar> image(static_cast<std::size_t>(fft.channels() * fft.rows() * fft.cols()));
  fft.inverse(spectrum.data(), image.data());
  return image;
}

template <typename Value>
double max_difference(const std::vector<Value>& a, const std::vector<Value>& b) {
  EXPECT_EQ(a.size(), b.size());
  double difference = 0;
  for (std::size_t i = 0; i < a.size(); ++i) difference = std::max(difference, double(std::abs(a[i] - b[i])));
  return difference;
}

template <typename Value>
bool same_bits(const std::vector<Value>& a, const std::vector<Value>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(Value)) == 0;
}

// exp(-2 pi i (a / n + b / m)), better than double: the oracles must not be what rounds.
std::complex<long double> phase(int a, int n, int b, int m) {
  const long double turns = static_cast<long double>(a % n) / n + static_cast<long double>(b % m) / m;
  return std::polar(1.0L, -2 * std::numbers::pi_v<long double> * turns);
}

// The definition.
template <typename Scalar>
std::vector<std::complex<Scalar>> definition(const std::vector<Scalar>& image, int rows, int cols) {
  std::vector<std::complex<Scalar>> spectrum;
  for (int u = 0; u < rows; ++u) {
    for (int v = 0; v <= cols / 2; ++v) {
      std::complex<long double> sum = 0;
      for (int y = 0; y < rows; ++y) {
        for (int x = 0; x < cols; ++x) {
          const long double value = image[static_cast<std::size_t>(y * cols + x)];
          sum += value * phase(u * y, rows, v * x, cols);
        }
      }
      spectrum.push_back(std::complex<Scalar>(sum));
    }
  }
  return spectrum;
}

constexpr std::pair<int, int> kSizes[] = {{1, 1}, {1, 2},  {2, 1},  {1, 7},   {7, 1},   {1, 8},
                                          {8, 1}, {2, 2},  {2, 3},  {3, 2},   {3, 5},   {4, 6},
                                          {5, 4}, {8, 8},  {9, 12}, {15, 10}, {7, 7},   {6, 1},
                                          {1, 6}, {11, 6}, {25, 8}, {13, 17}, {16, 31}, {24, 24}};

template <typename Scalar>
class FftTest : public testing::Test {
 protected:
  // Rounding of sums of up to a thousand values of size 1/2.
  static constexpr double kTolerance = 100 * std::numeric_limits<Scalar>::epsilon();
};

struct BackEndName {
  template <typename Scalar>
  static std::string GetName(int) {
    return std::string(FFT_BACK_END) + (std::is_same_v<Scalar, float> ? "Float" : "Double");
  }
};

using Scalars = testing::Types<float, double>;
TYPED_TEST_SUITE(FftTest, Scalars, BackEndName);

TYPED_TEST(FftTest, IsTheDefinition) {
  for (const auto& [rows, cols] : kSizes) {
    const auto image = noise<TypeParam>(rows * cols);
    const RealFft2<TypeParam> fft(rows, cols);
    EXPECT_LT(max_difference(forward(fft, image), definition(image, rows, cols)), this->kTolerance)
        << rows << " x " << cols;
  }
}

TYPED_TEST(FftTest, InverseUndoesForward) {
  for (const auto& [rows, cols] : kSizes) {
    for (const int channels : {1, 3}) {
      const auto image = noise<TypeParam>(channels * rows * cols);
      const RealFft2<TypeParam> fft(rows, cols, channels);
      EXPECT_LT(max_difference(inverse(fft, forward(fft, image)), image), this->kTolerance)
          << rows << " x " << cols;
    }
  }
}

TYPED_TEST(FftTest, BatchEqualsSingles) {
  for (const auto& [rows, cols] : kSizes) {
    constexpr int kChannels = 5;
    const RealFft2<TypeParam> batch(rows, cols, kChannels), single(rows, cols);
    const auto images = noise<TypeParam>(kChannels * rows * cols);
    const auto spectra = forward(batch, images);
    const auto back = inverse(batch, spectra);
    const std::ptrdiff_t pixels = rows * cols, bins = rows * batch.spectrum_cols();
    for (int k = 0; k < kChannels; ++k) {
      const std::vector<TypeParam> image(images.begin() + k * pixels, images.begin() + (k + 1) * pixels);
      const std::vector<std::complex<TypeParam>> part(spectra.begin() + k * bins,
                                                      spectra.begin() + (k + 1) * bins);
      EXPECT_LT(max_difference(forward(single, image), part), this->kTolerance);
      EXPECT_LT(
          max_difference(inverse(single, part), {back.begin() + k * pixels, back.begin() + (k + 1) * pixels}),
          this->kTolerance);
    }
  }
}

TYPED_TEST(FftTest, KeepsEnergy) {  // Parseval
  for (const auto& [rows, cols] : kSizes) {
    const auto image = noise<TypeParam>(rows * cols);
    const RealFft2<TypeParam> fft(rows, cols);
    const auto spectrum = forward(fft, image);
    double in_space = 0, in_frequency = 0;
    for (const TypeParam v : image) in_space += double(v) * double(v);
    for (std::size_t i = 0; i < spectrum.size(); ++i) {
      const int v = static_cast<int>(i) % fft.spectrum_cols();
      in_frequency += (v == 0 || 2 * v == cols ? 1 : 2) * std::norm(std::complex<double>(spectrum[i]));
    }
    EXPECT_NEAR(in_frequency / (rows * cols), in_space, this->kTolerance * (1 + in_space))
        << rows << " x " << cols;
  }
}

TYPED_TEST(FftTest, ShiftTurnsPhases) {
  for (const auto& [rows, cols] : kSizes) {
    const int dy = 2 % rows, dx = 3 % cols;
    const auto image = noise<TypeParam>(rows * cols);
    std::vector<TypeParam> shifted(image.size());
    for (int y = 0; y < rows; ++y) {
      for (int x = 0; x < cols; ++x) {
        shifted[static_cast<std::size_t>((y + dy) % rows * cols + (x + dx) % cols)] =
            image[static_cast<std::size_t>(y * cols + x)];
      }
    }
    const RealFft2<TypeParam> fft(rows, cols);
    auto expected = forward(fft, image);
    for (std::size_t i = 0; i < expected.size(); ++i) {
      const int u = static_cast<int>(i) / fft.spectrum_cols(), v = static_cast<int>(i) % fft.spectrum_cols();
      expected[i] *= std::complex<TypeParam>(phase(u * dy, rows, v * dx, cols));
    }
    EXPECT_LT(max_difference(forward(fft, shifted), expected), this->kTolerance) << rows << " x " << cols;
  }
}

TYPED_TEST(FftTest, ImpulseHasFlatSpectrum) {
  const RealFft2<TypeParam> fft(10, 9);
  std::vector<TypeParam> image(90);
  image[0] = 1;
  for (const auto& bin : forward(fft, image)) EXPECT_LT(std::abs(bin - TypeParam(1)), this->kTolerance);
}

// Circular convolution through the spectra is what the correlation filters need.
TYPED_TEST(FftTest, ProductOfSpectraIsConvolution) {
  const int rows = 6, cols = 9;
  const auto a = noise<TypeParam>(rows * cols, 1), b = noise<TypeParam>(rows * cols, 2);
  const RealFft2<TypeParam> fft(rows, cols);
  auto product = forward(fft, a);
  const auto other = forward(fft, b);
  for (std::size_t i = 0; i < product.size(); ++i) product[i] *= other[i];
  std::vector<TypeParam> expected(a.size());
  for (int i = 0; i < rows * cols; ++i) {
    for (int j = 0; j < rows * cols; ++j) {
      const int y = (i / cols + j / cols) % rows, x = (i % cols + j % cols) % cols;
      expected[static_cast<std::size_t>(y * cols + x)] +=
          a[static_cast<std::size_t>(i)] * b[static_cast<std::size_t>(j)];
    }
  }
  EXPECT_LT(max_difference(inverse(fft, product), expected), this->kTolerance);
}

TYPED_TEST(FftTest, SameInputSameBits) {
  for (const auto& [rows, cols] : {std::pair{50, 50}, {24, 30}, {17, 13}}) {
    const auto image = noise<TypeParam>(4 * rows * cols);
    std::vector<std::complex<TypeParam>> first;
    {
      const RealFft2<TypeParam> fft(rows, cols, 4);
      first = forward(fft, image);
      EXPECT_TRUE(same_bits(forward(fft, image), first));
      EXPECT_TRUE(same_bits(forward(RealFft2<TypeParam>(fft), image), first));
      EXPECT_TRUE(same_bits(forward(RealFft2<TypeParam>(rows, cols, 4), image), first));
    }
    const RealFft2<TypeParam> anew(rows, cols, 4);  // the first plan is gone
    EXPECT_TRUE(same_bits(forward(anew, image), first));
    EXPECT_TRUE(same_bits(inverse(anew, first), inverse(RealFft2<TypeParam>(rows, cols, 4), first)));
  }
}

TYPED_TEST(FftTest, BuffersMayBeUnaligned) {
  const int rows = 12, cols = 10, channels = 3;
  const RealFft2<TypeParam> fft(rows, cols, channels);
  const auto image = noise<TypeParam>(channels * rows * cols);
  const auto spectrum = forward(fft, image);
  for (const std::size_t image_offset : {0U, 1U, 2U, 3U}) {
    for (const std::size_t spectrum_offset : {0U, 1U, 3U}) {
      std::vector<TypeParam> moved_image(image.size() + image_offset);
      std::copy(image.begin(), image.end(), moved_image.begin() + static_cast<std::ptrdiff_t>(image_offset));
      // An odd offset in scalars: std::complex<Scalar> is only aligned as Scalar is.
      std::vector<TypeParam> storage(2 * spectrum.size() + spectrum_offset);
      auto* const moved_spectrum =
          reinterpret_cast<std::complex<TypeParam>*>(storage.data() + spectrum_offset);
      fft.forward(moved_image.data() + image_offset, moved_spectrum);
      EXPECT_LT(max_difference({moved_spectrum, moved_spectrum + spectrum.size()}, spectrum),
                this->kTolerance);
      std::fill(moved_image.begin(), moved_image.end(), TypeParam(0));
      fft.inverse(moved_spectrum, moved_image.data() + image_offset);
      moved_image.erase(moved_image.begin(), moved_image.begin() + static_cast<std::ptrdiff_t>(image_offset));
      EXPECT_LT(max_difference(moved_image, image), this->kTolerance);
    }
  }
}

TYPED_TEST(FftTest, ForwardKeepsItsInput) {
  for (const auto& [rows, cols] : kSizes) {
    const auto image = noise<TypeParam>(2 * rows * cols);
    const auto copy = image;
    forward(RealFft2<TypeParam>(rows, cols, 2), image);
    EXPECT_TRUE(same_bits(image, copy));
  }
}

TYPED_TEST(FftTest, ThreadsAgree) {
  const auto image = noise<TypeParam>(2 * 20 * 24);
  const auto expected = forward(RealFft2<TypeParam>(20, 24, 2), image);
  std::vector<std::vector<std::complex<TypeParam>>> results(6);
  std::vector<std::thread> threads;
  for (auto& result : results) {
    threads.emplace_back([&] {
      for (int i = 0; i < 20; ++i) {
        const RealFft2<TypeParam> other(3 + i % 4, 5, 1), fft(20, 24, 2);
        result = forward(fft, image);
      }
    });
  }
  for (auto& thread : threads) thread.join();
  for (const auto& result : results) EXPECT_TRUE(same_bits(result, expected));
}

TYPED_TEST(FftTest, SizesMustBePositive) {
  EXPECT_THROW(RealFft2<TypeParam>(0, 4), std::invalid_argument);
  EXPECT_THROW(RealFft2<TypeParam>(4, -1), std::invalid_argument);
  EXPECT_THROW(RealFft2<TypeParam>(4, 4, 0), std::invalid_argument);
  const RealFft2<TypeParam> fft(4, 7, 2);
  EXPECT_EQ(fft.rows(), 4);
  EXPECT_EQ(fft.cols(), 7);
  EXPECT_EQ(fft.channels(), 2);
  EXPECT_EQ(fft.spectrum_cols(), 4);
}

#ifdef ASTERISM_TEST_FFTW
// A program that measures the same transform must not change our rounding, nor lose what it measured.
TEST(FftwWisdom, IsNeitherUsedNorChanged) {
  constexpr int kRows = 50, kCols = 48;
  const auto image = noise<float>(kRows * kCols);
  const auto before = forward(RealFft2<float>(kRows, kCols), image);
  auto* const real = fftwf_alloc_real(kRows * kCols);
  auto* const complex = fftwf_alloc_complex(kRows * (kCols / 2 + 1));
  fftwf_plan const measured = fftwf_plan_dft_r2c_2d(kRows, kCols, real, complex, FFTW_MEASURE);
  const auto wisdom = [] {
    char* const text = fftwf_export_wisdom_to_string();
    const std::string copy(text);
    std::free(text);
    return copy;
  };
  const std::string wisdom_before = wisdom();
  const auto after = forward(RealFft2<float>(kRows, kCols), image);
  EXPECT_TRUE(same_bits(before, after));
  // FFTW writes its table of wisdom in no particular order.
  EXPECT_EQ(wisdom().size(), wisdom_before.size());
  fftwf_destroy_plan(measured);
  fftwf_free(real);
  fftwf_free(complex);
}
#endif

}  // namespace
