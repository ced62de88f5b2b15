#pragma once

#include <asterism/trackers/tracker/tracker.hpp>
#include <asterism/trackers/tracker/tracker_base.hpp>
#include <functional>
#include <opencv2/video/tracking.hpp>
#include <string_view>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Any tracker of this library as one of OpenCV's: where a program has a cv::Ptr<cv::Tracker>, only the line
/// that makes it changes.
///
///     cv::Ptr<cv::Tracker> tracker = asterism::OpenCvTracker::create("dpt_plus");
///     tracker->init(image, box);
///     const bool found = tracker->update(image, box);
///
/// Boxes are whole pixels in OpenCV: `box` covers the pixels x .. x + width - 1. `result()` has the sub-pixel
/// box and everything else that the tracker found. What would be std::invalid_argument or std::logic_error is
/// cv::Exception here, with the same text.
class ASTERISM_API OpenCvTracker final : public cv::Tracker {
 public:
  /// Wraps a tracker that was made elsewhere.
  explicit OpenCvTracker(AnyTracker tracker) : tracker_(std::move(tracker)) {}
  /// Wraps the tracker of a description; throws as make_tracker.
  static cv::Ptr<OpenCvTracker> create(std::string_view description = "dpt_plus");

  /// Start on an object; see the concept Tracker for the images and boxes that are refused.
  void init(cv::InputArray image, const cv::Rect& box) override;
  /// The object's box in the next image, each edge rounded to the nearest whole pixel and at least a pixel
  /// apart; true. False, with `box` as it was, if the tracker reports that it has lost the object.
  bool update(cv::InputArray image, cv::Rect& box) override;

  /// The result of the last `update`; its box is empty before the first one.
  const TrackResult& result() const { return result_; }

 private:
  AnyTracker tracker_;
  TrackResult result_;
};

/// One of OpenCV's trackers as a Tracker: in MultiTracker, KalmanTracker, or wherever an AnyTracker is taken.
///
/// OpenCV's trackers start on whole pixels, so the start box is rounded; they see 8-bit BGR images. Where one
/// reports no object, the result is its last box, `lost`, with confidence 0; otherwise confidence is 1. They
/// cannot be saved or copied.
class ASTERISM_API CvTracker : public TrackerBase<CvTracker> {
 public:
  /// Makes a tracker; asked at each `init`.
  using Factory = std::function<cv::Ptr<cv::Tracker>()>;

  /// Throws std::invalid_argument for an empty factory.
  explicit CvTracker(Factory create);
  CvTracker(CvTracker&&) noexcept = default;             ///< Moved.
  CvTracker& operator=(CvTracker&&) noexcept = default;  ///< Moved.
  ~CvTracker() = default;

 private:
  friend TrackerBase<CvTracker>;
  static constexpr std::string_view kName = "CvTracker";

  void start(const Frame& frame, const cv::Rect2d& box);
  TrackResult follow(const Frame& frame);

  Factory create_;
  cv::Ptr<cv::Tracker> tracker_;
  cv::Rect2d box_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
