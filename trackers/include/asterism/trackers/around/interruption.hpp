#pragma once

#include <array>
#include <asterism/trackers/tracker/tracker.hpp>
#include <cstdint>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Whether a frame shows anything that a tracker can start on: not one gray level, nor noise, in which
/// neighbouring pixels have nothing to do with each other (their correlation is below 0.25).
ASTERISM_API bool shows_scene(const Frame& frame);

/// A coarse view of a frame: mean gray levels of kCells x kCells cells, row by row.
struct ASTERISM_API SceneView {
  static constexpr int kCells = 16;  ///< a side, of the frame

  /// A view of no frame: all levels are 0.
  SceneView() = default;
  /// A view of this frame.
  explicit SceneView(const Frame& frame);

  /// Whether it shows nearly one gray level.
  bool is_blank() const;
  /// 0 if either has one gray level.
  double correlation(const SceneView& other) const;

  std::array<std::uint8_t, kCells * kCells> levels{};  ///< the means
};

/// The content of a frame, compared with one that was followed.
enum class Sight {
  Scene,       ///< the same scene
  OtherScene,  ///< another one, or noise
  Hidden,      ///< the same scene, but much of the object's surroundings has become blank
  Blank,       ///< nothing at all, where there was something
  Back         ///< the scene from before the last abrupt change, after frames of another one
};

/// What GatedTracker knows of a frame that its tracker followed, to recognise the frames that interrupt a
/// video. docs/in-practice.md has the figures behind the constants.
struct ASTERISM_API FollowedFrame {
  static constexpr int kCells = 8;  ///< a side, of the object's surroundings

  /// None yet: the box is empty.
  FollowedFrame() = default;
  /// The frame that a tracker starts in. Throws std::invalid_argument for a box that check_start refuses, and
  /// if the box and its surroundings (of twice its sides) have one gray level or color: there is nothing to
  /// follow.
  FollowedFrame(const Frame& frame, const cv::Rect2d& box);
  /// This becomes the frame, of this view and result. A box that is empty or not finite is not taken.
  void learn(const Frame& frame, const SceneView& frame_view, const TrackResult& result);
  /// Classifies a later frame, which has this view.
  Sight compare(const Frame& frame, const SceneView& frame_view) const;
  /// Whether a tracker found its object in a later frame, and is not much less sure of it.
  bool is_found(const TrackResult& result) const;
  void visit_state(StateArchive& archive);

  cv::Rect2d box;                                      ///< the tracker's
  double confidence = 0;                               ///< its own
  bool weak = false;                                   ///< TrackResult::is_weak
  SceneView view;                                      ///< of the whole frame
  std::array<std::uint8_t, kCells * kCells> blanks{};  ///< 1 for a cell about the object of one gray level
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
