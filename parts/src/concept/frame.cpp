#include <asterism/parts/concept/frame.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <sstream>
#include <stdexcept>
#include <string>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace {

// Tolerance for float images without a given range: interpolation overshoots [0, 1] by less than this,
// whereas images in [0, 255] or [-1, 1] exceed it.
constexpr double kOvershoot = 0.5;

// Float pixels below this are black in 8 bits, all of them: 8-bit values that were divided by 65535.
constexpr double kDark = 1.0 / 256;

std::string text(double value) {
  std::ostringstream stream;
  stream << value;
  return stream.str();
}

cv::Mat without_alpha(const cv::Mat& image) {
  if (image.channels() != 4) return image;
  cv::Mat bgr;
  cv::cvtColor(image, bgr, cv::COLOR_BGRA2BGR);
  return bgr;
}

PixelRange extremes(const cv::Mat& image) {
  PixelRange found;
  cv::minMaxLoc(image.reshape(1), &found.black, &found.white);
  return found;
}

void check(const cv::Mat& image) {
  if (image.dims > 2 || image.empty()) throw std::invalid_argument("Frame: the image is empty or not 2-D");
  const int channels = image.channels(), depth = image.depth();
  if (channels != 1 && channels != 3 && channels != 4)
    throw std::invalid_argument("Frame: the image must have 1, 3 or 4 channels");
  if (depth != CV_8U && depth != CV_16U && depth != CV_32F)
    throw std::invalid_argument("Frame: pixels must be 8 or 16 bit unsigned or float");
}

// The requested range, or else the default for the depth.
PixelRange range_of(const cv::Mat& image, const std::optional<PixelRange>& range) {
  if (range) {
    const double span = range->white - range->black;
    if (!(span >= 1e-6 && span <= 1e30 && std::abs(range->black) <= 1e30))
      throw std::invalid_argument("Frame: the range from " + text(range->black) + " to " +
                                  text(range->white) + " is invalid: black must be below white");
    return *range;
  }
  if (image.depth() == CV_32F) {
    const PixelRange found = extremes(image);
    if (found.black < -kOvershoot || found.white > 1 + kOvershoot)
      throw std::invalid_argument("Frame: float pixels must be in [0, 1] and are in [" + text(found.black) +
                                  ", " + text(found.white) + "]: scale them, or give their range");
    return {0, 1};
  }
  return PixelRange::of_bits(image.depth() == CV_8U ? 8 : 16);
}

// Converts to 8 bits a channel; values outside the range saturate.
cv::Mat to_8_bit(const cv::Mat& image, const std::optional<PixelRange>& asked) {
  // The conversion would turn NaN into an arbitrary gray level that nobody notices.
  if (image.depth() == CV_32F && !cv::checkRange(image))
    throw std::invalid_argument("Frame: a pixel is not finite");
  const PixelRange range = range_of(image, asked);
  const double scale = 255 / (range.white - range.black);
  cv::Mat result;
  if (image.depth() == CV_8U && range == PixelRange{0, 255}) return image;
  if (image.depth() == CV_16U && !asked) {
    image.convertTo(result, CV_8U, scale);
    return result;
  }
  // Clamp first: convertTo does not saturate values outside the range of int.
  image.reshape(1).convertTo(result, CV_32F);
  result = cv::min(cv::max(result, range.black), range.white);
  result.convertTo(result, CV_8U, scale, -range.black * scale);
  return result.reshape(image.channels());
}

}  // namespace

std::optional<PixelRange> suggested_range(const cv::Mat& image) try {
  check(image);
  if (image.depth() == CV_8U) return {};
  const cv::Mat pixels = without_alpha(image);
  if (image.depth() == CV_32F && !cv::checkRange(pixels)) return {};
  const PixelRange found = extremes(pixels);
  if (image.depth() == CV_32F) {
    if (found.black >= 0 && found.white > 0 && found.white < kDark) return PixelRange{0, 255.0 / 65535};
    if (found.black >= -kOvershoot && found.white <= 1 + kOvershoot) return {};
    if (found.black < 0) return found;
  }
  if (found.white == 0) return {};
  for (const int bits : {8, 10, 12, 14, 16})
    if (found.white <= PixelRange::of_bits(bits).white)
      return bits == 16 && image.depth() == CV_16U ? std::nullopt : std::optional(PixelRange::of_bits(bits));
  return found;
} catch (const std::invalid_argument&) {
  return {};
}

Frame::Frame(const cv::Mat& image, const std::optional<PixelRange>& range) {
  check(image);
  const cv::Mat image8 = to_8_bit(without_alpha(image), range);
  if (image.channels() == 1) {
    gray_ = image8;
    return;
  }
  bgr_ = image8;
  cv::cvtColor(bgr_, gray_, cv::COLOR_BGR2GRAY);
}

Frame first_frame(const cv::Mat& image) {
  Frame frame(image);
  const std::optional<PixelRange> suggested = suggested_range(image);
  if (image.depth() == CV_16U && suggested == PixelRange::of_bits(8))
    throw std::invalid_argument(
        "Frame: the pixels of a 16-bit image are at most 255, black in 8 bits: give their range, or 8-bit "
        "pixels");
  if (image.depth() == CV_32F && suggested)
    throw std::invalid_argument(
        "Frame: the pixels of a float image are below 1/256, black in 8 bits: give their range (255/65535 is "
        "white if 8-bit pixels were divided by 65535), or pixels in [0, 1]");
  return frame;
}

bool Frame::has_color() const {
  for (int row = 0; row < bgr_.rows; ++row) {
    const uchar* pixel = bgr_.ptr<uchar>(row);
    // Differences are collected over a whole row: without an early exit the inner loop vectorises.
    unsigned difference = 0;
    for (int col = 0; col < bgr_.cols; ++col, pixel += 3) {
      difference |= unsigned(pixel[0] ^ pixel[1]) | unsigned(pixel[1] ^ pixel[2]);
    }
    if (difference != 0) return true;
  }
  return false;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
