// Compares the kernels of every instruction set that this machine has with plain code.

#include "kernels/part_kernels.hpp"

#include <gtest/gtest.h>

#include <asterism/parts/features/fhog.hpp>
#include <asterism/parts/features/patch.hpp>
#include <asterism/parts/models/kcf.hpp>
#include <asterism/parts/models/strcf.hpp>
#include <asterism/testing/part_axioms.hpp>
#include <cmath>
#include <complex>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "kernels/filter_plan.hpp"
#include "scalar_fhog.hpp"

namespace asterism {
namespace {

using part_kernels_v0_1::FilterPlan;
using part_kernels_v0_1::Isa;
using testing::ScalarFhog;

class PartKernels : public ::testing::TestWithParam<Isa> {
 protected:
  void SetUp() override {
    set_ = part_kernels_v0_1::kernels(GetParam());
    if (set_ == nullptr) GTEST_SKIP() << "not on this machine";
    part_kernels_v0_1::prefer(set_);
  }
  void TearDown() override { part_kernels_v0_1::prefer(nullptr); }

  const part_kernels_v0_1::KernelSet* set_ = nullptr;
};

std::string isa_name(const ::testing::TestParamInfo<Isa>& info) {
  return info.param == part_kernels_v0_1::kPortable ? "Portable"
         : info.param == part_kernels_v0_1::kAvx2   ? "Avx2"
                                                    : "Avx512";
}
INSTANTIATE_TEST_SUITE_P(All, PartKernels,
                         ::testing::Values(part_kernels_v0_1::kPortable, part_kernels_v0_1::kAvx2,
                                           part_kernels_v0_1::kAvx512),
                         isa_name);

cv::Mat noise(int rows, int cols, std::uint64_t seed = 1) {
  cv::Mat image(rows, cols, CV_8UC1);
  cv::RNG random(seed);
  random.fill(image, cv::RNG::UNIFORM, 0, 256);
  return image;
}

std::vector<float> random_floats(std::ptrdiff_t count, unsigned seed) {
  std::mt19937 generator(seed);
  std::vector<float> values(static_cast<std::size_t>(count));
  for (float& v : values) v = static_cast<float>(generator()) / 4294967296.0F - 0.5F;
  return values;
}

TEST_P(PartKernels, FhogIsTheScalarOne) {
  for (const int cell : {1, 2, 3, 4, 5, 8, 16}) {
    for (const auto& [rows, cols] : {std::pair{1, 1}, {2, 3}, {3, 8}, {4, 17}, {12, 12}, {13, 9}, {7, 40}}) {
      cv::Mat image = noise(rows * cell + 1, cols * cell + 1), smooth;
      cv::GaussianBlur(image, smooth, {}, 1.5);
      cv::Mat floats;
      smooth.convertTo(floats, CV_32F, 0.7);
      for (const cv::Mat& patch : {image, smooth, floats}) {
        const auto count =
            static_cast<std::size_t>(Fhog::kChannels * (patch.rows / cell) * (patch.cols / cell));
        std::vector<float> fast(count), scalar(count);
        Fhog(cell).compute(patch, fast.data());
        ScalarFhog(cell).compute(patch, scalar.data());
        for (std::size_t i = 0; i < count; ++i)
          ASSERT_NEAR(fast[i], scalar[i], 2e-6) << rows << " x " << cols << " cells of " << cell << ", " << i;
      }
    }
  }
}

// Every radix that has its own function, and some that do not.
constexpr std::pair<int, int> kSizes[] = {{4, 4},   {8, 12},  {12, 8},  {24, 24}, {52, 52}, {20, 28},
                                          {44, 36}, {76, 68}, {48, 64}, {28, 92}, {256, 4}, {4, 256}};
constexpr int kChannels = 32;

// The half spectrum of an image by OpenCV's transform in double precision.
std::vector<std::complex<double>> half_spectrum(std::vector<double>& image, int rows, int cols) {
  cv::Mat spectrum;
  cv::dft(cv::Mat(rows, cols, CV_64F, image.data()), spectrum, cv::DFT_COMPLEX_OUTPUT);
  std::vector<std::complex<double>> result;
  for (int r = 0; r < rows; ++r)
    for (int b = 0; b <= cols / 2; ++b) {
      const auto bin = spectrum.at<cv::Vec2d>(r, b);
      result.emplace_back(bin[0], bin[1]);
    }
  return result;
}

// The spectra of the channels, by the kernels and by OpenCV.
struct Spectra {
  FilterPlan plan;
  std::vector<float> maps, window, spectra, work;
  double norm = 0;

