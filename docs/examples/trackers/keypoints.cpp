// A constellation of key-points, after CMT (Nebehay and Pflugfelder, CVPR 2015): up to hundreds of parts,
// each an ORB key-point that is followed by optical flow and matched within the search window. Both give its
// position; the motion with which most positions agree is the object's. Springs to the nearest neighbours,
// with robust anchors, give the placement. Parts that are no longer seen are replaced by new ones; if few
// agree, the object is lost. It is an example and not a tracker of the library, as plain KCF is better.
//
// A third argument after VIDEO and box is the greatest number of parts, 100 by default.

#include <algorithm>
#include <asterism/trackers/around/gated.hpp>
#include <asterism/trackers/constellation/elastic.hpp>
#include <asterism/trackers/tracker/program.hpp>
#include <asterism/trackers/tracker/tracker_base.hpp>
#include <cmath>
#include <cstdlib>
#include <opencv2/core/utility.hpp>
#include <opencv2/features2d.hpp>
#include <string>
#include <vector>

#include "point_flow.hpp"

using namespace asterism;

class KeypointTracker : public TrackerBase<KeypointTracker> {
 public:
  explicit KeypointTracker(int max_parts) : max_parts_(max_parts) {}
  TrackResult standing() const { return parts_.standing(pose_, part_size()); }

 private:
  friend TrackerBase<KeypointTracker>;
  static constexpr std::string_view kName = "KeypointTracker";
  static constexpr int kNeighbours = 6;                     // links of a part
  static constexpr double kReach = 0.05;                    // of evidence [object's mean side]
  static constexpr int kMaxPoints = 500, kFast = 7;         // of a window, FAST's threshold [gray levels]
  static constexpr double kBits = 256, kOrbSide = 31;       // of a descriptor; of its patch [window pixels]
  static constexpr double kMaxDistance = 0.25;              // of a match [share of the bits]
  static constexpr double kMaxRatio = 0.8;                  // of a match's distance to the next best's
  static constexpr double kDeviation = 1;                   // of a match [window pixels]
  static constexpr double kLeastDistance = 3;               // of two parts [window pixels]
  static constexpr double kPadding = 1.5, kMaxPadding = 6;  // of the window; while the object is lost
  static constexpr double kCentreWeight = 1;
  static constexpr double kMinAgreeing = 3, kLostBelow = 0.05;  // parts, and share of the parts
  static constexpr int kForgetAfter = 30;                       // frames in which a part was not seen
  using Points = ElasticConstellation::Points;
  // Key-points of a window: positions in the image, descriptors row by row.
  struct Detection {
    Points positions;
    cv::Mat descriptors;
  };

  void start(const Frame& frame, const cv::Rect2d& box) {
    pose_ = ObjectPose(box);
    padding_ = kPadding;
    parts_.assign(Points(2, 0), Points(2, 0), Topology<>::full(0));
    descriptors_ = background_ = cv::Mat();
    unseen_.clear();
    flow_.learn(frame, pose_.centre(), pose_.size());
    const Detection seen = detect(frame);
    const PlaneTransform to_object = pose_.transform().inverse();
    for (int i = 0; i < seen.positions.cols(); ++i)
      if (!pose_.covers(to_object(seen.positions.col(i)))) background_.push_back(seen.descriptors.row(i));
    renew(seen);
  }

  Size2 part_size() const { return Size2::Constant(kOrbSide * flow_.window().spacing()); }

