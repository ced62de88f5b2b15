#pragma once

#include <algorithm>
#include <asterism/parts/frame.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "overlay.hpp"

namespace asterism::tools {

/// Drawing in frame coordinates, in which integers are pixel centres, as cv::resize maps them. What is not
/// finite is left out.
struct Pen {
  static constexpr int kBits = 4;  // of the coordinates that OpenCV draws, below the pixel

  cv::Mat& canvas;
  View view;

  cv::Point2d map(double x, double y) const {
    return {(x + 0.5 - view.origin.x) * view.scale - 0.5, (y + 0.5 - view.origin.y) * view.scale - 0.5};
  }
  void box(const cv::Rect2d& b, const cv::Scalar& colour, int width) const {
    if (!std::isfinite(b.x + b.y + b.width + b.height)) return;
    // From the outer edge of the first pixel to that of the last one.
    const cv::Point2d a = map(b.x - 0.5, b.y - 0.5), z = map(b.x + b.width - 0.5, b.y + b.height - 0.5);
    cv::rectangle(canvas, fixed(a), fixed(z), colour, width, cv::LINE_AA, kBits);
  }
  void dot(const Point2& p, const cv::Scalar& colour, int radius) const {
    if (!p.allFinite()) return;
    cv::circle(canvas, at(p), radius << kBits, colour, cv::FILLED, cv::LINE_AA, kBits);
  }
  void line(const Point2& a, const Point2& b, const cv::Scalar& colour, int width) const {
    if (!a.allFinite() || !b.allFinite()) return;
    cv::line(canvas, at(a), at(b), colour, width, cv::LINE_AA, kBits);
  }
  /// A diagonal cross of a size on the canvas [px].
  void cross(const Point2& p, const cv::Scalar& colour, int width, double size) const {
    const Point2 arm(size / view.scale, size / view.scale), other(arm.x(), -arm.y());
    line(p - arm, p + arm, colour, width);
    line(p - other, p + other, colour, width);
  }

 private:
  cv::Point at(const Point2& p) const { return fixed(map(p.x(), p.y())); }
  static cv::Point fixed(const cv::Point2d& p) {
    // Far outside is drawn as far outside: coordinates beyond OpenCV's integers would wrap around.
    const auto one = [](double v) {
      return static_cast<int>(std::lround(std::clamp(v, -1e6, 1e6) * (1 << kBits)));
    };
    return {one(p.x), one(p.y)};
  }
};

}  // namespace asterism::tools