  Spectra(const part_kernels_v0_1::KernelSet& set, int rows, int cols, unsigned seed)
      : plan(set, rows, cols),
        maps(random_floats(kChannels * rows * cols, seed)),
        window(random_floats(rows * cols, seed + 1)),
        spectra(static_cast<std::size_t>(plan.spectra_floats(kChannels))),
        work(static_cast<std::size_t>(part_kernels_v0_1::work_floats(rows, cols))) {
    norm = set.forward(plan.transform, kChannels, maps.data(), window.data(), spectra.data(), work.data());
  }
  std::complex<double> at(int channel, int row, int bin) const {
    const auto& t = plan.transform;
    const int lanes = plan.kernels.lanes;
    const std::ptrdiff_t element = (std::ptrdiff_t{channel / lanes} * t.rows + row) * t.bins + bin;
    const float* const re = spectra.data() + 2 * lanes * element + channel % lanes;
    return {re[0], re[lanes]};
  }
  std::vector<std::complex<double>> expected(int channel) const {
    const auto& t = plan.transform;
    std::vector<double> image;
    for (int i = 0; i < t.rows * t.cols; ++i) {
      image.push_back(double(maps[static_cast<std::size_t>(channel * t.rows * t.cols + i)]) *
                      double(window[static_cast<std::size_t>(i)]));
    }
    return half_spectrum(image, t.rows, t.cols);
  }
};

TEST_P(PartKernels, SpectraOfChannelsAreTheTransforms) {
  for (const auto& [rows, cols] : kSizes) {
    const Spectra s(*set_, rows, cols, 1);
    double norm = 0, scale = std::sqrt(rows * cols);
    for (int k = 0; k < kChannels; ++k) {
      const auto expected = s.expected(k);
      for (int r = 0; r < rows; ++r)
        for (int b = 0; b <= cols / 2; ++b)
          ASSERT_LT(std::abs(s.at(k, r, b) - expected[static_cast<std::size_t>(r * (cols / 2 + 1) + b)]),
                    1e-6 * scale)
              << rows << " x " << cols << ", channel " << k << ", bin " << r << ", " << b;
    }
    for (std::size_t i = 0; i < s.maps.size(); ++i)
      norm += std::pow(double(s.maps[i]) * double(s.window[i % s.window.size()]), 2);
    EXPECT_NEAR(s.norm, norm, 1e-5 * norm);
  }
}

TEST_P(PartKernels, ProductsAndTheTemplatesUpdate) {
  for (const auto& [rows, cols] : kSizes) {
    const Spectra a(*set_, rows, cols, 1), b(*set_, rows, cols, 5);
    const auto& t = a.plan.transform;
    const std::ptrdiff_t half = a.plan.half_floats();
    std::vector<float> cross(static_cast<std::size_t>(2 * half)), power(cross);
    set_->correlate(t, kChannels, a.spectra.data(), b.spectra.data(), cross.data());
    Spectra updated(*set_, rows, cols, 5);
    const double norm =
        set_->train(t, kChannels, 0.3F, a.spectra.data(), updated.spectra.data(), power.data());
    const double scale = rows * cols;
    double expected_norm = 0;
    for (int r = 0; r < rows; ++r) {
      for (int i = 0; i < t.bins; ++i) {
        std::complex<double> sum = 0;
        double energy = 0;
        for (int k = 0; k < kChannels; ++k) {
          sum += a.at(k, r, i) * std::conj(b.at(k, r, i));
          energy += std::norm(a.at(k, r, i));
          const std::complex<double> z = 0.7 * b.at(k, r, i) + 0.3 * a.at(k, r, i);
          ASSERT_LT(std::abs(updated.at(k, r, i) - z), 1e-6 * std::sqrt(scale));
          expected_norm += (i == 0 || i + 1 == t.bins ? 1 : 2) * std::norm(z) / scale;
        }
        const auto at = static_cast<std::size_t>(r * t.padded_bins + i);
        const auto imaginary = at + static_cast<std::size_t>(half);
        ASSERT_LT(std::abs(std::complex<double>(cross[at], cross[imaginary]) - sum), 1e-5 * scale);
        ASSERT_NEAR(power[at], energy, 1e-5 * scale);
        ASSERT_EQ(power[imaginary], 0);
      }
    }
    EXPECT_NEAR(norm, expected_norm, 1e-5 * expected_norm);
  }
}

TEST_P(PartKernels, PlanesThereAndBack) {
  for (const auto& [rows, cols] : kSizes) {
    const FilterPlan plan(*set_, rows, cols);
    const auto& t = plan.transform;
    const std::vector<float> values = random_floats(rows * cols, 3);
    std::vector<float> plane(static_cast<std::size_t>(plan.plane_floats()));
    std::vector<float> split(static_cast<std::size_t>(2 * plan.half_floats()));
    std::vector<float> work(static_cast<std::size_t>(part_kernels_v0_1::work_floats(rows, cols)));
    const auto in_plane = [&](int r, int c) -> float& {
      return plane[static_cast<std::size_t>(plan.plane_index(r, c))];
    };
    std::vector<double> image;
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < cols; ++c) {
        in_plane(r, c) = values[static_cast<std::size_t>(r * cols + c)];
        image.push_back(double(in_plane(r, c)));
      }
    set_->forward_plane(t, plane.data(), split.data(), work.data());
    const auto expected = half_spectrum(image, rows, cols);
    for (int r = 0; r < rows; ++r)
      for (int b = 0; b < t.bins; ++b) {
        const auto at = static_cast<std::size_t>(r * t.padded_bins + b);
        const std::complex<double> bin(split[at], split[at + static_cast<std::size_t>(plan.half_floats())]);
        ASSERT_LT(std::abs(bin - expected[static_cast<std::size_t>(r * t.bins + b)]),
                  1e-6 * std::sqrt(rows * cols))
            << rows << " x " << cols;
      }
    std::fill(plane.begin(), plane.end(), 7.0F);
    set_->inverse_plane(t, split.data(), plane.data(), work.data());
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < cols; ++c)
        ASSERT_NEAR(in_plane(r, c), values[static_cast<std::size_t>(r * cols + c)], 1e-6);
  }
}

