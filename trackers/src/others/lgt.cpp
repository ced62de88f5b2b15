#include <algorithm>
#include <asterism/parts/models/color_histogram.hpp>
#include <asterism/trackers/others/lgt.hpp>
#include <asterism/trackers/tracker/tracker_options.hpp>
#include <cmath>
#include <stdexcept>

#include "../tracker/require.hpp"
#include "../tracker/stage_clock.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Parts search so far to each side, and places on the way [part's side].
constexpr double kReach = 2;
constexpr int kSteps = 16;
// Window of the global layer: the box and as much around it, x the mean side.
constexpr double kPadding = 1;
// A new part's weight.
constexpr double kNewWeight = 0.5;

}  // namespace

AnyPart histogram_part() {
  return ColorHistogram({.space = ColorHistogramOptions::Space::Rgb,
                         .window = {.padding = 2 * kReach, .min_template_side = 8, .max_template_side = 10}});
}

Lgt::Lgt(const LgtOptions& options)
    : options_(check_options("LgtOptions", options)), parts_(options.springs), color_(options.color) {}

void Lgt::start(const Frame& frame, const cv::Rect2d& box) {
  pose_ = ObjectPose(box);
  color_.init(frame, box);
  parts_.clear();
  models_.clear(), weights_.clear();
  renew(frame, color_.segment(frame, box, pose_.size()), options_.max_parts);
}

TrackResult Lgt::standing() const {
  return parts_.standing(pose_, Size2::Constant(options_.part_side * pose_.mean_side()));
}

TrackResult Lgt::follow(const Frame& frame) {
  StageClock clock;
  TrackResult result;

  // What both layers see.
  const Segmentation segmentation = color_.segment(
      frame, box_around(pose_.centre(), pose_.size() + Size2::Constant(kPadding * pose_.mean_side())),
      pose_.size());
  result.times.push_back({"color", clock.lap()});
  const std::size_t n = models_.size();
  for (std::size_t i = 0; i < n; ++i)
    models_[i].localize(frame, parts_.placement().col(static_cast<Eigen::Index>(i)));
  result.times.push_back({"parts", clock.lap()});

  // The motion that they have in common, then each by itself near there.
  parts_.placement().colwise() += common_displacement(segmentation);
  std::vector<Evidence> evidence(n);
  for (std::size_t i = 0; i < n; ++i)
    evidence[i] = evidence_near(i, segmentation, parts_.placement().col(static_cast<Eigen::Index>(i)));
  result.times.push_back({"motion", clock.lap()});

  parts_.place(pose_, evidence);
  result.times.push_back({"springs", clock.lap()});

  // The object moves as the weighted placement does; a part does well that fits where it now is.
  Eigen::VectorXd weights(static_cast<Eigen::Index>(n));
  for (std::size_t i = 0; i < n; ++i) weights[static_cast<Eigen::Index>(i)] = weights_[i] * evidence[i].peak;
  const double near = options_.springs.reach * pose_.mean_side();
  pose_.move_to(
      fit_pose(parts_.layout(), parts_.placement(), weights, pose_, options_.springs.reach).transform);
  pose_.keep_in(frame);
  const Points expected = parts_.posed(pose_);
  double confidence = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const auto col = static_cast<Eigen::Index>(i);
    const double strain = (parts_.placement().col(col) - expected.col(col)).norm() / near;
    const double success = likelihood(i, segmentation, parts_.placement().col(col)) / (1 + strain * strain);
    weights_[i] += options_.weight_rate * (success - weights_[i]);
    confidence += models_[i].similarity_at(parts_.placement().col(col)) / (1 + strain * strain) /
                  static_cast<double>(n);
    result.parts.push_back({.position = parts_.placement().col(col),
                            .size = Size2::Constant(options_.part_side * pose_.mean_side()),
                            .visual_best = evidence[i].position,
                            .weight = success,
                            .updated = success > weights_[i]});
    if (result.parts.back().updated) models_[i].adapt(frame, parts_.placement().col(col));
  }
  result.links = parts_.links();
  result.box = pose_.box();
  result.angle = pose_.angle();
  result.confidence = std::clamp(confidence, 0.0, 1.0);
  result.lost = confidence < options_.lost_below;

  parts_.relax(pose_, options_.layout_rate);
  if (!result.lost) {
    renew(frame, segmentation, 1);
    if (segmentation.informative) color_.adapt(frame, pose_.box());
  }
  result.times.push_back({"part update", clock.lap()});
  return result;
}

