#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <asterism/parts/features/fhog.hpp>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "../solver/counting_allocator.hpp"

#ifdef ASTERISM_TEST_DLIB
#include <dlib/image_transforms.h>
#include <dlib/opencv.h>
#endif

namespace {

using asterism::Fhog;
constexpr int kChannels = Fhog::kChannels;

struct Features {
  int rows, cols;
  std::vector<float> values;
  float at(int channel, int y, int x) const {
    return values[static_cast<std::size_t>((channel * rows + y) * cols + x)];
  }
};

Features features_of(Fhog& fhog, const cv::Mat& patch) {
  const int rows = patch.rows / fhog.cell_size(), cols = patch.cols / fhog.cell_size();
  Features features{rows, cols, {}};
  features.values.assign(static_cast<std::size_t>(kChannels * rows * cols),
                         std::numeric_limits<float>::quiet_NaN());
  fhog.compute(patch, features.values.data());
  return features;
}

Features features_of(const cv::Mat& patch, int cell_size) {
  Fhog fhog(cell_size);
  return features_of(fhog, patch);
}

cv::Mat noise(int rows, int cols, std::uint64_t seed = 1) {
  cv::Mat image(rows, cols, CV_8U);
  cv::RNG random(seed);
  random.fill(image, cv::RNG::UNIFORM, 0, 256);
  return image;
}

// Edges and flat regions, as in real images, with full contrast.
cv::Mat smooth_noise(int rows, int cols, std::uint64_t seed = 1) {
  cv::Mat image = noise(rows, cols, seed);
  cv::GaussianBlur(image, image, {0, 0}, 2);
  cv::normalize(image, image, 0, 255, cv::NORM_MINMAX);
  return image;
}

// The definition, pixel by pixel, in double.
Features definition(const cv::Mat& patch, int cell) {
  constexpr std::array<std::array<double, 2>, 9> kDirections = {{{1.0000, 0.0000},
                                                                 {0.9397, 0.3420},
                                                                 {0.7660, 0.6428},
                                                                 {0.5000, 0.8660},
                                                                 {0.1736, 0.9848},
                                                                 {-0.1736, 0.9848},
                                                                 {-0.5000, 0.8660},
                                                                 {-0.7660, 0.6428},
                                                                 {-0.9397, 0.3420}}};
  const int rows = patch.rows / cell, cols = patch.cols / cell;
  cv::Mat image;
  patch.convertTo(image, CV_64F);
  const auto pixel = [&](int y, int x) {
    return image.at<double>(std::clamp(y, 0, image.rows - 1), std::clamp(x, 0, image.cols - 1));
  };
  std::vector<std::array<double, 18>> histograms(static_cast<std::size_t>(rows * cols),
                                                 std::array<double, 18>{});
  for (int y = 0; y < rows * cell; ++y) {
    for (int x = 0; x < cols * cell; ++x) {
      const double gx = pixel(y, x + 1) - pixel(y, x - 1), gy = pixel(y + 1, x) - pixel(y - 1, x);
      std::size_t best = 0;
      double best_dot = 0;
      for (std::size_t o = 0; o < 9; ++o) {
        const double dot = kDirections[o][0] * gx + kDirections[o][1] * gy;
        if (std::abs(dot) > best_dot) {
          best_dot = std::abs(dot);
          best = dot > 0 ? o : o + 9;
        }
      }
      const double yp = (y + 0.5) / cell - 0.5, xp = (x + 0.5) / cell - 0.5;
      for (const int cy : {int(std::floor(yp)), int(std::floor(yp)) + 1}) {
        for (const int cx : {int(std::floor(xp)), int(std::floor(xp)) + 1}) {
          if (cy < 0 || cy >= rows || cx < 0 || cx >= cols) continue;
          const double weight = (1 - std::abs(yp - cy)) * (1 - std::abs(xp - cx));
          histograms[static_cast<std::size_t>(cy * cols + cx)][best] += weight * std::hypot(gx, gy);
        }
      }
    }
  }
  const auto histogram = [&](int y, int x) -> const std::array<double, 18>& {
    return histograms[static_cast<std::size_t>(std::clamp(y, 0, rows - 1) * cols +
                                               std::clamp(x, 0, cols - 1))];
  };
  const auto energy = [&](int y, int x) {
    double sum = 0;
    for (std::size_t o = 0; o < 9; ++o) sum += std::pow(histogram(y, x)[o] + histogram(y, x)[o + 9], 2);
    return sum;
  };
  Features features{rows, cols, std::vector<float>(static_cast<std::size_t>(kChannels * rows * cols))};
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < cols; ++x) {
      const auto put = [&](std::size_t channel, double value) {
        features.values[(channel * static_cast<std::size_t>(rows) + static_cast<std::size_t>(y)) *
                            static_cast<std::size_t>(cols) +
                        static_cast<std::size_t>(x)] = static_cast<float>(value);
      };
      std::array<double, 4> n{};
      std::size_t k = 0;
      for (const int dx : {1, -1}) {
        for (const int dy : {1, -1}) {
          n[k++] = 1 / std::sqrt(energy(y, x) + energy(y + dy, x) + energy(y, x + dx) +
                                 energy(y + dy, x + dx) + 1e-4);
        }
      }
      const auto& h = histogram(y, x);
      const auto clipped_sum = [&](double value) {
        double sum = 0;
        for (const double scale : n) sum += std::min(value * scale, 0.2);
        return sum / 2;
      };
      for (std::size_t o = 0; o < 18; ++o) put(o, clipped_sum(h[o]));
      for (std::size_t o = 0; o < 9; ++o) put(18 + o, clipped_sum(h[o] + h[o + 9]));
      for (k = 0; k < 4; ++k) {
        double texture = 0;
        for (const double value : h) texture += std::min(value * n[k], 0.2);
        put(27 + k, 0.2357 * texture);
      }
    }
  }
  return features;
}

