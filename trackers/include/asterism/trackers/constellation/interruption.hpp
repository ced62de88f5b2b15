#pragma once

#include <array>
#include <asterism/trackers/tracker/tracker.hpp>
#include <cstdint>
#include <memory>
#include <utility>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Distinguishes frames that interrupt a video (blank frames, noise, a test card, a decoder's gray blocks, a
/// cut to another scene) from those that continue it. During an interruption a tracker keeps its box and
/// learns nothing, however long it lasts.
///
/// It compares a coarse view of the frame with that of the last frame that the tracker followed, allowing for
/// motion of the camera. Unless the frame is blank, it also asks the tracker itself before it decides that
/// the frame is an interruption. Where the tracker finds its object in another scene, the gate keeps what it
/// had learned of the scene before, and goes on from there when that scene is back: what was found may only
/// have been similar. docs/in-practice.md has the figures behind its constants.
class ASTERISM_API InterruptionGate {
 public:
  /// Mean gray levels of kViewCells x kViewCells cells of a frame, row by row.
  static constexpr int kViewCells = 16;
  using View = std::array<std::uint8_t, kViewCells * kViewCells>;

  /// The tracker starts in this frame, on this box.
  void init(const Frame& frame, const cv::Rect2d& box) {
    left_ = {};
    learn(frame, box, 0);
  }

  /// Updates `tracker` by its member `follow`; in an interruption returns the result of its member
  /// `standing`, which stays where it is. If the frame alone does not decide, a copy of the tracker follows,
  /// and replaces the tracker if it finds its object: first, if the scene that was left is back, a copy of
  /// the tracker as it was there.
  template <class T>
  TrackResult update(T& tracker, const Frame& frame, TrackResult (T::*follow)(const Frame&),
                     TrackResult (T::*standing)() const) {
    const Sight sight = judge(seen_, frame);
    TrackResult result;
    if (sight == Sight::Scene) {
      result = (tracker.*follow)(frame);
    } else {
      bool found = false;
      // Goes on as a copy of `from` if that finds the object, as sure of it as it was, `confidence`, or
      // nearly.
      const auto go_on = [&](const T& from, double confidence) {
        T attempt = from;
        result = (attempt.*follow)(frame);
        found = !result.lost && result.confidence >= kLeastConfidence * confidence;
        if (!found) return;
        left_ = {};  // a tracker that is kept keeps no other
        Left left{seen_, std::make_shared<const T>(tracker)};
        tracker = std::move(attempt);  // this gate may be a part of it
        left_ = std::move(left);
      };
      if (sight == Sight::Doubtful) {
        if (left_.tracker != nullptr && judge(left_.seen, frame) == Sight::Scene)
          go_on(*static_cast<const T*>(left_.tracker.get()), left_.seen.confidence);
        if (!found) go_on(tracker, seen_.confidence);
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

  /// For save_state, of the gate of `tracker`; `visit_learned(t)` visits what a tracker t has learned.
  template <class T, class Visit>
  void visit_state(StateArchive& archive, const T& tracker, Visit&& visit_learned) {
    visit_seen(archive, seen_);
    bool left = left_.tracker != nullptr;
    archive(left);
    if (archive.loading()) left_ = {};
    if (!left) return;
    const auto of_left =
        std::make_shared<T>(archive.loading() ? tracker : *static_cast<const T*>(left_.tracker.get()));
    visit_learned(*of_left);
    left_.tracker = of_left;
    visit_seen(archive, left_.seen);
  }

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

  // Of a frame that was followed.
  struct Seen {
    Point2 centre = Point2::Zero();
    Size2 size = Size2::Ones();
    double confidence = 0;
    View view{};
    Blanks blanks{};
  };
  // The last frame before the last doubtful one in which the object was found, and the tracker (a T) then.
  struct Left {
    Seen seen;
    std::shared_ptr<const void> tracker;
  };

  static View view_of(const Frame& frame);
  // About the box that was followed.
  static Blanks blanks_of(const Seen& seen, const Frame& frame);
  static Sight judge(const Seen& seen, const Frame& frame);
  static void visit_seen(StateArchive& archive, Seen& seen);
  // The tracker followed a frame.
  void learn(const Frame& frame, const cv::Rect2d& box, double confidence);

  Seen seen_;
  Left left_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
