#pragma once

// A minimal scene to run a tracker on.

#include <asterism/trackers/tracker/tracker.hpp>
#include <cmath>
#include <cstdlib>

namespace asterism::fuzz {

/// A textured square in 48 x 40 pixels, moved by `t`.
inline cv::Mat small_frame(int t) {
  cv::Mat image(40, 48, CV_8UC3);
  for (int y = 0; y < image.rows; ++y)
    for (int x = 0; x < image.cols; ++x) {
      const int u = x - 14 - t, v = y - 12;
      const bool inside = u >= 0 && u < 16 && v >= 0 && v < 16;
      const auto texture =
          static_cast<unsigned char>(inside ? 90 + (u * 37 + v * 91) % 160 : (x * 7 + y * 13) % 60);
      image.at<cv::Vec3b>(y, x) = {texture, static_cast<unsigned char>(255 - texture), 80};
    }
  return image;
}
inline cv::Rect2d small_box() { return {14, 12, 16, 16}; }

/// Aborts unless `result` is finite and in range.
inline void check(const TrackResult& result) {
  const cv::Rect2d& box = result.box;
  bool good = std::isfinite(box.x) && std::isfinite(box.y) && box.width > 0 && box.height > 0 &&
              std::isfinite(box.width) && std::isfinite(box.height) && std::isfinite(result.angle) &&
              result.confidence >= 0 && result.confidence <= 1;
  for (const PartState& part : result.parts)
    good = good && part.position.allFinite() && part.size.allFinite();
  if (result.covariance) good = good && result.covariance->allFinite();
  if (!good) std::abort();
}

inline void follow(AnyTracker& tracker) {
  static const cv::Mat first = small_frame(0), second = small_frame(1);
  tracker.init(first, small_box());
  check(tracker.update(second));
  check(tracker.update(first));
}

}  // namespace asterism::fuzz