double max_difference(const Features& a, const Features& b) {
  EXPECT_EQ(a.rows, b.rows);
  EXPECT_EQ(a.cols, b.cols);
  double difference = 0;
  for (std::size_t i = 0; i < a.values.size(); ++i) {
    const double d = std::abs(double(a.values[i]) - double(b.values[i]));
    if (!(d <= difference)) difference = d;  // NaN is kept
    if (std::isnan(d)) return d;
  }
  return difference;
}

constexpr double kTolerance = 2e-6;

TEST(Fhog, IsTheDefinitionToTheBorder) {
  for (const int cell : {1, 2, 3, 4, 5, 6, 8, 16}) {
    for (const auto& [rows, cols] : {std::pair{48, 48}, {16, 80}, {33, 47}, {50, 17}, {19, 16}}) {
      for (const cv::Mat& image : {noise(rows, cols), smooth_noise(rows, cols)}) {
        EXPECT_LT(max_difference(features_of(image, cell), definition(image, cell)), kTolerance)
            << rows << " x " << cols << ", cell " << cell;
      }
    }
  }
}

TEST(Fhog, IsTheDefinitionForFewCells) {
  for (const int cell : {1, 3, 4}) {
    for (int rows = 1; rows <= 3; ++rows) {
      for (int cols = 1; cols <= 6; ++cols) {
        const cv::Mat image = noise(rows * cell + (cell > 1), cols * cell);
        EXPECT_LT(max_difference(features_of(image, cell), definition(image, cell)), kTolerance)
            << rows << " x " << cols << " cells of " << cell;
      }
    }
  }
}

TEST(Fhog, TiedGradientsFallIntoTheFirstOfTheTiedBins) {
  // Stripes: all gradients are exactly horizontal, or exactly vertical (a tie of 80 and 100 degrees).
  cv::Mat stripes(32, 32, CV_8U);
  for (int x = 0; x < 32; ++x) stripes.col(x).setTo(x / 4 % 2 * 200);
  EXPECT_LT(max_difference(features_of(stripes, 4), definition(stripes, 4)), kTolerance);
  EXPECT_LT(max_difference(features_of(stripes.t(), 4), definition(stripes.t(), 4)), kTolerance);
}

