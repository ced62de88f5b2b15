#pragma once

#include <Eigen/Core>
#include <asterism/solver/base/config.hpp>
#include <cmath>
#include <opencv2/core.hpp>
#include <optional>

namespace asterism {
inline namespace ASTERISM_ABI {

/// A position in the image: (x, y) in pixels, the centre of the top left pixel is (0, 0). Boxes (cv::Rect2d)
/// and their corners count pixels' edges instead, so that the top left pixel is the box from 0 to 1 on both
/// axes: `centre_of` and `box_around` convert between the two, half a pixel apart.
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

/// The pixel values that become black and white in 8 bits, such as those of 12 bits in a 16-bit image; values
/// beyond them are clipped. Both must be finite, and white at least 1e-6 above black; otherwise Frame throws
/// std::invalid_argument. Choose it once for a video: trackers cannot follow if it changes from frame to
/// frame.
struct PixelRange {
  double black = 0;    ///< The value that becomes 0.
  double white = 255;  ///< The value that becomes 255.

  /// The range from 0 to 2^bits - 1.
  static PixelRange of_bits(int bits) { return {0, std::ldexp(1.0, bits) - 1}; }
  /// The range of `width` values around `level`, the usual window for medical and thermal images.
  static PixelRange of_window(double level, double width) { return {level - width / 2, level + width / 2}; }

  /// Whether both values are the same.
  bool operator==(const PixelRange&) const = default;
};

/// The range that the pixels of a video's first frame seem to have, if that is not the range that Frame
/// assumes: for 16-bit pixels the fewest of 8, 10, 12 and 14 bits that hold them; for float pixels beyond 1
/// the fewest of 8 to 16 bits, for those below 1/256 the range of 8-bit values divided by 65535, otherwise
/// their least and greatest value. Empty if Frame's range is right, and for an image that is black or that
/// Frame refuses for another reason.
ASTERISM_API std::optional<PixelRange> suggested_range(const cv::Mat& image);

/// One video frame, converted once and shared by all parts of a tracker.
class ASTERISM_API Frame {
 public:
  /// image: 1, 3 (BGR) or 4 (BGRA) channels of 8 or 16 bit unsigned or of float; 8-bit gray and BGR are used
  /// without a copy, so the image must outlive the frame. range: without one, integers use all their bits,
  /// and floats are in [0, 1]; those from -0.5 to 1.5, as resampling leaves them, are clipped, and an image
  /// that has others (one of 0 to 255, say) is refused. 8-bit values in a 16-bit image are taken as they are,
  /// nearly black: see `first_frame`. Throws std::invalid_argument for an empty image or another type, and
  /// for float pixels that are not finite or, without a range, further out.
  explicit Frame(const cv::Mat& image, const std::optional<PixelRange>& range = {});

  /// 8-bit gray, as cv::COLOR_BGR2GRAY makes it.
  const cv::Mat& gray() const { return gray_; }
  /// 8-bit BGR; empty if the input has one channel.
  const cv::Mat& bgr() const { return bgr_; }
  /// Size of the image [px].
  cv::Size size() const { return gray_.size(); }
  /// Whether the channels of at least one pixel differ: gray video is often stored with three equal
  /// channels.
  bool has_color() const;

 private:
  cv::Mat gray_, bgr_;
};

/// The frame that a tracker starts on: Frame(image), but throws std::invalid_argument for a 16-bit image
/// whose values are all at most 255, and for a float image whose values are all below 1/256, unless they are
/// all 0. It would be black in 8 bits; for 8-bit values in 16 bits, or divided by 65535, give a range.
ASTERISM_API Frame first_frame(const cv::Mat& image);

}  // namespace ASTERISM_ABI
}  // namespace asterism