TEST_P(PartKernels, GaussianKernelIsAccurateNearOne) {
  for (const double factor : {1e-6, 1e-3, 0.1, 1.0, 30.0}) {
    std::vector<float> c(64);
    for (std::size_t i = 0; i < c.size(); ++i) c[i] = 0.02F * static_cast<float>(i);
    std::vector<float> k = c;
    const float norms = 2.4F;
    set_->gaussian(norms, static_cast<float>(factor), 64, k.data());
    for (std::size_t i = 0; i < c.size(); ++i) {
      const double d = std::max(0.0F, norms - 2 * c[i]) * static_cast<double>(static_cast<float>(factor));
      const double expected = std::expm1(-d);
      ASSERT_NEAR(k[i], expected, 4e-7 * std::abs(expected)) << d;
    }
  }
}

TEST_P(PartKernels, SamplerIsSamplePatch) {
  const cv::Mat image = noise(240, 320);
  PatchSampler sampler;
  const cv::Size grid(64, 48);
  for (const double scale : {1.0, 0.1, 0.5, 0.73, 0.999, 1.0001, 1.3, 1.9, 2.2, 3.4, 6.1, 40.0})
    for (const double x : {100.0, 100.5, 5.123, 318.7771, -40.3, 1e5}) {
      const Point2 centre(x, 60 + 0.7 * x / 100);
      const Size2 size(64 * scale, 48 * scale);
      cv::Mat expected, patch;
      sample_patch(image, centre, size, grid, expected);
      sampler.sample(image, centre, size, grid, patch);
      // The box filter may round a tie to the other side.
      EXPECT_LE(cv::norm(expected, patch, cv::NORM_INF), scale < 2 ? 0 : 1) << scale << ", " << x;
    }
  EXPECT_THROW(sampler.sample(cv::Mat(8, 8, CV_8UC3), {4, 4}, {4, 4}, grid, *std::make_unique<cv::Mat>()),
               std::invalid_argument);
}

