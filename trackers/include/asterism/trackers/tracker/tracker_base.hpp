#pragma once

#include <asterism/trackers/tracker/region.hpp>
#include <asterism/trackers/tracker/tracker.hpp>
#include <functional>
#include <string_view>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Throws std::invalid_argument, with the reason, if no tracker can start on a box: it is not finite, smaller
/// than 1 x 1, or does not overlap the image.
ASTERISM_API void check_start(const Frame& frame, const cv::Rect2d& box);

namespace detail {

/// Calls `update` with the image's frame, whose conversion is the first stage, for `update(image)`.
ASTERISM_API TrackResult update_timed(const cv::Mat& image,
                                      const std::function<TrackResult(const Frame&)>& update);
/// Throws std::logic_error: "TRACKER: WHAT before init".
[[noreturn]] ASTERISM_API void throw_before_init(std::string_view tracker, std::string_view what);

}  // namespace detail

/// The common base of trackers: it takes images and frames, checks the start box, refuses `update` before
/// `init`, and can be saved. T derives from TrackerBase<T>, makes it a friend, and has
///
/// - `kName`, a string for messages;
/// - `start(frame, box)`: learn the object in this box, which has been checked;
/// - `follow(frame)`: the TrackResult in the next frame;
/// - `visit_learned(archive)`: what it has learned, for `visit_state`; only a T that is neither saved nor put
///   into an AnyTracker may be without it.
template <class T>
class TrackerBase {
 public:
  /// See Tracker.
  void init(const cv::Mat& image, const cv::Rect2d& box) { init(first_frame(image), box); }
  void init(const Frame& frame, const cv::Rect2d& box) {
    check_start(frame, box);
    self().start(frame, box);
    initialized_ = true;
  }
  /// On the region's equal_area_box.
  void init(const cv::Mat& image, const Region& region) { init(image, region.equal_area_box()); }
  void init(const Frame& frame, const Region& region) { init(frame, region.equal_area_box()); }
  /// See Tracker; the conversion of an image is the first stage.
  TrackResult update(const cv::Mat& image) {
    return detail::update_timed(image, [this](const Frame& frame) { return update(frame); });
  }
  TrackResult update(const Frame& frame) {
    if (!initialized_) detail::throw_before_init(T::kName, "update");
    return self().follow(frame);
  }
  /// For save_state, which throws std::logic_error before `init`.
  void visit_state(StateArchive& archive) {
    if (!archive.loading() && !initialized_) detail::throw_before_init(T::kName, "save");
    self().visit_learned(archive);
    initialized_ = true;
  }

 private:
  T& self() { return static_cast<T&>(*this); }

  bool initialized_ = false;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
