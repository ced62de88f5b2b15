#include "features/color_terms.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace asterism {
namespace {

enum Term { Black, Blue, Brown, Gray, Green, Orange, Pink, Purple, Red, White, Yellow };

std::vector<float> shares_of(const cv::Mat& bgr, int cell) {
  std::vector<float> planes(static_cast<std::size_t>(kColorTerms * (bgr.rows / cell) * (bgr.cols / cell)));
  color_term_cells(bgr, cell, planes.data());
  return planes;
}

// Colors with undisputed names, none of them a typical color of the table.
TEST(ColorTerms, NamesColorsAsPeopleDo) {
  for (const auto& [bgr, term] :
       std::initializer_list<std::pair<cv::Scalar, Term>>{{{10, 10, 10}, Black},
                                                          {{220, 40, 20}, Blue},
                                                          {{30, 65, 110}, Brown},
                                                          {{140, 140, 140}, Gray},
                                                          {{60, 160, 40}, Green},
                                                          {{0, 130, 250}, Orange},
                                                          {{200, 160, 250}, Pink},
                                                          {{140, 20, 110}, Purple},
                                                          {{20, 10, 220}, Red},
                                                          {{250, 250, 250}, White},
                                                          {{30, 240, 250}, Yellow}}) {
    const std::vector<float> shares = shares_of(cv::Mat(4, 4, CV_8UC3, bgr), 4);
    EXPECT_EQ(std::max_element(shares.begin(), shares.end()) - shares.begin(), term) << bgr;
    EXPECT_NEAR(std::accumulate(shares.begin(), shares.end(), 0.0), 1, 1e-5) << bgr;
  }
}

// Shares are defined even for colors far from all terms; a cell's are the mean of its pixels'.
TEST(ColorTerms, ACellIsTheMeanOfItsPixels) {
  cv::Mat image(12, 16, CV_8UC3);
  cv::theRNG().state = 7;
  cv::randu(image, 0, 256);
  const std::vector<float> pixels = shares_of(image, 1), cells = shares_of(image, 4);
  for (int term = 0; term < kColorTerms; ++term)
    for (int row = 0; row < 3; ++row)
      for (int col = 0; col < 4; ++col) {
        double mean = 0;
        for (int y = 0; y < 4; ++y)
          for (int x = 0; x < 4; ++x)
            mean += static_cast<double>(
                        pixels[static_cast<std::size_t>(term * 192 + (4 * row + y) * 16 + 4 * col + x)]) /
                    16;
        EXPECT_NEAR(cells[static_cast<std::size_t>(term * 12 + row * 4 + col)], mean, 1e-5);
      }
  for (std::size_t i = 0; i < 192; ++i) {
    double sum = 0;
    for (std::size_t term = 0; term < kColorTerms; ++term) sum += static_cast<double>(pixels[term * 192 + i]);
    EXPECT_NEAR(sum, 1, 1e-5);
  }
}

}  // namespace
}  // namespace asterism
