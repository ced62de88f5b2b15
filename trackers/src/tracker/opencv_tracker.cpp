#include <algorithm>
#include <asterism/trackers/constellation/pose.hpp>
#include <asterism/trackers/tracker/opencv_tracker.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "stage_clock.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Runs `work` and converts its exceptions to cv::Exception.
template <class Work>
auto with_opencv_errors(Work&& work) {
  try {
    return work();
  } catch (const std::invalid_argument& error) {
    CV_Error(cv::Error::StsBadArg, error.what());
  } catch (const std::logic_error& error) {
    CV_Error(cv::Error::StsNullPtr, error.what());
  }
}

// Rounds each edge to the nearest whole pixel; width and height are at least 1.
cv::Rect whole_pixels(const cv::Rect2d& box) {
  const auto edge = [](double x) { return static_cast<int>(std::lround(std::clamp(x, -1e9, 1e9))); };
  const int left = edge(box.x), top = edge(box.y);
  return {left, top, std::max(1, edge(box.x + box.width) - left),
          std::max(1, edge(box.y + box.height) - top)};
}

cv::Mat bgr_of(const Frame& frame) {
  if (!frame.bgr().empty()) return frame.bgr();
  cv::Mat bgr;
  cv::cvtColor(frame.gray(), bgr, cv::COLOR_GRAY2BGR);
  return bgr;
}

}  // namespace

cv::Ptr<OpenCvTracker> OpenCvTracker::create(std::string_view description) {
  return cv::makePtr<OpenCvTracker>(make_tracker(description));
}

void OpenCvTracker::init(cv::InputArray image, const cv::Rect& box) {
  with_opencv_errors([&] { tracker_.init(image.getMat(), cv::Rect2d(box)); });
  result_ = {};
}

bool OpenCvTracker::update(cv::InputArray image, cv::Rect& box) {
  result_ = with_opencv_errors([&] { return tracker_.update(image.getMat()); });
  if (result_.lost) return false;
  box = whole_pixels(result_.box);
  return true;
}

CvTracker::CvTracker(Factory create) : create_(std::move(create)) {
  if (!create_) throw std::invalid_argument("CvTracker: the factory must not be empty");
}

void CvTracker::start(const Frame& frame, const cv::Rect2d& box) {
  const cv::Ptr<cv::Tracker> tracker = create_();
  if (tracker == nullptr) throw std::runtime_error("CvTracker: the factory made no tracker");
  const cv::Rect start = whole_pixels(box);
  tracker->init(bgr_of(frame), start);
  tracker_ = tracker;
  box_ = start;
}

TrackResult CvTracker::follow(const Frame& frame) {
  StageClock clock;
  TrackResult result;
  cv::Rect found;
  result.lost = !tracker_->update(bgr_of(frame), found) || found.empty();
  if (!result.lost) {
    box_ = found;
    result.confidence = 1;
  }
  result.box = box_around(kept_in_image(frame, centre_of(box_)), Size2(box_.width, box_.height));
  result.times.push_back({"opencv", clock.lap()});
  return result;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
