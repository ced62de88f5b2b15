#include "color_terms.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

using Shares = std::array<float, kColorTerms>;

// Typical colors of the terms, sRGB.
constexpr std::array<std::array<int, 3>, kColorTerms> kTypical{{{0, 0, 0},
                                                                {30, 60, 200},
                                                                {120, 70, 20},
                                                                {128, 128, 128},
                                                                {30, 140, 40},
                                                                {255, 140, 0},
                                                                {255, 150, 190},
                                                                {120, 30, 150},
                                                                {210, 20, 30},
                                                                {255, 255, 255},
                                                                {250, 230, 40}}};
constexpr float kSigma = 20;  // of the Gaussian [CIELAB units]
constexpr int kBits = 5;      // of each channel that index the table
constexpr int kLevels = 1 << kBits, kColors = kLevels * kLevels * kLevels;

int index_of(const cv::Vec3b& bgr) {
  constexpr int kDropped = 8 - kBits;
  return (bgr[0] >> kDropped) | (bgr[1] >> kDropped) << kBits | (bgr[2] >> kDropped) << 2 * kBits;
}

std::vector<Shares> make_table() {
  cv::Mat bgr(kColors + kColorTerms, 1, CV_32FC3), lab;
  const auto middle = [](int level) { return (static_cast<float>(level) + 0.5f) / kLevels; };
  for (int i = 0; i < kColors; ++i)
    bgr.at<cv::Vec3f>(i) = {middle(i % kLevels), middle(i / kLevels % kLevels),
                            middle(i / kLevels / kLevels)};
  for (int k = 0; k < kColorTerms; ++k) {
    const auto& [r, g, b] = kTypical[static_cast<std::size_t>(k)];
    bgr.at<cv::Vec3f>(kColors + k) =
        cv::Vec3f(static_cast<float>(b), static_cast<float>(g), static_cast<float>(r)) / 255.0f;
  }
  cv::cvtColor(bgr, lab, cv::COLOR_BGR2Lab);

  std::vector<Shares> table(kColors);
  for (int i = 0; i < kColors; ++i) {
    Shares& shares = table[static_cast<std::size_t>(i)];
    Shares squares;
    for (int k = 0; k < kColorTerms; ++k) {
      const cv::Vec3f d = lab.at<cv::Vec3f>(i) - lab.at<cv::Vec3f>(kColors + k);
      squares[static_cast<std::size_t>(k)] = d.dot(d);
    }
    // Relative to the nearest term: otherwise a color far from all of them would give 0 / 0.
    const float nearest = *std::min_element(squares.begin(), squares.end());
    float sum = 0;
    for (std::size_t k = 0; k < shares.size(); ++k)
      sum += shares[k] = std::exp((nearest - squares[k]) / (2 * kSigma * kSigma));
    for (float& share : shares) share /= sum;
  }
  return table;
}

}  // namespace

void color_term_cells(const cv::Mat& bgr, int cell, float* planes) {
  static const std::vector<Shares> table = make_table();
  const int rows = bgr.rows / cell, cols = bgr.cols / cell, plane = rows * cols;
  const float weight = 1 / static_cast<float>(cell * cell);
  for (int row = 0; row < rows; ++row)
    for (int col = 0; col < cols; ++col) {
      Shares sum{};
      for (int y = row * cell; y < (row + 1) * cell; ++y) {
        const cv::Vec3b* pixel = bgr.ptr<cv::Vec3b>(y) + col * cell;
        for (int x = 0; x < cell; ++x) {
          const Shares& shares = table[static_cast<std::size_t>(index_of(pixel[x]))];
          for (std::size_t k = 0; k < sum.size(); ++k) sum[k] += shares[k];
        }
      }
      float* to = planes + row * cols + col;
      for (std::size_t k = 0; k < sum.size(); ++k, to += plane) *to = weight * sum[k];
    }
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
