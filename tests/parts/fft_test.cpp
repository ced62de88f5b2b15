#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/parts/features/fft.hpp>
#include <cmath>
#include <complex>
#include <cstring>
#include <limits>
#include <numbers>
#include <random>
#include <thread>
#include <utility>
#include <vector>

namespace {

using asterism::RealFft2;

std::vector<float> noise(int count, unsigned seed = 1) {
  std::mt19937 generator(seed);
  std::vector<float> values(static_cast<std::size_t>(count));
  for (float& v : values) v = static_cast<float>(generator()) / 4294967296.0F - 0.5F;
  return values;
}

std::vector<std::complex<float>> forward(RealFft2 fft, const std::vector<float>& image) {
  std::vector<std::complex<float>> spectrum(
      static_cast<std::size_t>(fft.channels() * fft.rows() * fft.spectrum_cols()));
  fft.forward(image.data(), spectrum.data());
  return spectrum;
}

std::vector<float> inverse(RealFft2 fft, std::vector<std::complex<float>> spectrum) {
  std::vector<float> image(static_cast<std::size_t>(fft.channels() * fft.rows() * fft.cols()));
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

// exp(-2 pi i (a / n + b / m)), more accurate than double, so that the oracles do not round.
std::complex<long double> phase(int a, int n, int b, int m) {
  const long double turns = static_cast<long double>(a % n) / n + static_cast<long double>(b % m) / m;
  return std::polar(1.0L, -2 * std::numbers::pi_v<long double> * turns);
}

// The discrete Fourier transform by its definition.
std::vector<std::complex<float>> definition(const std::vector<float>& image, int rows, int cols) {
  std::vector<std::complex<float>> spectrum;
  for (int u = 0; u < rows; ++u) {
    for (int v = 0; v <= cols / 2; ++v) {
      std::complex<long double> sum = 0;
      for (int y = 0; y < rows; ++y) {
        for (int x = 0; x < cols; ++x) {
          const long double value = image[static_cast<std::size_t>(y * cols + x)];
          sum += value * phase(u * y, rows, v * x, cols);
        }
      }
      spectrum.push_back(std::complex<float>(sum));
    }
  }
  return spectrum;
}

// Every radix that has its own function, and some that do not.
constexpr std::pair<int, int> kSizes[] = {{4, 4},   {4, 8},   {8, 4},   {8, 8},   {12, 8}, {4, 32},
                                          {20, 12}, {24, 24}, {28, 44}, {52, 36}, {16, 68}};

// Tolerance for the rounding of sums of up to a few thousand values of size 1/2.
constexpr double kTolerance = 100 * std::numeric_limits<float>::epsilon();

TEST(FftTest, IsTheDefinition) {
  for (const auto& [rows, cols] : kSizes) {
    const auto image = noise(rows * cols);
    const RealFft2 fft(rows, cols);
    EXPECT_LT(max_difference(forward(fft, image), definition(image, rows, cols)), kTolerance)
        << rows << " x " << cols;
  }
}

TEST(FftTest, InverseUndoesForward) {
  for (const auto& [rows, cols] : kSizes) {
    for (const int channels : {1, 3}) {
      const auto image = noise(channels * rows * cols);
      RealFft2 fft(rows, cols, channels);
      EXPECT_LT(max_difference(inverse(fft, forward(fft, image)), image), kTolerance)
          << rows << " x " << cols;
    }
  }
}

TEST(FftTest, BatchEqualsSingles) {
  for (const auto& [rows, cols] : kSizes) {
    constexpr int kChannels = 5;
    RealFft2 batch(rows, cols, kChannels), single(rows, cols);
    const auto images = noise(kChannels * rows * cols);
    const auto spectra = forward(batch, images);
    const auto back = inverse(batch, spectra);
    const std::ptrdiff_t pixels = rows * cols, bins = rows * batch.spectrum_cols();
    for (int k = 0; k < kChannels; ++k) {
      const std::vector<float> image(images.begin() + k * pixels, images.begin() + (k + 1) * pixels);
      const std::vector<std::complex<float>> part(spectra.begin() + k * bins,
                                                  spectra.begin() + (k + 1) * bins);
      EXPECT_LT(max_difference(forward(single, image), part), kTolerance);
      EXPECT_LT(
          max_difference(inverse(single, part), {back.begin() + k * pixels, back.begin() + (k + 1) * pixels}),
          kTolerance);
    }
  }
}

TEST(FftTest, KeepsEnergy) {  // Parseval
  for (const auto& [rows, cols] : kSizes) {
    const auto image = noise(rows * cols);
    RealFft2 fft(rows, cols);
    const auto spectrum = forward(fft, image);
    double in_space = 0, in_frequency = 0;
    for (const float v : image) in_space += double(v) * double(v);
    for (std::size_t i = 0; i < spectrum.size(); ++i) {
      const int v = static_cast<int>(i) % fft.spectrum_cols();
      in_frequency += (v == 0 || 2 * v == cols ? 1 : 2) * std::norm(std::complex<double>(spectrum[i]));
    }
    EXPECT_NEAR(in_frequency / (rows * cols), in_space, kTolerance * (1 + in_space)) << rows << " x " << cols;
  }
}

TEST(FftTest, ShiftTurnsPhases) {
  for (const auto& [rows, cols] : kSizes) {
    const int dy = 2 % rows, dx = 3 % cols;
    const auto image = noise(rows * cols);
    std::vector<float> shifted(image.size());
    for (int y = 0; y < rows; ++y) {
      for (int x = 0; x < cols; ++x) {
        shifted[static_cast<std::size_t>((y + dy) % rows * cols + (x + dx) % cols)] =
            image[static_cast<std::size_t>(y * cols + x)];
      }
    }
    RealFft2 fft(rows, cols);
    auto expected = forward(fft, image);
    for (std::size_t i = 0; i < expected.size(); ++i) {
      const int u = static_cast<int>(i) / fft.spectrum_cols(), v = static_cast<int>(i) % fft.spectrum_cols();
      expected[i] *= std::complex<float>(phase(u * dy, rows, v * dx, cols));
    }
    EXPECT_LT(max_difference(forward(fft, shifted), expected), kTolerance) << rows << " x " << cols;
  }
}

TEST(FftTest, ImpulseHasFlatSpectrum) {
  RealFft2 fft(12, 20);
  std::vector<float> image(240);
  image[0] = 1;
  for (const auto& bin : forward(fft, image)) EXPECT_LT(std::abs(bin - 1.0F), kTolerance);
}

// The correlation filters rely on circular convolution by products of spectra.
TEST(FftTest, ProductOfSpectraIsConvolution) {
  const int rows = 8, cols = 12;
  const auto a = noise(rows * cols, 1), b = noise(rows * cols, 2);
  RealFft2 fft(rows, cols);
  auto product = forward(fft, a);
  const auto other = forward(fft, b);
  for (std::size_t i = 0; i < product.size(); ++i) product[i] *= other[i];
  std::vector<float> expected(a.size());
  for (int i = 0; i < rows * cols; ++i) {
    for (int j = 0; j < rows * cols; ++j) {
      const int y = (i / cols + j / cols) % rows, x = (i % cols + j % cols) % cols;
      expected[static_cast<std::size_t>(y * cols + x)] +=
          a[static_cast<std::size_t>(i)] * b[static_cast<std::size_t>(j)];
    }
  }
  EXPECT_LT(max_difference(inverse(fft, product), expected), kTolerance);
}

TEST(FftTest, SameInputSameBits) {
  for (const auto& [rows, cols] : {std::pair{52, 52}, {24, 32}, {20, 12}}) {
    const auto image = noise(4 * rows * cols);
    std::vector<std::complex<float>> first;
    {
      RealFft2 fft(rows, cols, 4);
      first = forward(fft, image);
      EXPECT_TRUE(same_bits(forward(fft, image), first));
      EXPECT_TRUE(same_bits(forward(RealFft2(fft), image), first));
      EXPECT_TRUE(same_bits(forward(RealFft2(rows, cols, 4), image), first));
    }
    RealFft2 anew(rows, cols, 4);  // the first plan is gone
    EXPECT_TRUE(same_bits(forward(anew, image), first));
    EXPECT_TRUE(same_bits(inverse(anew, first), inverse(RealFft2(rows, cols, 4), first)));
  }
}

TEST(FftTest, BuffersMayBeUnaligned) {
  const int rows = 12, cols = 20, channels = 3;
  RealFft2 fft(rows, cols, channels);
  const auto image = noise(channels * rows * cols);
  const auto spectrum = forward(fft, image);
  for (const std::size_t image_offset : {0U, 1U, 2U, 3U}) {
    for (const std::size_t spectrum_offset : {0U, 1U, 3U}) {
      std::vector<float> moved_image(image.size() + image_offset);
      std::copy(image.begin(), image.end(), moved_image.begin() + static_cast<std::ptrdiff_t>(image_offset));
      // An odd offset in floats: std::complex<float> is only aligned as float is.
      std::vector<float> storage(2 * spectrum.size() + spectrum_offset);
      auto* const moved_spectrum = reinterpret_cast<std::complex<float>*>(storage.data() + spectrum_offset);
      fft.forward(moved_image.data() + image_offset, moved_spectrum);
      EXPECT_LT(max_difference({moved_spectrum, moved_spectrum + spectrum.size()}, spectrum), kTolerance);
      std::fill(moved_image.begin(), moved_image.end(), 0.0F);
      fft.inverse(moved_spectrum, moved_image.data() + image_offset);
      moved_image.erase(moved_image.begin(), moved_image.begin() + static_cast<std::ptrdiff_t>(image_offset));
      EXPECT_LT(max_difference(moved_image, image), kTolerance);
    }
  }
}

TEST(FftTest, ForwardKeepsItsInput) {
  for (const auto& [rows, cols] : kSizes) {
    const auto image = noise(2 * rows * cols);
    const auto copy = image;
    forward(RealFft2(rows, cols, 2), image);
    EXPECT_TRUE(same_bits(image, copy));
  }
}

TEST(FftTest, ThreadsAgree) {
  const auto image = noise(2 * 20 * 24);
  const auto expected = forward(RealFft2(20, 24, 2), image);
  std::vector<std::vector<std::complex<float>>> results(6);
  std::vector<std::thread> threads;
  for (auto& result : results) {
    threads.emplace_back([&] {
      for (int i = 0; i < 20; ++i) {
        RealFft2 other(4 + 4 * (i % 4), 8, 1), fft(20, 24, 2);
        result = forward(fft, image);
      }
    });
  }
  for (auto& thread : threads) thread.join();
  for (const auto& result : results) EXPECT_TRUE(same_bits(result, expected));
}

TEST(FftTest, SizesMustBePositiveMultiplesOfFour) {
  EXPECT_THROW(RealFft2(0, 4), std::invalid_argument);
  EXPECT_THROW(RealFft2(4, -1), std::invalid_argument);
  EXPECT_THROW(RealFft2(4, 4, 0), std::invalid_argument);
  EXPECT_THROW(RealFft2(4, 6), std::invalid_argument);
  EXPECT_THROW(RealFft2(6, 4), std::invalid_argument);
  const RealFft2 fft(4, 8, 2);
  EXPECT_EQ(fft.rows(), 4);
  EXPECT_EQ(fft.cols(), 8);
  EXPECT_EQ(fft.channels(), 2);
  EXPECT_EQ(fft.spectrum_cols(), 5);
}

}  // namespace
