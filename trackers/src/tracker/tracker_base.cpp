#include <algorithm>
#include <asterism/trackers/tracker/tracker_base.hpp>
#include <cmath>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>

#include "stage_clock.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Whether the box and its surroundings, of twice its sides, have the same values everywhere: filler of a
// decoder, or saturated light. The box overlaps the image.
bool is_blank_around(const Frame& frame, const cv::Rect2d& box) {
  constexpr double kSides = 2, kOneLevel = 2;
  const cv::Size size = frame.size();
  const auto begin = [](double centre, double side, int limit) {
    return static_cast<int>(std::clamp(std::floor(centre - kSides * side / 2), 0.0, limit - 1.0));
  };
  const auto end = [](double centre, double side, int limit) {
    return static_cast<int>(
        std::clamp(std::ceil(centre + kSides * side / 2), 1.0, static_cast<double>(limit)));
  };
  const double x = box.x + box.width / 2, y = box.y + box.height / 2;
  const cv::Rect window(cv::Point(begin(x, box.width, size.width), begin(y, box.height, size.height)),
                        cv::Point(end(x, box.width, size.width), end(y, box.height, size.height)));
  const cv::Mat pixels = (frame.bgr().empty() ? frame.gray() : frame.bgr())(window);
  for (int channel = 0; channel < pixels.channels(); ++channel) {
    cv::Mat plane;
    cv::extractChannel(pixels, plane, channel);
    double least = 0, most = 0;
    cv::minMaxLoc(plane, &least, &most);
    if (most - least > kOneLevel) return false;
  }
  return true;
}

}  // namespace

void check_start(const Frame& frame, const cv::Rect2d& box) {
  if (!(std::isfinite(box.x) && std::isfinite(box.y) && std::isfinite(box.width) &&
        std::isfinite(box.height)))
    throw std::invalid_argument("the start box is not finite");
  if (!(box.width >= 1 && box.height >= 1))
    throw std::invalid_argument("the start box must be at least one pixel wide and high");
  if (!(box.x < frame.size().width && box.y < frame.size().height && box.x + box.width > 0 &&
        box.y + box.height > 0))
    throw std::invalid_argument("the start box lies outside the image");
  if (is_blank_around(frame, box))
    throw std::invalid_argument(
        "the start box and its surroundings have one gray level or color: there is nothing to follow");
}

namespace detail {

TimedFrame timed_frame(const cv::Mat& image) {
  StageClock clock;
  Frame frame(image);
  return {std::move(frame), {"frame", clock.lap()}};
}

void throw_before_init(std::string_view tracker, std::string_view what) {
  throw std::logic_error(std::string(tracker).append(": ").append(what).append(" before init"));
}

}  // namespace detail

}  // namespace ASTERISM_ABI
}  // namespace asterism
