#pragma once

#include <asterism/trackers/around/interruption.hpp>
#include <asterism/trackers/constellation/pose.hpp>
#include <asterism/trackers/tracker/tracker_base.hpp>
#include <concepts>
#include <optional>
#include <utility>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Any tracker that can be copied, kept out of frames that interrupt a video: blank frames, noise, a test
/// card, a decoder's gray blocks, a cut to another scene.
///
///     GatedTracker tracker{Dpt(options)};
///
/// In a blank frame the tracker stays where it is and learns nothing. If the view changes abruptly, a copy of
/// the tracker is kept, which learns nothing, while the tracker itself follows the new view. If the view from
/// before is back, the copy goes on in place of the tracker, as if there had been nothing in between. Until
/// then the result is the tracker's if it finds its object in the new view; otherwise it is that of the copy,
/// which stays where it is, until the new view has lasted for kMostHeld frames.
///
/// The result of a tracker that stays is its `standing()`, if it has that function; otherwise it has the last
/// box alone. A GatedTracker can be saved if the tracker in it can.
template <Tracker T>
requires std::copyable<T>
class GatedTracker {
 public:
  /// Number of successive frames of a new scene, at most, in which the box stays where it was.
  static constexpr int kMostHeld = 10;

  /// Around this tracker, which may have been initialised or not; init() is still to be called.
  explicit GatedTracker(T tracker) : now_{std::move(tracker), {}} {}

  /// See Tracker. Also throws std::invalid_argument, and keeps the former state, if the box and its
  /// surroundings (of twice its sides) have one gray level or color: there is nothing to follow.
  void init(const cv::Mat& image, const cv::Rect2d& box) { init(first_frame(image), box); }
  void init(const Frame& frame, const cv::Rect2d& box) {
    const FollowedFrame first(frame, box);  // which may refuse
    now_.tracker.init(detail::seen_by<T>(frame), box);
    now_.frame = first;
    before_.reset();
    held_ = 0;
  }
  /// On the region's equal_area_box.
  void init(const cv::Mat& image, const Region& region) { init(image, region.equal_area_box()); }
  void init(const Frame& frame, const Region& region) { init(frame, region.equal_area_box()); }
  /// See Tracker; the conversion of an image is the first stage.
  TrackResult update(const cv::Mat& image) {
    return detail::update_timed(image, [this](const Frame& frame) { return update(frame); });
  }
  TrackResult update(const Frame& frame) {
    const auto follow = [&] { return now_.tracker.update(detail::seen_by<T>(frame)); };
    if (now_.frame.box.empty()) return follow();  // which the tracker refuses before `init`
    const SceneView view(frame);
    const Sight sight = judge(frame, view);
    if (sight == Sight::Blank) return stay(frame, {});
    if (sight == Sight::Back) {
      now_ = *std::move(before_);
      before_.reset();
      held_ = 0;
    } else if (sight != Sight::Scene) {
      if (held_ > 0) {  // what was learned since the last change is dropped
        now_ = Followed(*before_);
      } else {
        before_ = Followed(now_);
        hidden_ = sight == Sight::Hidden;
      }
      held_ = before_->frame.weak ? 0 : 1;
    }
    TrackResult result = follow();
    now_.frame.learn(frame, view, result);
    if (held_ > 0 && (before_->frame.is_found(result) || held_ > kMostHeld)) held_ = 0;
    if (held_ == 0) return result;
    ++held_;
    return stay(frame, std::move(result));
  }

  /// The tracker in it. After an abrupt change it is the one that follows the new view.
  const T& tracker() const { return now_.tracker; }

  void visit_state(StateArchive& archive) requires Stateful<T> {
    bool broken = before_.has_value();
    now_.visit_state(archive);
    archive(held_), archive(broken);
    archive.require(held_ >= 0 && held_ <= (broken ? kMostHeld + 1 : 0));
    if (archive.loading()) before_ = broken ? std::optional(now_) : std::nullopt;
    if (broken) before_->visit_state(archive), archive(hidden_);
  }

 private:
  // A tracker, and the last frame that it followed.
  struct Followed {
    void visit_state(StateArchive& archive) { tracker.visit_state(archive), frame.visit_state(archive); }
    T tracker;
    FollowedFrame frame;
  };

  Sight judge(const Frame& frame, const SceneView& view) const {
    if (!before_) return now_.frame.compare(frame, view);
    const Sight sight_before = before_->frame.compare(frame, view);
    // Successive frames of faint noise are no scene that continues.
    if (held_ > 0 && view.is_blank() && !before_->frame.view.is_blank()) return sight_before;
    const Sight sight = now_.frame.compare(frame, view);
    if (sight == Sight::Blank || sight_before != Sight::Scene) return sight;
    // A scene that went on may come to resemble the one before the change, while the camera turns back, say.
    const bool nearer = before_->frame.view.correlation(view) > now_.frame.view.correlation(view);
    return held_ > 0 || hidden_ || nearer ? Sight::Back : sight;
  }

  // The result in a frame that shows nothing, or in which the tracker did not find its object.
  TrackResult stay(const Frame& frame, TrackResult followed) const {
    const Followed& last = held_ > 0 ? *before_ : now_;
    TrackResult result;
    if constexpr (requires { TrackResult(last.tracker.standing()); })
      result = last.tracker.standing();
    else
      result.box = last.frame.box;
    if (const Point2 centre = centre_of(result.box), kept = kept_in_image(frame, centre); kept != centre)
      result.box = box_around(kept, {result.box.width, result.box.height});
    result.confidence = followed.confidence;
    result.times = std::move(followed.times);
    result.lost = result.interrupted = true;
    return result;
  }

  Followed now_;
  std::optional<Followed> before_;  // the last abrupt change; none if the scene from before it is back
  bool hidden_ = false;             // since then the scene is hidden, rather than another
  int held_ = 0;  // frames since then in which the object has not been found; 0: it has been
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