double Lgt::likelihood(std::size_t part, const Segmentation& segmentation, const Point2& position) const {
  const double similarity = models_[part].similarity_at(position);
  if (!(similarity > 0)) return 0;
  return std::exp(options_.sharpness * std::min(0.0, similarity - 1)) *
         color_.probability(segmentation, position);
}

Point2 Lgt::common_displacement(const Segmentation& segmentation) const {
  const double step = kReach * options_.part_side * pose_.mean_side() / kSteps;
  Point2 best = Point2::Zero();
  double most = -1;
  for (int row = -kSteps; row <= kSteps; ++row)
    for (int col = -kSteps; col <= kSteps; ++col) {
      const Point2 displacement = step * Point2(col, row);
      double sum = 0;
      for (std::size_t i = 0; i < models_.size(); ++i)
        sum += weights_[i] * likelihood(i, segmentation,
                                        parts_.placement().col(static_cast<Eigen::Index>(i)) + displacement);
      sum *= std::exp(-displacement.squaredNorm() / (kSteps * kSteps * step * step));  // nearer is likelier
      if (sum > most) most = sum, best = displacement;
    }
  return most > 0 ? best : Point2::Zero();
}

Evidence Lgt::evidence_near(std::size_t part, const Segmentation& segmentation,
                            const Point2& expected) const {
  const double sigma = options_.springs.reach * pose_.mean_side(), step = sigma / 2;
  double total = 0;
  Point2 mean = Point2::Zero();
  Eigen::Matrix2d moments = Eigen::Matrix2d::Zero();
  Evidence result{.position = expected};
  for (int row = -4; row <= 4; ++row)
    for (int col = -4; col <= 4; ++col) {
      const Point2 offset = step * Point2(col, row);
      const double value = likelihood(part, segmentation, expected + offset);
      const double weight = value * std::exp(-offset.squaredNorm() / (2 * sigma * sigma));
      result.peak = std::max(result.peak, value);
      total += weight, mean += weight * offset, moments += weight * offset * offset.transpose();
    }
  if (!(total > 0)) return {.position = expected, .peak = 0};
  mean /= total;
  result.position = expected + mean;
  result.covariance = moments / total - mean * mean.transpose() + step * step * Eigen::Matrix2d::Identity();
  return result;
}

void Lgt::renew(const Frame& frame, const Segmentation& segmentation, int new_parts) {
  const PlaneTransform to_object = pose_.transform().inverse();
  std::vector<Point2> layout, placement;
  std::vector<AnyPart> models;
  std::vector<double> weights;
  for (int i = 0; i < parts_.size(); ++i) {
    const auto part = static_cast<std::size_t>(i);
    const bool stays =
        weights_[part] >= options_.remove_below && pose_.covers(to_object(parts_.placement().col(i)));
    if (!stays) continue;
    layout.push_back(parts_.layout().col(i)), placement.push_back(parts_.placement().col(i));
    models.push_back(std::move(models_[part])), weights.push_back(weights_[part]);
  }

  // Where the object is least covered, near its middle, and of its color.
  const double side = options_.part_side * pose_.mean_side();
  constexpr int kPlaces = 12;  // on each axis
  for (; new_parts > 0 && std::ssize(layout) < options_.max_parts; --new_parts) {
    double most = 0;
    Point2 best = Point2::Zero();
    for (int place = 0; place < kPlaces * kPlaces; ++place) {
      const int row = place / kPlaces, col = place % kPlaces;
      const Point2 u = 2 * Point2(col + 0.5, row + 0.5) / kPlaces - Point2(1, 1);
      const Point2 in_object = u.cwiseProduct(pose_.first_size()) / 2;
      const Point2 position = pose_.transform()(in_object);
      double free = 4;
      for (const Point2& other : placement) free = std::min(free, (other - position).norm() / side);
      const double score =
          free < 0.5 ? 0 : free * std::exp(-u.squaredNorm()) * color_.probability(segmentation, position);
      if (score > most) most = score, best = in_object;
    }
    if (!(most > 0)) break;
    layout.push_back(best), placement.push_back(pose_.transform()(best));
    models.push_back(options_.part), weights.push_back(kNewWeight);
    models.back().init(frame, placement.back(), Size2::Constant(side));
  }

  Points points(2, std::ssize(layout)), placed(2, std::ssize(layout));
  for (std::size_t i = 0; i < layout.size(); ++i) {
    points.col(static_cast<Eigen::Index>(i)) = layout[i];
    placed.col(static_cast<Eigen::Index>(i)) = placement[i];
  }
  models_ = std::move(models), weights_ = std::move(weights);
  parts_.assign(points, placed, delaunay(points));
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
