#pragma once

// An independent implementation of the features of CellSpectra.

#include <Eigen/Core>
#include <asterism/parts/features/cell_spectra.hpp>
#include <asterism/parts/features/patch.hpp>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace asterism::testing {

/// Features as the documentation of CellFeatures describes them: one column of cells (row-major) per channel,
/// under a Hann window.
inline Eigen::MatrixXd cell_features(const Frame& frame, const Point2& centre, const Size2& window, int rows,
                                     int cols, int cell, const CellFeatures& features) {
  cv::Mat patch, lab;
  sample_patch(frame.gray(), centre, window, {cols * cell, rows * cell}, patch);
  sample_patch(frame.bgr(), centre, window, {cols, rows}, lab);
  cv::cvtColor(lab, lab, cv::COLOR_BGR2Lab);
  Eigen::ArrayXf hog(Fhog::kChannels * rows * cols);
  Fhog(cell).compute(patch, hog.data());
  const auto& [has_hog, has_gray, has_color, own] = features;
  if (own != nullptr) throw std::invalid_argument("cell_features: no channels of a program's own");
  Eigen::MatrixXd x(rows * cols, 31 * has_hog + has_gray + 2 * has_color);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) {
      const double hann = (0.5 - 0.5 * std::cos(2 * std::numbers::pi * r / (rows - 1))) *
                          (0.5 - 0.5 * std::cos(2 * std::numbers::pi * c / (cols - 1)));
      int k = 0;
      const auto add = [&](double value) { x(r * cols + c, k++) = hann * value; };
      for (int h = 0; has_hog && h < Fhog::kChannels; ++h) add(hog(h * rows * cols + r * cols + c));
      const double mean = cv::mean(patch(cv::Rect(c * cell, r * cell, cell, cell)))[0];
      if (has_gray) add(std::nearbyint(mean) / 255 - 0.5);
      for (int axis = 1; has_color && axis < 3; ++axis) add((lab.at<cv::Vec3b>(r, c)[axis] - 128) / 128.0);
    }
  return x;
}

}  // namespace asterism::testing