  TrackResult follow(const Frame& frame) {
    TrackResult result;
    cv::TickMeter clock;
    clock.start();
    const auto lap = [&](std::string_view stage) {
      clock.stop();
      result.times.push_back({stage, clock.getTimeMilli()});
      clock.reset();
      clock.start();
    };

    // Each part's position by flow, if it was seen last, and by its match.
    const int n = parts_.size();
    const auto at = [](int i) { return static_cast<std::size_t>(i); };
    std::vector<Evidence> followed = flow_.follow(frame, parts_.placement());
    for (int i = 0; i < n; ++i)
      if (unseen_[at(i)] > 0) followed[at(i)].peak = 0;
    lap("flow");
    const Detection seen = detect(frame);
    std::vector<Evidence> evidence = match(seen);
    lap("matching");

    // The motion with which most of these positions agree.
    Points from(2, 2 * n), to(2, 2 * n);
    from << parts_.layout(), parts_.layout();
    Eigen::VectorXd weights(2 * n);
    for (int i = 0; i < n; ++i) {
      const Point2 u = parts_.layout().col(i).cwiseQuotient(pose_.first_size() / 2);
      const double share = std::exp(-kCentreWeight * u.squaredNorm());
      to.col(i) = followed[at(i)].position, to.col(n + i) = evidence[at(i)].position;
      weights[i] = share * followed[at(i)].peak, weights[n + i] = share * evidence[at(i)].peak;
    }
    const RobustTransform agreed = fit_pose(from, to, weights, pose_, kReach);
    // A match that agrees takes precedence over the flow, which drifts.
    double agreeing = 0;
    for (int i = 0; i < n; ++i) {
      const Point2 expected = agreed.transform(parts_.layout().col(i));
      const auto error = [&](const Evidence& e) {
        return (e.position - expected).norm() / (kReach * pose_.mean_side());
      };
      Evidence& part = evidence[at(i)];
      if (followed[at(i)].peak > 0 && !(part.peak > 0 && error(part) < 1)) part = followed[at(i)];
      if (part.peak > 0) agreeing += 1 / (1 + error(part) * error(part));
    }
    result.lost = agreeing < kMinAgreeing || agreeing < kLostBelow * n;
    if (!result.lost) pose_.move_to(agreed.transform);
    lap("motion");

    // The MAP placement, and the object's motion that follows from it.
    parts_.placement() = parts_.posed(pose_);
    if (!result.lost) parts_.place(pose_, evidence);
    lap("springs");
    if (!result.lost) {
      const Eigen::VectorXd either = weights.head(n).cwiseMax(weights.tail(n));
      pose_.move_to(fit_pose(parts_.layout(), parts_.placement(), either, pose_, kReach).transform);
      pose_.keep_in(frame);
    }

    const Points expected = parts_.posed(pose_);
    const double near = kReach * pose_.mean_side();
    for (int i = 0; i < n; ++i) {
      const Evidence& part = evidence[at(i)];
      const bool works = !result.lost && part.peak > 0 &&
                         (parts_.placement().col(i) - part.position).norm() <= near &&
                         (parts_.placement().col(i) - expected.col(i)).norm() <= near;
      if (!result.lost) unseen_[at(i)] = works ? 0 : unseen_[at(i)] + 1;
      if (!works) parts_.placement().col(i) = expected.col(i);
      result.parts.push_back({parts_.placement().col(i), part_size(), part.position, part.peak, works});
    }
    result.links = parts_.links();
    result.box = pose_.box();
    result.angle = pose_.angle();
    result.confidence = n > 0 ? std::clamp(agreeing / n, 0.0, 1.0) : 0;
    if (result.lost) {
      for (int& frames : unseen_) frames = std::max(frames, 1);  // only a match brings them back
      padding_ = std::min(kMaxPadding, 1.1 * padding_);
    } else {
      padding_ = kPadding;
      renew(seen);
    }
    flow_.learn(frame, pose_.centre(), pose_.size());
    lap("part update");
    return result;
  }

