#pragma once

#include <asterism/trackers/around/object_search.hpp>
#include <asterism/trackers/dpt/box_judge.hpp>
#include <asterism/trackers/tracker/tracker.hpp>
#include <asterism/trackers/tracker/tracker_base.hpp>
#include <string_view>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Any tracker with a search for its object after it has lost it.
///
/// A BoxJudge compares the tracker's box with the first frame. In a frame in which the box does not look like
/// the object (its probability in this frame alone is below one half), the whole frame is searched
/// (ObjectSearch), and if the best match has a probability of at least kAccept, the tracker is started there.
/// What the object looked like in the first frame is never updated.
///
/// The result is the tracker's with `probability` of this judge, and `lost` where that is below one half. In
/// a frame in which the object has been found, the result is that of the tracker that was started there. As
/// long as nothing is found elsewhere, the boxes are the tracker's, bit for bit. The search takes the stage
/// "search".
class ASTERISM_API RedetectingTracker : public TrackerBase<RedetectingTracker> {
 public:
  /// Least probability, in its frame alone, of a match that is taken for the object. It is higher than for a
  /// tracker's box, which is right much more often than the best of thousands of places.
  static constexpr double kAccept = 0.998;

  /// Around this tracker; init() is still to be called.
  explicit RedetectingTracker(AnyTracker tracker) : tracker_(std::move(tracker)) {}

  /// The tracker in it.
  const AnyTracker& tracker() const { return tracker_; }

 private:
  friend TrackerBase<RedetectingTracker>;
  static constexpr std::string_view kName = "RedetectingTracker";

  void start(const Frame& frame, const cv::Rect2d& box);
  TrackResult follow(const Frame& frame);
  void visit_learned(StateArchive& archive);

  // Starts the tracker where the object is found, if it is; the result is then that of this tracker.
  void search(const Frame& frame, TrackResult& result);

  AnyTracker tracker_;
  BoxJudge judge_;
  ObjectSearch search_;
  Size2 size_ = Size2::Ones();  // of the last box that looked like the object [px]
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
