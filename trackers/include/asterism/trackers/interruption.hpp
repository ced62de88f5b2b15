#pragma once

#include <array>
#include <asterism/trackers/tracker.hpp>
#include <cstdint>
#include <utility>

namespace asterism::inline ASTERISM_ABI {

/// Tells frames that interrupt a video (blank frames, noise, a test card, a decoder's gray blocks, a cut to
/// another scene) from those that go on with it. In an interruption a tracker keeps its box and learns
/// nothing, however long it lasts.
///
/// It compares a frame with the last one that the tracker followed, as coarse as no camera's motion from one
/// frame to the next changes much, and asks the tracker itself before it calls anything but a blank frame an
/// interruption. docs/tracker.md has the figures behind its constants.
class ASTERISM_API InterruptionGate {
 public:
  /// The tracker starts in this frame, on this box.
  void init(const Frame& frame, const cv::Rect2d& box);

  /// `tracker`'s update by its member `follow`, or, in an interruption, its result by `standing`: that of a
  /// tracker that stays where it is. Where the frame alone does not tell, a copy of the tracker follows, and
  /// is taken over if it finds its object.
  template <class T>
  TrackResult update(T& tracker, const Frame& frame, TrackResult (T::*follow)(const Frame&),
                     TrackResult (T::*standing)() const) {
    const Sight sight = judge(frame);
    TrackResult result;
    if (sight == Sight::Scene) {
      result = (tracker.*follow)(frame);
    } else {
      if (sight == Sight::Doubtful) {
        T attempt = tracker;
        result = (attempt.*follow)(frame);
        if (!result.lost) tracker = std::move(attempt);
      }
      if (sight == Sight::Blank || result.lost) {
        const double confidence = result.confidence;
        std::vector<StageTime> times = std::move(result.times);
        result = (tracker.*standing)();
        result.confidence = confidence;
        result.times = std::move(times);
        result.lost = result.interrupted = true;
        return result;
      }
    }
    init(frame, result.box);
    return result;
  }

  /// For save_state.
  void visit_state(StateArchive& archive);

 private:
  enum class Sight {
    Scene,     // the video goes on
    Doubtful,  // another scene, or the object's surroundings have become blank
    Blank      // nothing at all to be seen, where there was something
  };
  static constexpr int kViewCells = 16, kNearCells = 8;  // a side
  // Mean gray levels of the cells of the whole frame.
  using View = std::array<std::uint8_t, kViewCells * kViewCells>;
  // 1 for a cell about the object that has one gray level, else 0.
  using Blanks = std::array<std::uint8_t, kNearCells * kNearCells>;

  static View view_of(const Frame& frame);
  // About the box that was followed last.
  Blanks blanks_of(const Frame& frame) const;
  Sight judge(const Frame& frame) const;

  Point2 centre_ = Point2::Zero();
  Size2 size_ = Size2::Ones();
  View view_{};
  Blanks blanks_{};
};

}  // namespace asterism::inline ASTERISM_ABI
