#pragma once

#include <asterism/trackers/constellation/elastic.hpp>
#include <asterism/trackers/others/point_flow.hpp>
#include <asterism/trackers/tracker/tracker_base.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of KeypointTracker; the matching is that of CMT.
struct KeypointTrackerOptions {
  PointFlowOptions flow;
  /// Parts at most, in [1, 1000], and key-points of a frame's search window at most, in [1, 5000].
  int max_parts = 100;
  int max_points = 500;
  /// FAST's threshold [gray levels, in [1, 255]].
  int fast_threshold = 7;
  /// A match differs in at most this share of the descriptor's bits, in (0, 1], ...
  double max_distance = 0.25;
  /// ... and in less than this times those of the next best part or piece of background, in (0, 1].
  double max_ratio = 0.8;
  /// The search window adds this much around the object, x its mean side on both axes, in (0, 100]. It grows
  /// by a tenth with each frame in which the object is lost, to max_padding.
  double padding = 1.5, max_padding = 6;
  /// Each part is linked to as many nearest ones, in [1, 100].
  int neighbours = 6;
  ElasticOptions springs = {.reach = 0.05};
  /// A part at u, in [-1, 1] on both axes of the box, counts exp(-centre_weight |u|^2) for the motion, >= 0.
  double centre_weight = 1;
  /// A part that was not seen for so many frames makes place for a new one, > 0.
  int forget_after = 30;
  /// The object is lost with fewer parts that move as one, > 0, or a smaller share of all, in [0, 1].
  double min_agreeing = 3;
  double lost_below = 0.05;
};

/// A constellation of key-points, after CMT (Nebehay and Pflugfelder, CVPR 2015): up to hundreds of parts,
/// each an ORB key-point that is followed by optical flow and matched within the search window. Both say
/// where it is; what most of them agree with is the object's motion, and springs to the nearest neighbours
/// with robust anchors the placement. Parts that are not seen any more are replaced by new ones; few that
/// agree are an occlusion, and the object is lost.
class ASTERISM_API KeypointTracker : public TrackerBase<KeypointTracker> {
 public:
  /// Throws std::invalid_argument for options out of range.
  explicit KeypointTracker(const KeypointTrackerOptions& options = {});

  const KeypointTrackerOptions& options() const { return options_; }

 private:
  friend TrackerBase<KeypointTracker>;
  static constexpr std::string_view kName = "KeypointTracker";

  void start(const Frame& frame, const cv::Rect2d& box);
  TrackResult follow(const Frame& frame);
  TrackResult standing() const;
  void visit_learned(StateArchive& archive);

  using Points = ElasticConstellation::Points;
  // Key-points of a window: positions in the image, descriptors row by row.
  struct Detection {
    Points positions;
    cv::Mat descriptors;
  };

  Detection detect(const Frame& frame) const;
  // Matches as evidence, one a part, of peak 0 where there is none.
  std::vector<Evidence> match(const Detection& seen) const;
  // Parts that are not seen any more leave, key-points in the box that are no parts join; the layout is what
  // the pose says of `positions`.
  void renew(const Detection& seen);
  void learn_background(const Detection& seen);

  KeypointTrackerOptions options_;
  PointFlow flow_;
  ElasticConstellation parts_;
  ObjectPose pose_;
  cv::Mat descriptors_, background_;  // of the parts, and of what was around them; copies share, never write
  std::vector<int> unseen_;           // frames since each part was seen
  double padding_ = 0;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
