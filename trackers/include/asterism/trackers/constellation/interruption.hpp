#pragma once

#include <array>
#include <asterism/trackers/tracker/tracker.hpp>
#include <cstdint>
#include <utility>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Distinguishes frames that interrupt a video (blank frames, noise, a test card, a decoder's gray blocks, a
/// cut to another scene) from those that continue it. During an interruption a tracker keeps its box and
/// learns nothing, however long it lasts.
///
/// It compares a coarse view of the frame with that of the last frame that the tracker followed, allowing for
/// motion of the camera. Unless the frame is blank, it also asks the tracker itself before it decides that
/// the frame is an interruption. docs/in-practice.md has the figures behind its constants.
class ASTERISM_API InterruptionGate {
 public:
  /// Mean gray levels of kViewCells x kViewCells cells of a frame, row by row.
  static constexpr int kViewCells = 16;
  using View = std::array<std::uint8_t, kViewCells * kViewCells>;

  /// The tracker starts in this frame, on this box.
  void init(const Frame& frame, const cv::Rect2d& box) { learn(frame, box, 0); }

  /// Updates `tracker` by its member `follow`; in an interruption returns the result of its member
  /// `standing`, which stays where it is. If the frame alone does not decide, a copy of the tracker follows,
  /// and replaces the tracker if it finds its object.
  template <class T>
  TrackResult update(T& tracker, const Frame& frame, TrackResult (T::*follow)(const Frame&),
                     TrackResult (T::*standing)() const) {
    const Sight sight = judge(frame);
    TrackResult result;
    if (sight == Sight::Scene) {
      result = (tracker.*follow)(frame);
    } else {
      bool found = false;
      if (sight == Sight::Doubtful) {
        T attempt = tracker;
        result = (attempt.*follow)(frame);
        found = !result.lost && result.confidence >= kLeastConfidence * confidence_;
        if (found) tracker = std::move(attempt);
      }
      if (!found) {
        TrackResult stays = (tracker.*standing)();
        stays.confidence = result.confidence;
        stays.times = std::move(result.times);
        stays.lost = stays.interrupted = true;
        return stays;
      }
    }
    learn(frame, result.box, result.confidence);
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
  static constexpr int kNearCells = 8;  // a side
  // In a doubtful frame the tracker must be as sure of its object as this, relative to the last frame: noise
  // has a best match, too.
  static constexpr double kLeastConfidence = 0.5;
  // 1 for a cell about the object that has one gray level, else 0.
  using Blanks = std::array<std::uint8_t, kNearCells * kNearCells>;

  static View view_of(const Frame& frame);
  // About the box that was followed last.
  Blanks blanks_of(const Frame& frame) const;
  Sight judge(const Frame& frame) const;
  // The tracker followed a frame.
  void learn(const Frame& frame, const cv::Rect2d& box, double confidence);

  Point2 centre_ = Point2::Zero();
  Size2 size_ = Size2::Ones();
  double confidence_ = 0;
  View view_{};
  Blanks blanks_{};
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
