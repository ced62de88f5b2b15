#pragma once

#include <asterism/trackers/constellation/interruption.hpp>
#include <asterism/trackers/tracker/region.hpp>
#include <asterism/trackers/tracker/tracker.hpp>
#include <concepts>
#include <string_view>
#include <utility>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Throws std::invalid_argument, with the reason, if no tracker can start on a box: it is not finite, smaller
/// than 1 x 1, or does not overlap the image.
ASTERISM_API void check_start(const Frame& frame, const cv::Rect2d& box);

/// For TrackerBase: no InterruptionGate; the tracker starts on every frame and follows every frame.
struct NoGate {};

namespace detail {

/// An image as a frame, and how long that took.
struct TimedFrame {
  Frame frame;
  StageTime stage;
};
ASTERISM_API TimedFrame timed_frame(const cv::Mat& image);
/// Throws std::logic_error: "TRACKER: WHAT before init".
[[noreturn]] ASTERISM_API void throw_before_init(std::string_view tracker, std::string_view what);

}  // namespace detail

/// The common base of trackers: it takes images and frames, checks the start box, refuses `update`
/// before `init`, keeps out of interruptions (InterruptionGate, or NoGate), and can be saved. T derives from
/// TrackerBase<T>, makes it a friend, and has
///
/// - `kName`, a string for messages;
/// - `start(frame, box)`: learn the object in this box, which has been checked;
/// - `follow(frame)`: the TrackResult in the next frame;
/// - `standing()`, with a gate: the result of a tracker that stays where it is;
/// - `visit_learned(archive)`: what it has learned, for `visit_state`; only a T that is neither saved nor put
///   into an AnyTracker may be without it.
template <class T, class Gate = InterruptionGate>
class TrackerBase {
 public:
  /// See Tracker.
  void init(const cv::Mat& image, const cv::Rect2d& box) { init(first_frame(image), box); }
  void init(const Frame& frame, const cv::Rect2d& box) {
    check_start(frame, box);
    Gate gate;
    if constexpr (kGated) gate.init(frame, box);  // which may refuse
    self().start(frame, box);
    gate_ = std::move(gate);
    initialized_ = true;
  }
  /// On the region's equal_area_box.
  void init(const cv::Mat& image, const Region& region) { init(image, region.equal_area_box()); }
  void init(const Frame& frame, const Region& region) { init(frame, region.equal_area_box()); }
  /// See Tracker; the conversion of an image is the first stage.
  TrackResult update(const cv::Mat& image) {
    const detail::TimedFrame converted = detail::timed_frame(image);
    TrackResult result = update(converted.frame);
    result.times.insert(result.times.begin(), converted.stage);
    return result;
  }
  TrackResult update(const Frame& frame) {
    if (!initialized_) detail::throw_before_init(T::kName, "update");
    if constexpr (kGated)
      return gate_.update(self(), frame, &T::follow, &T::standing);
    else
      return self().follow(frame);
  }
  /// As `update`, but follows every frame: the gate is not asked, and learns nothing. For measurements of
  /// what the gate does.
  TrackResult update_without_gate(const Frame& frame) {
    if (!initialized_) detail::throw_before_init(T::kName, "update");
    return self().follow(frame);
  }
  /// For save_state, which throws std::logic_error before `init`.
  void visit_state(StateArchive& archive) {
    if (!archive.loading() && !initialized_) detail::throw_before_init(T::kName, "save");
    self().visit_learned(archive);
    initialized_ = true;  // also of the copy that the gate may make
    if constexpr (kGated) gate_.visit_state(archive, self(), [&archive](T& t) { t.visit_learned(archive); });
  }

 protected:
  TrackerBase() = default;                                   ///< For trackers alone, as what follows.
  TrackerBase(const TrackerBase&) = default;                 ///< A copy.
  TrackerBase(TrackerBase&&) noexcept = default;             ///< Moved.
  TrackerBase& operator=(const TrackerBase&) = default;      ///< A copy.
  TrackerBase& operator=(TrackerBase&&) noexcept = default;  ///< Moved.
  ~TrackerBase() = default;

 private:
  static constexpr bool kGated = !std::same_as<Gate, NoGate>;
  T& self() { return static_cast<T&>(*this); }

  [[no_unique_address]] Gate gate_;
  bool initialized_ = false;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
