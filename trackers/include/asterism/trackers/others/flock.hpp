#pragma once

#include <asterism/trackers/constellation/elastic.hpp>
#include <asterism/trackers/others/point_flow.hpp>
#include <asterism/trackers/tracker/tracker_base.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of Flock.
struct FlockOptions {
  PointFlowOptions flow = {.window = {.padding = 1.5, .min_template_side = 48, .max_template_side = 128}};
  /// Points a side of the grid on the object's box, in [2, 50].
  int grid = 10;
  /// Each point is linked to as many nearest ones, in [1, 100].
  int neighbours = 8;
  ElasticOptions springs = {.reach = 0.04};
  /// A point further than this from where the object's motion puts it has failed [spacing of the grid, > 0].
  double max_residual = 0.3;
  /// A point at u, in [-1, 1] on both axes of the box, counts exp(-centre_weight |u|^2) for the motion, >= 0.
  double centre_weight = 3;
  /// Rate at which the layout follows the placement, in [0, 1].
  double layout_rate = 0;
  /// A smaller share of points that move with the object is a lost target, in [0, 1].
  double lost_below = 0.05;
};

/// Flock of trackers (Vojir and Matas, "Robustifying the flock of trackers", CVWW 2011; median flow, Kalal et
/// al., ICPR 2010, is its ancestor) as a constellation: a grid of points, each followed by optical flow, on
/// springs to its nearest neighbours. The object moves as most of the MAP placement does; points that failed
/// begin anew where this motion puts them.
class ASTERISM_API Flock : public TrackerBase<Flock> {
 public:
  /// Throws std::invalid_argument for options out of range.
  explicit Flock(const FlockOptions& options = {});

  const FlockOptions& options() const { return options_; }

 private:
  friend TrackerBase<Flock>;
  static constexpr std::string_view kName = "Flock";

  void start(const Frame& frame, const cv::Rect2d& box);
  TrackResult follow(const Frame& frame);
  TrackResult standing() const;
  void visit_learned(StateArchive& archive);

  FlockOptions options_;
  PointFlow flow_;
  ElasticConstellation points_;
  ObjectPose pose_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