#ifdef ASTERISM_TEST_DLIB
TEST(Fhog, IsDlibsInTheInterior) {
  for (const int cell : {2, 3, 4, 6, 8, 1}) {
    for (const auto& [cells_y, cells_x] : {std::pair{25, 25}, {12, 30}, {31, 7}, {5, 6}}) {
      for (const cv::Mat& image :
           {noise(cells_y * cell, cells_x * cell), smooth_noise(cells_y * cell, cells_x * cell)}) {
        const Features features = features_of(image, cell);
        dlib::array2d<dlib::matrix<float, 31, 1>> expected;
        dlib::extract_fhog_features(dlib::cv_image<unsigned char>(image), expected, cell);
        ASSERT_EQ(expected.nr(), cells_y - 2);
        ASSERT_EQ(expected.nc(), cells_x - 2);
        for (int y = 2; y < cells_y - 2; ++y) {
          for (int x = 2; x < cells_x - 2; ++x) {
            for (int k = 0; k < kChannels; ++k) {
              ASSERT_NEAR(features.at(k, y, x), expected[y - 1][x - 1](k), kTolerance)
                  << "channel " << k << " of cell " << x << ", " << y << ", cell size " << cell;
            }
          }
        }
      }
    }
  }
}
#endif

TEST(Fhog, ConstantImageGivesZeros) {
  for (const int cell : {1, 4, 7}) {
    for (const double level : {0.0, 17.0, 255.0}) {
      for (const float v : features_of(cv::Mat(40, 30, CV_8U, level), cell).values) ASSERT_EQ(v, 0.0F);
    }
  }
  for (const float v : features_of(cv::Mat(40, 30, CV_32F, 1e30), 4).values) ASSERT_EQ(v, 0.0F);
}

TEST(Fhog, IsInvariantToBrightnessAndContrast) {
  cv::Mat image, changed;
  noise(64, 48).convertTo(image, CV_32F);
  image.convertTo(changed, CV_32F, 0.25, 90);
  EXPECT_LT(max_difference(features_of(image, 4), features_of(changed, 4)), 1e-4);
}

TEST(Fhog, BytesAndFloatsAgree) {
  for (const int cell : {1, 3, 4, 8}) {
    const cv::Mat bytes = smooth_noise(41, 59);
    cv::Mat floats;
    bytes.convertTo(floats, CV_32F);
    EXPECT_EQ(features_of(bytes, cell).values, features_of(floats, cell).values);
  }
}

TEST(Fhog, HalfTurnOfTheImagePermutesChannels) {
  for (const int cell : {1, 3, 4}) {
    const cv::Mat image = noise(12 * cell, 9 * cell);
    cv::Mat turned;
    cv::rotate(image, turned, cv::ROTATE_180);
    const Features a = features_of(image, cell), b = features_of(turned, cell);
    for (int y = 0; y < a.rows; ++y) {
      for (int x = 0; x < a.cols; ++x) {
        for (int k = 0; k < kChannels; ++k) {
          // The opposite direction of the gradient, and the block towards the opposite corner.
          const int opposite = k < 18 ? (k + 9) % 18 : k < 27 ? k : 27 + (30 - k);
          ASSERT_NEAR(a.at(k, y, x), b.at(opposite, a.rows - 1 - y, a.cols - 1 - x), kTolerance);
        }
      }
    }
  }
}

TEST(Fhog, ShiftByCellsShiftsTheInterior) {
  const cv::Mat large = noise(80, 80);
  const Features a = features_of(large(cv::Rect(0, 0, 64, 64)), 4),
                 b = features_of(large(cv::Rect(8, 4, 64, 64)), 4);
  for (int y = 2; y < 13; ++y) {
    for (int x = 2; x < 12; ++x) {
      for (int k = 0; k < kChannels; ++k) ASSERT_NEAR(a.at(k, y + 1, x + 2), b.at(k, y, x), kTolerance);
    }
  }
}

TEST(Fhog, ValuesStayInTheirRanges) {
  for (const cv::Mat& image : {noise(60, 60), smooth_noise(60, 60)}) {
    const Features features = features_of(image, 4);
    for (int k = 0; k < kChannels; ++k) {
      for (int y = 0; y < features.rows; ++y) {
        for (int x = 0; x < features.cols; ++x) {
          ASSERT_GE(features.at(k, y, x), 0.0F);
          ASSERT_LE(features.at(k, y, x), k < 27 ? 0.4001F : 0.8501F);
        }
      }
    }
  }
}

