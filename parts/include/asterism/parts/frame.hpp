#pragma once

#include <Eigen/Core>
#include <asterism/solver/config.hpp>
#include <opencv2/core.hpp>

namespace asterism::inline ASTERISM_ABI {

/// A position in the image: (x, y) in pixels, the centre of the top left pixel is (0, 0).
using Point2 = Eigen::Vector2d;
/// Width and height in pixels, both > 0.
using Size2 = Eigen::Vector2d;

/// The centre of a box that covers the pixels x .. x + width - 1.
inline Point2 centre_of(const cv::Rect2d& box) {
  return {box.x + (box.width - 1) / 2, box.y + (box.height - 1) / 2};
}
/// The box of a size around a centre; the inverse of `centre_of`.
inline cv::Rect2d box_around(const Point2& centre, const Size2& size) {
  return {centre.x() - (size.x() - 1) / 2, centre.y() - (size.y() - 1) / 2, size.x(), size.y()};
}

/// One video frame, converted once and shared by all parts of a tracker.
class ASTERISM_API Frame {
 public:
  /// image: 1, 3 (BGR) or 4 (BGRA) channels of 8 or 16 bit unsigned or of float in [0, 1]; 8-bit gray and BGR
  /// are used without a copy, so the image must outlive the frame. Throws std::invalid_argument for an empty
  /// image or another type, and for float pixels that are not finite.
  explicit Frame(const cv::Mat& image);

  /// 8-bit gray, as cv::COLOR_BGR2GRAY makes it.
  const cv::Mat& gray() const { return gray_; }
  /// 8-bit BGR, or empty where the input has one channel.
  const cv::Mat& bgr() const { return bgr_; }
  /// Size of the image [px].
  cv::Size size() const { return gray_.size(); }
  /// True where at least one pixel has channels that differ: gray video is often stored with three equal
  /// ones.
  bool has_colour() const;

 private:
  cv::Mat gray_, bgr_;
};

}  // namespace asterism::inline ASTERISM_ABI
