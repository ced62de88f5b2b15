#include <asterism/trackers/others/keypoint_tracker.hpp>
#include <asterism/trackers/tracker/tracker_options.hpp>
#include <cmath>
#include <opencv2/features2d.hpp>
#include <stdexcept>

#include "../tracker/require.hpp"
#include "../tracker/stage_clock.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Bits of an ORB descriptor.
constexpr double kDescriptorBits = 256;
// Deviation of a key-point that was found anew, and least distance of two parts [window pixels].
constexpr double kDetection = 1, kLeastDistance = 3;

}  // namespace

KeypointTracker::KeypointTracker(const KeypointTrackerOptions& options)
    : options_(check_options("KeypointTrackerOptions", options)),
      flow_(options.flow),
      parts_(options.springs) {
  require(options.padding <= options.max_padding,
          "KeypointTrackerOptions: padding must be at most max_padding");
}

void KeypointTracker::start(const Frame& frame, const cv::Rect2d& box) {
  pose_ = ObjectPose(box);
  padding_ = options_.padding;
  parts_.clear();
  descriptors_ = cv::Mat();
  unseen_.clear();
  flow_.learn(frame, pose_.centre(), pose_.size());
  const Detection seen = detect(frame);
  learn_background(seen);
  renew(seen);
}

TrackResult KeypointTracker::standing() const {
  return parts_.standing(pose_, Size2::Constant(31 * flow_.window().spacing()));
}

TrackResult KeypointTracker::follow(const Frame& frame) {
  StageClock clock;
  TrackResult result;

  // Where each part that was seen went, and where each looks as it did.
  const int n = parts_.size();
  const auto at = [](int i) { return static_cast<std::size_t>(i); };
  std::vector<Evidence> followed = flow_.follow(frame, parts_.placement());
  for (int i = 0; i < n; ++i)
    if (unseen_[at(i)] > 0) followed[at(i)].peak = 0;
  result.times.push_back({"flow", clock.lap()});
  const Detection seen = detect(frame);
  std::vector<Evidence> evidence = match(seen);
  result.times.push_back({"matching", clock.lap()});

  // The motion that most of both agree with.
  Points from(2, 2 * n), to(2, 2 * n);
  from << parts_.layout(), parts_.layout();
  Eigen::VectorXd weights(2 * n);
  for (int i = 0; i < n; ++i) {
    const double share = std::exp(-options_.centre_weight *
                                  parts_.layout().col(i).cwiseQuotient(pose_.first_size() / 2).squaredNorm());
    to.col(i) = followed[at(i)].position, to.col(n + i) = evidence[at(i)].position;
    weights[i] = share * followed[at(i)].peak, weights[n + i] = share * evidence[at(i)].peak;
  }
  const double reach = options_.springs.reach;
  const RobustTransform agreed = fit_pose(from, to, weights, pose_, reach);
  // A match that agrees counts before the flow, which drifts.
  double agreeing = 0;
  for (int i = 0; i < n; ++i) {
    const Point2 expected = agreed.transform(parts_.layout().col(i));
    const auto error = [&](const Evidence& e) {
      return (e.position - expected).norm() / (reach * pose_.mean_side());
    };
    const Evidence& flow = followed[at(i)];
    Evidence& part = evidence[at(i)];
    if (flow.peak > 0 && !(part.peak > 0 && error(part) < 1)) part = flow;
    if (part.peak > 0) agreeing += 1 / (1 + error(part) * error(part));
  }
  const bool lost = agreeing < options_.min_agreeing || agreeing < options_.lost_below * n;
  if (!lost) pose_.move_to(agreed.transform);
  result.times.push_back({"motion", clock.lap()});

  // The MAP placement, and the object's motion by it.
  parts_.placement() = parts_.posed(pose_);
  if (!lost) parts_.place(pose_, evidence);
  result.times.push_back({"springs", clock.lap()});
  if (!lost) {
    const Eigen::VectorXd either = weights.head(n).cwiseMax(weights.tail(n));
    pose_.move_to(fit_pose(parts_.layout(), parts_.placement(), either, pose_, reach).transform);
    pose_.keep_in(frame);
  }

  const Points expected = parts_.posed(pose_);
  const double near = reach * pose_.mean_side();
  for (int i = 0; i < n; ++i) {
    const Evidence& part = evidence[at(i)];
    const bool works = !lost && part.peak > 0 && (parts_.placement().col(i) - part.position).norm() <= near &&
                       (parts_.placement().col(i) - expected.col(i)).norm() <= near;
    if (!lost) unseen_[at(i)] = works ? 0 : unseen_[at(i)] + 1;
    if (!works) parts_.placement().col(i) = expected.col(i);
    result.parts.push_back({.position = parts_.placement().col(i),
                            .size = Size2::Constant(31 * flow_.window().spacing()),
                            .visual_best = part.position,
                            .weight = part.peak,
                            .updated = works});
  }
  result.links = parts_.links();
  result.box = pose_.box();
  result.angle = pose_.angle();
  result.confidence = n > 0 ? std::clamp(agreeing / n, 0.0, 1.0) : 0;
  result.lost = lost;
  if (lost) {
    for (int& frames : unseen_) frames = std::max(frames, 1);  // only a match brings them back
    padding_ = std::min(options_.max_padding, 1.1 * padding_);
  } else {
    padding_ = options_.padding;
    renew(seen);
  }
  flow_.learn(frame, pose_.centre(), pose_.size());
  result.times.push_back({"part update", clock.lap()});
  return result;
}