  Detection detect(const Frame& frame) const {
    TemplateWindow searched = kWindow;
    searched.padding = padding_;
    const ObjectWindow window(pose_.centre(), pose_.size(), searched);
    // A single scale, as the window is resampled to the object's; key-points up to the window's border, which
    // ORB pads by itself.
    const auto orb = cv::ORB::create(kMaxPoints, 1.2f, 1, 0, 0, 2, cv::ORB::HARRIS_SCORE, 31, kFast);
    std::vector<cv::KeyPoint> points;
    Detection result;
    orb->detectAndCompute(window.sample(frame), cv::noArray(), points, result.descriptors);
    result.positions.resize(2, std::ssize(points));
    for (Eigen::Index i = 0; const cv::KeyPoint& point : points)
      result.positions.col(i++) = window.to_image(point.pt);
    return result;
  }

  // The evidence of each part, with peak 0 if nothing matches.
  std::vector<Evidence> match(const Detection& seen) const {
    std::vector<Evidence> result(unseen_.size());
    for (std::size_t i = 0; i < result.size(); ++i)
      result[i].position = parts_.placement().col(static_cast<Eigen::Index>(i));
    if (descriptors_.empty() || seen.descriptors.empty()) return result;
    cv::Mat known = descriptors_.clone();
    if (!background_.empty()) known.push_back(background_);
    std::vector<std::vector<cv::DMatch>> matches;
    cv::BFMatcher(cv::NORM_HAMMING).knnMatch(seen.descriptors, known, matches, 2);

    const double deviation = kDeviation * flow_.window().spacing();
    for (const std::vector<cv::DMatch>& found : matches) {
      const cv::DMatch& best = found[0];
      if (best.trainIdx >= descriptors_.rows || best.distance > kMaxDistance * kBits) continue;
      if (found.size() > 1 && best.distance >= kMaxRatio * found[1].distance) continue;
      Evidence& part = result[static_cast<std::size_t>(best.trainIdx)];
      const double peak = 1 - best.distance / kBits;
      if (peak <= part.peak) continue;
      part = {seen.positions.col(best.queryIdx), peak, deviation * deviation * Eigen::Matrix2d::Identity()};
    }
    return result;
  }

  // Drops parts that have not been seen for long, and adds key-points in the box that are not yet parts.
  void renew(const Detection& seen) {
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
      if (const int frames = unseen_[static_cast<std::size_t>(i)]; frames < kForgetAfter)
        keep(parts_.layout().col(i), parts_.placement().col(i), descriptors_.row(i), frames);
    const std::size_t kept = layout.size();

    const double spacing = kLeastDistance * flow_.window().spacing();
    for (int i = 0; i < seen.positions.cols() && std::ssize(layout) < max_parts_; ++i) {
      const Point2 position = seen.positions.col(i), in_object = to_object(position);
      const auto too_near = [&](const Point2& other) { return (other - position).norm() < spacing; };
      if (pose_.covers(in_object) && std::none_of(placement.begin(), placement.end(), too_near))
        keep(in_object, position, seen.descriptors.row(i), 0);
    }
    if (layout.size() == kept && static_cast<int>(kept) == parts_.size()) return;

    const auto columns = [](const std::vector<Point2>& points) {
      Points result(2, std::ssize(points));
      for (Eigen::Index i = 0; const Point2& point : points) result.col(i++) = point;
      return result;
    };
    parts_.assign(columns(layout), columns(placement), Topology<>::k_nearest(columns(layout), kNeighbours));
    descriptors_ = descriptors, unseen_ = unseen;
  }

  static constexpr TemplateWindow kWindow{.padding = 2, .min_template_side = 48, .max_template_side = 128};
  int max_parts_;
  PointFlow flow_{kWindow};
  ElasticConstellation parts_{{.reach = kReach}};
  ObjectPose pose_;
  cv::Mat descriptors_, background_;  // of the parts, and of what was around them
  std::vector<int> unseen_;           // frames since each part was seen
  double padding_ = kPadding;
};

int main(int argc, char** argv) {
  const int parts = argc > 3 ? std::atoi(argv[3]) : 100;
  return run_program(GatedTracker{KeypointTracker(std::max(1, parts))}, argc, argv);
}
