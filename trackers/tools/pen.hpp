#pragma once

#include <algorithm>
#include <array>
#include <asterism/parts/concept/frame.hpp>
#include <asterism/trackers/tracker/tracker.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "overlay.hpp"

namespace asterism::tools {

inline const cv::Scalar kBlue(255, 112, 16), kWhite(255, 255, 255), kDark(0, 0, 0);

/// Draws in frame coordinates, in which integers are pixel centres, mapped as by cv::resize. Shapes that are
/// not finite are left out.
struct Pen {
  static constexpr int kBits = 4;  // fractional bits of OpenCV's coordinates

  cv::Mat& canvas;
  View view;

  cv::Point2d map(double x, double y) const {
    return {(x + 0.5 - view.origin.x) * view.scale - 0.5, (y + 0.5 - view.origin.y) * view.scale - 0.5};
  }
  /// The corners of a box, as `turned` gives them.
  void outline(const std::array<cv::Point2d, 4>& corners, const cv::Scalar& color, int width) const {
    std::array<cv::Point, 4> drawn;
    for (std::size_t i = 0; i < corners.size(); ++i) {
      if (!std::isfinite(corners[i].x + corners[i].y)) return;
      // The corners are pixel edges, half a pixel from the centre.
      drawn[i] = fixed(map(corners[i].x - 0.5, corners[i].y - 0.5));
    }
    cv::polylines(canvas, std::vector<cv::Point>(drawn.begin(), drawn.end()), true, color, width, cv::LINE_AA,
                  kBits);
  }
  void box(const cv::Rect2d& b, const cv::Scalar& color, int width) const {
    outline(turned(b, 0), color, width);
  }
  void dot(const Point2& p, const cv::Scalar& color, int radius) const {
    if (!p.allFinite()) return;
    cv::circle(canvas, at(p), radius << kBits, color, cv::FILLED, cv::LINE_AA, kBits);
  }
  void line(const Point2& a, const Point2& b, const cv::Scalar& color, int width) const {
    if (!a.allFinite() || !b.allFinite()) return;
    cv::line(canvas, at(a), at(b), color, width, cv::LINE_AA, kBits);
  }
  /// A diagonal cross; `size` on the canvas [px].
  void cross(const Point2& p, const cv::Scalar& color, int width, double size) const {
    const Point2 arm(size / view.scale, size / view.scale), other(arm.x(), -arm.y());
    line(p - arm, p + arm, color, width);
    line(p - other, p + other, color, width);
  }

 private:
  cv::Point at(const Point2& p) const { return fixed(map(p.x(), p.y())); }
  static cv::Point fixed(const cv::Point2d& p) {
    // Clamped: coordinates beyond OpenCV's integers would wrap around.
    const auto one = [](double v) {
      return static_cast<int>(std::lround(std::clamp(v, -1e6, 1e6) * (1 << kBits)));
    };
    return {one(p.x), one(p.y)};
  }
};

}  // namespace asterism::tools
