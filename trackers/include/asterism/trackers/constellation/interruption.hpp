#pragma once

#include <array>
#include <asterism/trackers/constellation/pose.hpp>
#include <asterism/trackers/tracker/tracker.hpp>
#include <cstdint>
#include <memory>
#include <utility>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Whether a frame shows anything that a tracker can start on: not one gray level, nor noise, in which
/// neighbouring pixels have nothing to do with each other (their correlation is below 0.25).
ASTERISM_API bool shows_scene(const Frame& frame);

/// Keeps a tracker out of frames that interrupt a video: blank frames, noise, a test card, a decoder's gray
/// blocks, a cut to another scene.
///
/// It compares a coarse view of each frame with that of the frame before. In a blank frame the tracker stays
/// where it is and learns nothing. If the view changes abruptly, the gate keeps a copy of the tracker, which
/// learns nothing, while the tracker itself follows the new view. If the view from before is back, the copy
/// goes on in place of the tracker, as if there had been nothing in between. Until then the result is the
/// tracker's if it finds its object in the new view; else the result is that of the copy, which stays where
/// it is, until the new view has lasted for kMostHeld frames. docs/in-practice.md has the figures behind the
/// constants.
class ASTERISM_API InterruptionGate {
 public:
  /// Mean gray levels of kViewCells x kViewCells cells of a frame, row by row.
  static constexpr int kViewCells = 16;
  using View = std::array<std::uint8_t, kViewCells * kViewCells>;
  /// Number of successive frames of a new scene, at most, in which the box stays where it was.
  static constexpr int kMostHeld = 10;

  /// The tracker starts in this frame, on this box, which overlaps the frame. Throws std::invalid_argument,
  /// and keeps the former state, if the box and its surroundings (of twice its sides) have one gray level or
  /// color: there is nothing to follow.
  void init(const Frame& frame, const cv::Rect2d& box) {
    require_contrast(frame, box);
    before_ = {};
    held_ = 0;
    TrackResult result;
    result.box = box;
    learn(frame, view_of(frame), result);
  }

  /// Updates `tracker` by its member `follow`; in an interruption returns the result of its member
  /// `standing`, which stays where it is.
  template <class T>
  TrackResult update(T& tracker, const Frame& frame, TrackResult (T::*follow)(const Frame&),
                     TrackResult (T::*standing)() const) {
    const View view = view_of(frame);
    const Sight sight = judge(frame, view);
    // This gate may be a part of the tracker: what is assigned to the tracker is then assigned to the gate,
    // too.
    if (sight == Sight::Back) {
      tracker = T(*before<T>());
      before_ = {};
      held_ = 0;
    } else if (sight == Sight::OtherScene || sight == Sight::Hidden) {
      Before kept = before_;
      if (held_ > 0) {  // the object was not found since the last break: what was learned there is dropped
        tracker = T(*before<T>());
      } else {
        before_ = {};  // a copy has no copy itself
        kept = {seen_, std::make_shared<const T>(tracker), sight == Sight::Hidden};
      }
      before_ = std::move(kept);
      held_ = before_.seen.lost ? 0 : 1;
    }
    TrackResult result;
    if (sight != Sight::Blank) {
      result = (tracker.*follow)(frame);
      learn(frame, view, result);
      if (held_ > 0 && (finds(result) || held_ > kMostHeld)) held_ = 0;
      if (held_ == 0) return result;
      ++held_;
    }
    TrackResult stays = ((held_ > 0 ? *before<T>() : tracker).*standing)();
    if (const Point2 centre = centre_of(stays.box), kept = kept_in_image(frame, centre); kept != centre)
      stays.box = box_around(kept, {stays.box.width, stays.box.height});
    stays.confidence = result.confidence;
    stays.times = std::move(result.times);
    stays.lost = stays.interrupted = true;
    return stays;
  }

  /// For save_state, of the gate of `tracker`; `visit_learned(t)` visits what a tracker t has learned.
  template <class T, class Visit>
  void visit_state(StateArchive& archive, const T& tracker, Visit&& visit_learned) {
    visit_seen(archive, seen_);
    archive(held_);
    archive.require(held_ >= 0 && held_ <= kMostHeld + 1);
    bool broken = before_.tracker != nullptr;
    archive(broken);
    archive.require(broken || held_ == 0);
    if (archive.loading()) before_ = {};
    if (!broken) return;
    const auto of_before = std::make_shared<T>(archive.loading() ? tracker : *before<T>());
    visit_learned(*of_before);
    before_.tracker = of_before;
    visit_seen(archive, before_.seen);
    archive(before_.hidden);
  }

 private:
  // What a frame shows, compared with one that was followed.
  enum class Sight {
    Scene,       // the same scene
    OtherScene,  // another one, or noise
    Hidden,      // the same scene, but much of the object's surroundings has become blank
    Blank,       // nothing at all, where there was something
    Back         // the scene from before the last break, after frames of another one
  };
  static constexpr int kNearCells = 8;  // a side
  // 1 for a cell about the object that has one gray level, else 0.
  using Blanks = std::array<std::uint8_t, kNearCells * kNearCells>;

  // Of a frame that was followed.
  struct Seen {
    Point2 centre = Point2::Zero();
    Size2 size = Size2::Ones();
    double confidence = 0;
    bool lost = false;
    View view{};
    Blanks blanks{};
  };
  // The frame before the last break, and the tracker (a T) then; none if the scene from before is back.
  struct Before {
    Seen seen;
    std::shared_ptr<const void> tracker;
    bool hidden = false;  // since the break the scene is hidden, rather than another
  };

  template <class T>
  const T* before() const {
    return static_cast<const T*>(before_.tracker.get());
  }

  // Throws unless the box and its surroundings have several gray levels or colors.
  static void require_contrast(const Frame& frame, const cv::Rect2d& box);
  static View view_of(const Frame& frame);
  // About the box that was followed.
  static Blanks blanks_of(const Seen& seen, const Frame& frame);
  static Sight compare(const Seen& seen, const Frame& frame, const View& view);
  static void visit_seen(StateArchive& archive, Seen& seen);
  Sight judge(const Frame& frame, const View& view) const;
  // Whether the tracker found its object, and is not much less sure of it than before the break.
  bool finds(const TrackResult& result) const;
  // The tracker followed a frame.
  void learn(const Frame& frame, const View& view, const TrackResult& result);

  Seen seen_;
  Before before_;
  int held_ = 0;  // frames since the break in which the object has not been found; 0: it has been
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