TEST_P(PartKernels, MapsTimesWeights) {
  for (const auto& [rows, cols] : kSizes) {
    Spectra s(*set_, rows, cols, 1);
    std::vector<float> weight = random_floats(rows * cols, 9);
    std::fill(weight.begin() + cols, weight.begin() + 3 * cols, 0.0F);  // including rows of zeros
    std::vector<std::vector<std::complex<double>>> expected;
    const auto plane = static_cast<std::size_t>(rows * cols);
    for (int k = 0; k < kChannels; ++k)
      for (std::size_t i = 0; i < plane; ++i) s.maps[static_cast<std::size_t>(k) * plane + i] *= weight[i];
    for (int k = 0; k < kChannels; ++k) expected.push_back(s.expected(k));
    set_->weigh(s.plan.transform, kChannels, weight.data(), s.spectra.data(), s.work.data());
    for (int k = 0; k < kChannels; ++k)
      for (int r = 0; r < rows; ++r)
        for (int b = 0; b <= cols / 2; ++b)
          ASSERT_LT(
              std::abs(
                  s.at(k, r, b) -
                  expected[static_cast<std::size_t>(k)][static_cast<std::size_t>(r * (cols / 2 + 1) + b)]),
              2e-6 * std::sqrt(rows * cols))
              << rows << " x " << cols << ", channel " << k << ", bin " << r << ", " << b;
  }
}

// All kernels give the same filter up to rounding.
TEST_P(PartKernels, FiltersAgree) {
  const cv::Mat image = testing::texture(240, 320), moved = testing::shifted(image, 3, -2);
  const Frame frame(image), later(moved);
  const auto expect_agreement = [&](const auto& fresh) {
    const auto run = [&] {
      auto part = fresh;
      part.init(frame, {160, 120}, {50, 42});
      part.adapt(later, part.localize(later, {160, 120}).position);
      part.localize(later, {160, 120});
      return part.response().values;
    };
    part_kernels_v0_1::prefer(set_);
    const auto values = run();
    part_kernels_v0_1::prefer(part_kernels_v0_1::kernels(part_kernels_v0_1::kPortable));
    EXPECT_LT((values - run()).abs().maxCoeff(), 1e-4);
  };
  expect_agreement(Kcf());
  expect_agreement(Strcf());
  StrcfOptions rounds;
  rounds.admm_iterations = 5;
  rounds.background_weight = 3;
  expect_agreement(Strcf(rounds));
}

// A saved filter can be loaded by kernels of another layout without changing a bit.
TEST_P(PartKernels, ASavedFilterMovesToOthers) {
  const Frame frame(testing::texture(240, 320));
  const auto expect_move = [&](const auto& fresh) {
    part_kernels_v0_1::prefer(set_);
    auto part = fresh;
    part.init(frame, {160, 120}, {50, 42});
    part.adapt(frame, {161, 121});
    part.localize(frame, {158, 122});
    part_kernels_v0_1::prefer(part_kernels_v0_1::kernels(part_kernels_v0_1::kPortable));
    auto portable = fresh;
    restore_state(portable, save_state(part));
    EXPECT_EQ(save_state(portable), save_state(part));
    portable.localize(frame, {158, 122});
    EXPECT_LT((portable.response().values - part.response().values).abs().maxCoeff(), 1e-4);
  };
  for (const bool separate : {true, false}) {
    KcfOptions options;
    options.separate_update = separate;
    options.features.color = true;
    expect_move(Kcf(options));
  }
  expect_move(Strcf());
}

}  // namespace
}  // namespace asterism
