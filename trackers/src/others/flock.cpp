#include <asterism/trackers/others/flock.hpp>
#include <asterism/trackers/tracker/tracker_options.hpp>
#include <cmath>
#include <stdexcept>

#include "../tracker/require.hpp"
#include "../tracker/stage_clock.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

Flock::Flock(const FlockOptions& options)
    : options_(check_options("FlockOptions", options)), flow_(options.flow), points_(options.springs) {}

void Flock::start(const Frame& frame, const cv::Rect2d& box) {
  pose_ = ObjectPose(box);
  const int n = options_.grid;
  ElasticConstellation::Points layout(2, n * n);
  for (int i = 0; i < n * n; ++i) {
    const int row = i / n, col = i % n;
    layout.col(i) = pose_.first_size().cwiseProduct(Point2(col + 0.5, row + 0.5) / n - Point2(0.5, 0.5));
  }
  points_.assign(layout, layout.colwise() + pose_.centre(),
                 Topology<>::k_nearest(layout, options_.neighbours));
  flow_.learn(frame, pose_.centre(), pose_.size());
}

TrackResult Flock::standing() const { return points_.standing(pose_, pose_.size() / options_.grid); }

TrackResult Flock::follow(const Frame& frame) {
  StageClock clock;
  TrackResult result;

  // Each point by itself.
  const std::vector<Evidence> evidence = flow_.follow(frame, points_.placement());
  result.times.push_back({"parts", clock.lap()});

  // The motion that most of them agree with sets lengths and start of the springs.
  ElasticConstellation::Points seen(2, points_.size());
  Eigen::VectorXd weights(points_.size());
  for (int i = 0; i < points_.size(); ++i) {
    seen.col(i) = evidence[static_cast<std::size_t>(i)].position;
    // The box's corners are often background, which agrees with itself.
    const Point2 u = points_.layout().col(i).cwiseQuotient(pose_.first_size() / 2);
    weights[i] =
        evidence[static_cast<std::size_t>(i)].peak * std::exp(-options_.centre_weight * u.squaredNorm());
  }
  double mean_peak = 0;
  for (const Evidence& part : evidence) mean_peak += part.peak / points_.size();
  const double reach = options_.springs.reach;
  const RobustTransform agreed = fit_pose(points_.layout(), seen, weights, pose_, reach);
  const double confidence = agreed.support * mean_peak;
  const bool lost = confidence < options_.lost_below;
  if (!lost) pose_.move_to(agreed.transform);
  ElasticConstellation::Points& placement = points_.placement();
  placement = points_.posed(pose_);
  result.times.push_back({"motion", clock.lap()});

  points_.place(pose_, evidence);
  result.times.push_back({"springs", clock.lap()});

  // The object moves as the MAP placement does; points that do not begin anew where it puts them.
  if (!lost) pose_.move_to(fit_pose(points_.layout(), placement, weights, pose_, reach).transform);
  pose_.keep_in(frame);
  const double spacing = pose_.mean_side() / options_.grid;
  const ElasticConstellation::Points expected = points_.posed(pose_);
  for (int i = 0; i < points_.size(); ++i) {
    const Evidence& part = evidence[static_cast<std::size_t>(i)];
    const bool works = part.peak > 0 &&
                       (placement.col(i) - expected.col(i)).norm() <= options_.max_residual * spacing &&
                       (placement.col(i) - part.position).norm() <= options_.max_residual * spacing;
    if (!works) placement.col(i) = expected.col(i);
    result.parts.push_back({.position = placement.col(i),
                            .size = pose_.size() / options_.grid,
                            .visual_best = part.position,
                            .weight = part.peak,
                            .updated = works});
  }
  points_.relax(pose_, options_.layout_rate);
  result.links = points_.links();
  flow_.learn(frame, pose_.centre(), pose_.size());
  result.times.push_back({"part update", clock.lap()});

  result.box = pose_.box();
  result.angle = pose_.angle();
  result.confidence = std::clamp(confidence, 0.0, 1.0);
  result.lost = lost;
  return result;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
