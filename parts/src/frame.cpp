#include <asterism/parts/frame.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace asterism::inline ASTERISM_ABI {
namespace {

/// The image with 8 bits a channel: full scale stays full scale, what is beyond it saturates.
cv::Mat to_8_bit(const cv::Mat& image) {
  cv::Mat result;
  switch (image.depth()) {
    case CV_8U:
      return image;
    case CV_16U:
      image.convertTo(result, CV_8U, 1.0 / 257.0);  // 65535 = 257 * 255
      return result;
    case CV_32F:
      // The conversion would turn NaN into an arbitrary gray level that nobody notices.
      if (!cv::checkRange(image)) throw std::invalid_argument("Frame: a pixel is not finite");
      // Beyond the range of int the conversion itself does not saturate.
      result = cv::min(cv::max(image.reshape(1), 0.0), 1.0);
      result.convertTo(result, CV_8U, 255.0);
      return result.reshape(image.channels());
    default:
      throw std::invalid_argument("Frame: pixels must be 8 or 16 bit unsigned or float");
  }
}

}  // namespace

Frame::Frame(const cv::Mat& image) {
  if (image.dims > 2 || image.empty()) throw std::invalid_argument("Frame: the image is empty or not 2-D");
  const int channels = image.channels();
  if (channels != 1 && channels != 3 && channels != 4) {
    throw std::invalid_argument("Frame: the image must have 1, 3 or 4 channels");
  }
  const cv::Mat image8 = to_8_bit(image);
  if (channels == 1) {
    gray_ = image8;
    return;
  }
  if (channels == 4) {
    cv::cvtColor(image8, bgr_, cv::COLOR_BGRA2BGR);
  } else {
    bgr_ = image8;
  }
  cv::cvtColor(bgr_, gray_, cv::COLOR_BGR2GRAY);
}

bool Frame::has_colour() const {
  for (int row = 0; row < bgr_.rows; ++row) {
    const uchar* pixel = bgr_.ptr<uchar>(row);
    // Differences are collected over a row: the inner loop has no exit, so that it vectorises.
    unsigned difference = 0;
    for (int col = 0; col < bgr_.cols; ++col, pixel += 3) {
      difference |= unsigned(pixel[0] ^ pixel[1]) | unsigned(pixel[1] ^ pixel[2]);
    }
    if (difference != 0) return true;
  }
  return false;
}

}  // namespace asterism::inline ASTERISM_ABI
