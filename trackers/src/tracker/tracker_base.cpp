#include <asterism/trackers/tracker/tracker_base.hpp>
#include <cmath>
#include <stdexcept>
#include <string>

#include "stage_clock.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

void check_start(const Frame& frame, const cv::Rect2d& box) {
  if (!(std::isfinite(box.x) && std::isfinite(box.y) && std::isfinite(box.width) &&
        std::isfinite(box.height)))
    throw std::invalid_argument("the start box is not finite");
  if (!(box.width >= 1 && box.height >= 1))
    throw std::invalid_argument(cv::format(
        "the start box is %g x %g px, but must be at least one pixel wide and high", box.width, box.height));
  if (!(box.x < frame.size().width && box.y < frame.size().height && box.x + box.width > 0 &&
        box.y + box.height > 0))
    throw std::invalid_argument(
        cv::format("the start box, %g x %g px at (%g, %g), lies outside the image of %d x %d px", box.width,
                   box.height, box.x, box.y, frame.size().width, frame.size().height));
}

namespace detail {

TrackResult update_timed(const cv::Mat& image, const std::function<TrackResult(const Frame&)>& update) {
  StageClock clock;
  const Frame frame(image);
  const StageTime stage{"frame", clock.lap()};
  TrackResult result = update(frame);
  result.times.insert(result.times.begin(), stage);
  return result;
}

void throw_before_init(std::string_view tracker, std::string_view what) {
  throw std::logic_error(std::string(tracker).append(": ").append(what).append(" before init"));
}

}  // namespace detail

}  // namespace ASTERISM_ABI
}  // namespace asterism