KeypointTracker::Detection KeypointTracker::detect(const Frame& frame) const {
  TemplateWindow searched = options_.flow.window;
  searched.padding = padding_;
  const ObjectWindow window(pose_.centre(), pose_.size(), searched);
  // One scale, as the window has the object's, and up to the window's border, which ORB continues by itself.
  const auto orb = cv::ORB::create(options_.max_points, 1.2f, 1, 0, 0, 2, cv::ORB::HARRIS_SCORE, 31,
                                   options_.fast_threshold);
  std::vector<cv::KeyPoint> points;
  Detection result;
  orb->detectAndCompute(window.sample(frame), cv::noArray(), points, result.descriptors);
  result.positions.resize(2, static_cast<Eigen::Index>(points.size()));
  for (Eigen::Index i = 0; const cv::KeyPoint& point : points)
    result.positions.col(i++) = window.to_image(point.pt);
  return result;
}

std::vector<Evidence> KeypointTracker::match(const Detection& seen) const {
  std::vector<Evidence> result(unseen_.size());
  for (std::size_t i = 0; i < result.size(); ++i)
    result[i].position = parts_.placement().col(static_cast<Eigen::Index>(i));
  if (descriptors_.empty() || seen.descriptors.empty()) return result;
  cv::Mat known = descriptors_.clone();
  if (!background_.empty()) known.push_back(background_);
  std::vector<std::vector<cv::DMatch>> matches;
  cv::BFMatcher(cv::NORM_HAMMING).knnMatch(seen.descriptors, known, matches, 2);

  const double deviation = kDetection * flow_.window().spacing();
  for (const std::vector<cv::DMatch>& found : matches) {
    const cv::DMatch& best = found[0];
    if (best.trainIdx >= descriptors_.rows || best.distance > options_.max_distance * kDescriptorBits)
      continue;
    if (found.size() > 1 && best.distance >= options_.max_ratio * found[1].distance) continue;
    Evidence& part = result[static_cast<std::size_t>(best.trainIdx)];
    const double peak = 1 - best.distance / kDescriptorBits;
    if (peak <= part.peak) continue;
    part = {seen.positions.col(best.queryIdx), peak, deviation * deviation * Eigen::Matrix2d::Identity()};
  }
  return result;
}

void KeypointTracker::renew(const Detection& seen) {
  const PlaneTransform to_object = pose_.transform().inverse();
  std::vector<Point2> layout, placement;
  std::vector<int> unseen;
  cv::Mat descriptors;
  const auto keep = [&](const Point2& in_object, const Point2& in_image, const cv::Mat& descriptor,
                        int frames) {
    layout.push_back(in_object), placement.push_back(in_image);
    descriptors.push_back(descriptor), unseen.push_back(frames);
  };
  for (int i = 0; i < parts_.size(); ++i)
    if (const int frames = unseen_[static_cast<std::size_t>(i)]; frames < options_.forget_after)
      keep(parts_.layout().col(i), parts_.placement().col(i), descriptors_.row(i), frames);
  const std::size_t kept = layout.size();

  const double spacing = kLeastDistance * flow_.window().spacing();
  for (int i = 0; i < seen.positions.cols() && std::ssize(layout) < options_.max_parts; ++i) {
    const Point2 position = seen.positions.col(i), in_object = to_object(position);
    const auto too_near = [&](const Point2& other) { return (other - position).norm() < spacing; };
    if (pose_.covers(in_object) && std::none_of(placement.begin(), placement.end(), too_near))
      keep(in_object, position, seen.descriptors.row(i), 0);
  }
  if (layout.size() == kept && static_cast<int>(kept) == parts_.size()) return;

  Points points(2, std::ssize(layout)), placed(2, std::ssize(layout));
  for (std::size_t i = 0; i < layout.size(); ++i) {
    points.col(static_cast<Eigen::Index>(i)) = layout[i];
    placed.col(static_cast<Eigen::Index>(i)) = placement[i];
  }
  parts_.assign(points, placed, Topology<>::k_nearest(points, options_.neighbours));
  descriptors_ = descriptors, unseen_ = unseen;
}

void KeypointTracker::learn_background(const Detection& seen) {
  background_ = cv::Mat();
  const PlaneTransform to_object = pose_.transform().inverse();
  for (int i = 0; i < seen.positions.cols(); ++i)
    if (!pose_.covers(to_object(seen.positions.col(i)))) background_.push_back(seen.descriptors.row(i));
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