TEST(Fhog, FiniteImagesHaveFiniteFeatures) {
  constexpr float kHuge = std::numeric_limits<float>::max();
  constexpr std::array<float, 12> kValues = {0,     -0.0F, 1e-45F, -1e-45F, 1e-20F, -1e-20F,
                                             255.F, 1e8F,  1e20F,  -1e20F,  kHuge,  -kHuge};
  cv::RNG random(3);
  for (const int cell : {1, 4, 32}) {
    for (int trial = 0; trial < 20; ++trial) {
      cv::Mat image(64, 72, CV_32F);
      std::generate(image.begin<float>(), image.end<float>(),
                    [&] { return kValues[random.next() % kValues.size()]; });
      for (const float v : features_of(image, cell).values) {
        ASSERT_TRUE(std::isfinite(v));
        ASSERT_LE(v, 0.8501F);
      }
    }
  }
}

TEST(Fhog, PixelsThatAreNotFiniteDoNoHarmElsewhere) {
  cv::Mat image;
  noise(64, 64).convertTo(image, CV_32F);
  const Features before = features_of(image, 4);
  image.at<float>(5, 5) = std::numeric_limits<float>::quiet_NaN();
  Fhog fhog(4);
  const Features after = features_of(fhog, image);
  for (int y = 5; y < 16; ++y) {
    for (int x = 5; x < 16; ++x) ASSERT_EQ(before.at(3, y, x), after.at(3, y, x));
  }
  image.at<float>(5, 5) = 100;  // the next call does not remember large values
  EXPECT_EQ(features_of(fhog, image).values, features_of(image, 4).values);
}

TEST(Fhog, AcceptsViewsWithAnyStride) {
  const cv::Mat large = noise(70, 90);
  const cv::Mat view = large(cv::Rect(7, 11, 45, 37));
  EXPECT_EQ(features_of(view, 4).values, features_of(view.clone(), 4).values);
}

TEST(Fhog, ForgetsEarlierPatches) {
  Fhog fhog(4);
  for (const auto& [rows, cols] : {std::pair{100, 100}, {20, 60}, {64, 17}, {100, 100}, {4, 4}}) {
    const cv::Mat image = noise(rows, cols, static_cast<std::uint64_t>(rows));
    const auto first = features_of(fhog, image).values;
    EXPECT_EQ(first, features_of(fhog, image).values);
    EXPECT_EQ(first, features_of(image, 4).values);
  }
}

TEST(Fhog, AllocatesOnlyForALargerPatch) {
  const cv::Mat large = noise(200, 180), small = noise(90, 100);
  cv::Mat floats;
  small.convertTo(floats, CV_32F);
  std::vector<float> features(kChannels * 50 * 45);
  Fhog fhog(4);
  fhog.compute(large, features.data());
  const long allocated = asterism::testing::allocations_in([&] {
    fhog.compute(large, features.data());
    fhog.compute(small, features.data());
    fhog.compute(floats, features.data());
    fhog.compute(large, features.data());
  });
  EXPECT_EQ(allocated, 0);
}

TEST(Fhog, WritesNothingBeyondItsPlanes) {
  for (int cols = 4; cols <= 40; cols += 4) {
    const cv::Mat image = noise(12, cols);
    std::vector<float> features(static_cast<std::size_t>(kChannels * 3 * cols / 4 + 8), -7.0F);
    Fhog(4).compute(image, features.data());
    EXPECT_TRUE(std::all_of(features.end() - 8, features.end(), [](float v) { return v == -7.0F; }));
    EXPECT_TRUE(std::all_of(features.begin(), features.end() - 8, [](float v) { return v >= 0; }));
  }
}

template <typename Call>
std::string message_of(Call call) {
  try {
    call();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "nothing thrown";
}

TEST(Fhog, RefusesBadInput) {
  EXPECT_NE(message_of([] { Fhog(0); }).find("cell_size is 0"), std::string::npos);
  EXPECT_THROW(Fhog(-3), std::invalid_argument);
  std::vector<float> out(31);
  Fhog fhog(4);
  EXPECT_NE(message_of([&] { fhog.compute(cv::Mat(3, 40, CV_8U), out.data()); }).find("40 x 3"),
            std::string::npos);
  EXPECT_THROW(fhog.compute(cv::Mat(40, 3, CV_8U), out.data()), std::invalid_argument);
  EXPECT_THROW(fhog.compute(cv::Mat(), out.data()), std::invalid_argument);
  for (const int type : {CV_8UC3, CV_64F, CV_16U, CV_8S, CV_32FC2}) {
    EXPECT_NE(message_of([&] { fhog.compute(cv::Mat(8, 8, type), out.data()); }).find("CV_8UC1 or CV_32FC1"),
              std::string::npos);
  }
}

}  // namespace
