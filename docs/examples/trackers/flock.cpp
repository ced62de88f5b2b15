// A flock of trackers (Vojir and Matas, "Robustifying the flock of trackers", CVWW 2011; median flow, Kalal
// et al., ICPR 2010, is its ancestor) as a constellation: a grid of points, each followed by optical flow, on
// springs to its nearest neighbours. It is an example and not a tracker of the library, as plain KCF is
// better.

#include <algorithm>
#include <asterism/trackers/around/gated.hpp>
#include <asterism/trackers/constellation/elastic.hpp>
#include <asterism/trackers/tracker/program.hpp>
#include <asterism/trackers/tracker/tracker_base.hpp>
#include <cmath>
#include <vector>

#include "point_flow.hpp"

using namespace asterism;

class Flock : public TrackerBase<Flock> {
 public:
  TrackResult standing() const { return points_.standing(pose_, pose_.size() / kGrid); }

 private:
  friend TrackerBase<Flock>;
  static constexpr std::string_view kName = "Flock";
  static constexpr int kGrid = 10, kNeighbours = 8;  // points per side, links per point
  static constexpr double kReach = 0.04;             // of evidence [object's mean side]
  static constexpr double kMaxResidual = 0.3;        // of a point that works [spacing of the grid]
  static constexpr double kCentreWeight = 3;
  static constexpr double kLostBelow = 0.05;  // share of the points

  void start(const Frame& frame, const cv::Rect2d& box) {
    pose_ = ObjectPose(box);
    ElasticConstellation::Points layout(2, kGrid * kGrid);
    for (int i = 0; i < kGrid * kGrid; ++i)
      layout.col(i) = pose_.first_size().cwiseProduct(Point2(i % kGrid + 0.5, i / kGrid + 0.5) / kGrid -
                                                      Point2(0.5, 0.5));
    points_.assign(layout, layout.colwise() + pose_.centre(), Topology<>::k_nearest(layout, kNeighbours));
    flow_.learn(frame, pose_.centre(), pose_.size());
  }

  TrackResult follow(const Frame& frame) {
    // Each point is followed by itself. Points near the box's corners weigh less: they are often on the
    // background, whose points agree in a motion of their own.
    const std::vector<Evidence> evidence = flow_.follow(frame, points_.placement());
    ElasticConstellation::Points seen(2, points_.size());
    Eigen::VectorXd weights(points_.size());
    double mean_peak = 0;
    for (int i = 0; i < points_.size(); ++i) {
      const Evidence& point = evidence[static_cast<std::size_t>(i)];
      const Point2 u = points_.layout().col(i).cwiseQuotient(pose_.first_size() / 2);
      seen.col(i) = point.position;
      weights[i] = point.peak * std::exp(-kCentreWeight * u.squaredNorm());
      mean_peak += point.peak / points_.size();
    }

    // The motion with which most points agree gives the springs their lengths and start.
    const RobustTransform agreed = fit_pose(points_.layout(), seen, weights, pose_, kReach);
    TrackResult result;
    result.confidence = std::clamp(agreed.support * mean_peak, 0.0, 1.0);
    result.lost = result.confidence < kLostBelow;
    if (!result.lost) pose_.move_to(agreed.transform);
    ElasticConstellation::Points& placement = points_.placement();
    placement = points_.posed(pose_);
    points_.place(pose_, evidence);

    // The object moves as the MAP placement does; points that do not agree are reset to their places on it.
    if (!result.lost) pose_.move_to(fit_pose(points_.layout(), placement, weights, pose_, kReach).transform);
    pose_.keep_in(frame);
    const double most = kMaxResidual * pose_.mean_side() / kGrid;
    const ElasticConstellation::Points expected = points_.posed(pose_);
    for (int i = 0; i < points_.size(); ++i) {
      const Evidence& point = evidence[static_cast<std::size_t>(i)];
      const bool works = point.peak > 0 && (placement.col(i) - expected.col(i)).norm() <= most &&
                         (placement.col(i) - point.position).norm() <= most;
      if (!works) placement.col(i) = expected.col(i);
      result.parts.push_back({placement.col(i), pose_.size() / kGrid, point.position, point.peak, works});
    }
    flow_.learn(frame, pose_.centre(), pose_.size());
    result.links = points_.links();
    result.box = pose_.box();
    result.angle = pose_.angle();
    return result;
  }

  PointFlow flow_{{.padding = 1.5, .min_template_side = 48, .max_template_side = 128}};
  ElasticConstellation points_{{.reach = kReach}};
  ObjectPose pose_;
};

int main(int argc, char** argv) { return run_program(GatedTracker{Flock()}, argc, argv); }
