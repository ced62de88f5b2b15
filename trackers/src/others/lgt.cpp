#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <asterism/parts/models/color_histogram.hpp>
#include <asterism/solver/base/split_mix.hpp>
#include <asterism/trackers/others/lgt.hpp>
#include <asterism/trackers/tracker/tracker_options.hpp>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <span>
#include <utility>

#include "../tracker/median.hpp"
#include "../tracker/stage_clock.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// The unit of the lengths below: the mean side (arithmetic) of the object's first box is this many units.
constexpr double kObjectSide = 60;
constexpr int kPartSide = 6;
// Search range of a part to each side: covers the common motion and the local one.
constexpr double kReach = 24;
// Spacing of the first parts.
constexpr double kSpacing = 10;
constexpr double kNewWeight = 0.5;
// Parts with at least this weight define the shape in the global layer.
constexpr double kDefinite = 0.5;

// The cross-entropy method: initial number of samples, how many are added at a time, at most; how many of the
// best the next distribution is fitted to; number of iterations.
constexpr int kFirstSamples = 50, kMoreSamples = 10, kMostSamples = 300, kElite = 10, kIterations = 10;
// Standard deviation of a part's own motion: LGT has the variance 10.
constexpr double kLocalDeviation = 3.162;

// A part's weight: rate of decay with dissimilarity, and with its median distance from the others beyond
// kMostDistance.
constexpr double kSimilarityDecay = 3, kDistanceDecay = 3, kMostDistance = 40;
constexpr double kMergeDistance = 3;
// Number of parts that always stay, and the most that are removed in one frame.
constexpr int kFewest = 3;

// The map of probabilities: its side, the fraction of its maximum below which no part is added, and the
// variance of the Gaussian that damps it around a part.
constexpr double kMapSide = 150, kLikely = 0.2, kDampingVariance = 20;
constexpr double kCapacityRate = 0.2, kShapeRate = 0.3;
// The shape: width of the margin around the parts' convex hull, and the probability in it.
constexpr double kHullMargin = 15;
constexpr float kMarginProbability = 0.7F;
// Probabilities of a cue that differ by at most this fraction everywhere carry no information.
constexpr float kSameProbability = 1e-3F;

// Approximately normal numbers, the same with every compiler: sums of twelve uniform numbers.
class Normal {
 public:
  explicit Normal(int seed) : random_(static_cast<std::uint64_t>(seed) << 32) {}
  double operator()() {
    double sum = -6;
    for (int i = 0; i < 12; ++i) sum += random_.uniform();
    return sum;
  }

 private:
  detail::SplitMix64 random_;
};

// Whether the probabilities of a cue differ anywhere in the image. Cells outside it have no evidence.
bool informs(const Segmentation& cue, const Frame& frame) {
  float lowest = 1, highest = 0;
  for (int row = 0; row < cue.posterior.rows; ++row)
    for (int col = 0; col < cue.posterior.cols; ++col) {
      const Point2 position = cue.origin + cue.spacing.cwiseProduct(Size2(col, row));
      if (position != kept_in_image(frame, position)) continue;
      const float probability = cue.posterior.at<float>(row, col);
      lowest = std::min(lowest, probability), highest = std::max(highest, probability);
    }
  return highest - lowest > kSameProbability * highest;
}

}  // namespace

AnyPart histogram_part() {
  return ColorHistogram({.space = ColorHistogramOptions::Space::Gray,
                         .window = {.padding = 2 * kReach / kPartSide,
                                    .min_template_side = kPartSide,
                                    .max_template_side = kPartSide}});
}

Lgt::Lgt(const LgtOptions& options)
    : options_(check_options("LgtOptions", options)),
      constellation_(options.springs),
      color_(options.color),
      motion_(options.motion) {
  options_.use_motion = options.use_motion && MotionModel::available();
}

double Lgt::unit() const { return pose_.first_size().mean() / kObjectSide; }

Size2 Lgt::part_size() const { return Size2::Constant(kPartSide * unit()); }

Point2 Lgt::cell(int row, int col) const {
  constexpr double kMiddle = (kShapeCells - 1) / 2.0;
  return pose_.centre() + kMapSide / kShapeCells * unit() * Point2(col - kMiddle, row - kMiddle);
}

Eigen::VectorXd Lgt::weights() const {
  Eigen::VectorXd result(std::ssize(parts_));
  for (Eigen::Index i = 0; i < result.size(); ++i) result[i] = parts_[static_cast<std::size_t>(i)].weight;
  return result;
}

std::vector<Point2> Lgt::placement() const {
  std::vector<Point2> result;
  for (const auto& position : constellation_.placement().colwise()) result.emplace_back(position);
  return result;
}

void Lgt::assign(const std::vector<Point2>& placement) {
  Points placed(2, std::ssize(placement)), layout(2, std::ssize(placement));
  const PlaneTransform to_object = pose_.transform().inverse();
  for (Eigen::Index i = 0; i < placed.cols(); ++i) {
    placed.col(i) = placement[static_cast<std::size_t>(i)];
    layout.col(i) = to_object(placed.col(i));
  }
  constellation_.assign(layout, placed, delaunay(layout));
}

void Lgt::start(const Frame& frame, const cv::Rect2d& box) {
  pose_ = ObjectPose(box);
  const double variance = unit() * unit();
  filter_.start({pose_.centre().x(), pose_.centre().y(), 0},
                Eigen::Vector3d(variance, variance, 0).asDiagonal(), {unit(), unit(), 0});
  color_.init(frame, box);
  if (options_.use_motion) motion_.init(frame, box);

  // Place the parts on a grid.
  parts_.clear();
  std::vector<Point2> placement;
  const double spacing = unit() * std::max(kSpacing, kObjectSide / std::sqrt(options_.max_parts));
  const Eigen::Array2i cells = (pose_.size() / spacing).array().round().max(1).min(100).cast<int>();
  for (int row = 0; row < cells.y(); ++row)
    for (int col = 0; col < cells.x() && std::ssize(parts_) < options_.max_parts; ++col)
      add(frame, placement,
          pose_.centre() + pose_.size().cwiseProduct(Point2((col + 0.5) / cells.x() - 0.5,  //
                                                            (row + 0.5) / cells.y() - 0.5)));
  assign(placement);
  capacity_ = static_cast<double>(std::ssize(parts_));
  first_spread_ = spread();
  shape_.setZero();
  learn_shape(placement);
  box_ = box;
  frames_ = 0;
}

Size2 Lgt::spread() const {
  const Points& x = constellation_.placement();
  const Eigen::VectorXd w = weights() / std::max(weights().sum(), 1e-12);
  const Eigen::Array2d variance = (x.colwise() - x * w).array().square().matrix() * w;
  return (variance + unit() * unit() * kPartSide * kPartSide / 12).sqrt();
}

cv::Rect2d Lgt::box_of_parts(const Frame& frame) const {
  const Points& x = constellation_.placement();
  Point2 low = x.rowwise().minCoeff() - part_size() / 2, high = x.rowwise().maxCoeff() + part_size() / 2;
  if (options_.box == PartsBox::Spread) {
    const Point2 middle = x * weights() / std::max(weights().sum(), 1e-12);
    const Size2 half = pose_.first_size().cwiseProduct(spread().cwiseQuotient(first_spread_)) / 2;
    low = middle - half, high = middle + half;
  }
  const Size2 size = (high - low).cwiseMax(ObjectPose::kMinScale * pose_.first_size());
  return box_around(kept_in_image(frame, (low + high) / 2),
                    size.cwiseMin(ObjectPose::kMaxScale * pose_.first_size()));
}

TrackResult Lgt::standing() const {
  TrackResult result = constellation_.standing(pose_, part_size());
  result.box = box_;
  return result;
}

TrackResult Lgt::follow(const Frame& frame) {
  StageClock clock;
  TrackResult result;
  Points& placement = constellation_.placement();
  const double unit_variance = unit() * unit();
  const Eigen::Vector3d density(unit_variance, unit_variance, 0);

  // The Kalman filter's prediction for nearly constant velocity.
  filter_.predict(density);
  const Point2 velocity = filter_.velocity().head<2>();
  placement.colwise() += velocity;
  pose_.move_to(Point2(pose_.centre() + velocity));
  for (std::size_t i = 0; i < parts_.size(); ++i)
    parts_[i].model.localize(frame, placement.col(static_cast<Eigen::Index>(i)));
  result.times.push_back({"parts", clock.lap()});

  // The local layer: the motion that the parts have in common ...
  const PlaneTransform step = common_motion();
  frames_ = (frames_ + 1) % kMostFrames;
  for (auto position : placement.colwise()) position = step(position);
  pose_.move_by(step, step.scale);
  result.times.push_back({"motion", clock.lap()});

  // ... and the motion of each part by itself, coupled by springs, which replace LGT's second stage.
  std::vector<Evidence> evidence;
  for (std::size_t i = 0; i < parts_.size(); ++i)
    evidence.push_back(evidence_near(parts_[i], placement.col(static_cast<Eigen::Index>(i))));
  constellation_.place(pose_, evidence);
  const Eigen::VectorXd old_weights = weights();
  pose_.move_to(
      fit_pose(constellation_.layout(), placement, old_weights, pose_, options_.springs.reach).transform);
  result.times.push_back({"springs", clock.lap()});

  // The filter is updated with the parts' centre; it and the parts are kept in the image.
  const Point2 middle = placement * old_weights / std::max(old_weights.sum(), 1e-12);
  const Point2 kept = kept_in_image(frame, middle);
  placement.colwise() += kept - middle;
  filter_.update({kept.x(), kept.y(), 0}, unit_variance * Eigen::Matrix3d::Identity());
  pose_.move_to(Point2(filter_.position().head<2>()));
  pose_.keep_in(frame);

  // The similarity of each part at its position.
  double similarity = 0;
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    const Point2 position = placement.col(static_cast<Eigen::Index>(i));
    const double here = parts_[i].model.similarity_at(position);
    similarity += here / static_cast<double>(std::ssize(parts_));
    result.parts.push_back({.position = position,
                            .size = part_size(),
                            .visual_best = evidence[i].position,
                            .weight = here,
                            .updated = false});
  }
  result.links = constellation_.links();
  result.confidence = std::clamp(similarity, 0.0, 1.0);
  result.lost = similarity < options_.lost_below;
  result.angle = pose_.angle();

  const Segmentation moving = options_.use_motion ? motion_.segment(frame) : Segmentation();
  if (!result.lost) renew(frame, moving);
  result.box = box_ = box_of_parts(frame);
  if (options_.use_color && !result.lost) color_.adapt(frame, box_);
  if (options_.use_motion) motion_.adapt(frame, box_);
  result.times.push_back({"part update", clock.lap()});
  return result;
}

void Lgt::renew(const Frame& frame, const Segmentation& moving) {
  // Merge coincident parts and remove those of low weight.
  reweight(frame);
  std::vector<Point2> positions = placement();
  merge(frame, positions);
  remove(positions);

  // Add parts where the global layer finds the object.
  learn_shape(positions);
  const cv::Rect2d region = box_around(pose_.centre(), Size2::Constant(kMapSide * unit()));
  const Segmentation color =
      options_.use_color ? color_.segment(frame, region, pose_.size()) : Segmentation();
  add_likely(frame, positions, probability(frame, color, moving));
  capacity_ += kCapacityRate * (static_cast<double>(std::ssize(parts_)) - capacity_);
  assign(positions);
}

PlaneTransform Lgt::common_motion() const {
  using Parameters = Eigen::Array4d;  // translation, rotation, logarithm of the scale
  struct Sample {
    Parameters parameters;
    double similarity;
  };
  const Points& placement = constellation_.placement();
  const Points offsets = placement.colwise() - pose_.centre();
  // Transforms about the object's centre.
  const auto moved = [&](const Parameters& p) -> Points {
    const Eigen::Matrix2d turn = std::exp(p[3]) * Eigen::Rotation2Dd(p[2]).toRotationMatrix();
    return (turn * offsets).colwise() + (pose_.centre() + p.head<2>().matrix());
  };
  Normal normal(frames_);  // different in each frame, so that sampling errors do not add up
  Parameters mean = Parameters::Zero();
  Parameters deviation(options_.translation * unit(), options_.translation * unit(), options_.rotation,
                       options_.scale);
  // In pairs on opposite sides of the mean, so that the samples do not bias it.
  const auto draw = [&](std::vector<Sample>& samples, int count) {
    for (int sample = 0; sample < count; sample += 2) {
      Parameters offset;
      for (double& value : offset) value = normal();
      offset *= deviation;
      for (const double side : {1.0, -1.0}) {
        const Parameters parameters = mean + side * offset;
        const Points positions = moved(parameters);
        double similarity = 0;
        for (std::size_t i = 0; i < parts_.size(); ++i)
          similarity +=
              parts_[i].weight * parts_[i].model.similarity_at(positions.col(static_cast<Eigen::Index>(i)));
        samples.push_back({parameters, similarity});
      }
    }
  };

  double worst_elite = 0, best = 0;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    std::vector<Sample> samples;
    draw(samples, kFirstSamples);
    const auto sort = [&] {
      std::stable_sort(samples.begin(), samples.end(),
                       [](const Sample& a, const Sample& b) { return a.similarity > b.similarity; });
    };
    sort();
    // Draw more samples while these are no better than those of the last iteration.
    while (samples[kElite - 1].similarity <= worst_elite && samples[0].similarity <= best &&
           std::ssize(samples) < kMostSamples) {
      draw(samples, kMoreSamples);
      sort();
    }
    worst_elite = samples[kElite - 1].similarity, best = samples[0].similarity;
    if (!(worst_elite > 0)) return {};  // no part is found anywhere
    const std::span<const Sample> elite(samples.data(), kElite);
    double total = 0;
    mean.setZero();
    for (const Sample& sample : elite)
      total += sample.similarity, mean += sample.similarity * sample.parameters;
    mean /= total;
    deviation.setZero();
    for (const Sample& sample : elite)
      deviation += sample.similarity / total * (sample.parameters - mean).square();
    deviation = deviation.sqrt();
  }
  PlaneTransform result{std::exp(mean[3]), mean[2], Point2::Zero()};
  result.translation = pose_.centre() + mean.head<2>().matrix() - result(pose_.centre());
  return result;
}

Evidence Lgt::evidence_near(const Part& part, const Point2& expected) const {
  const double sigma = kLocalDeviation * unit(), step = sigma / 2;
  double total = 0, best = 0;
  Point2 mean = Point2::Zero();
  Eigen::Matrix2d moments = Eigen::Matrix2d::Zero();
  for (int row = -4; row <= 4; ++row)
    for (int col = -4; col <= 4; ++col) {
      const Point2 offset = step * Point2(col, row);
      const double similarity = part.model.similarity_at(expected + offset);
      const double weight = std::exp(options_.sharpness * std::min(0.0, similarity - 1) -
                                     offset.squaredNorm() / (2 * sigma * sigma));
      best = std::max(best, similarity);
      total += weight, mean += weight * offset, moments += weight * offset * offset.transpose();
    }
  mean /= total;
  return {
      .position = expected + mean,
      .peak = part.weight * best,
      .covariance = moments / total - mean * mean.transpose() + step * step * Eigen::Matrix2d::Identity()};
}

void Lgt::reweight(const Frame& frame) {
  const Points& placement = constellation_.placement();
  std::vector<double> distances(parts_.size());
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    const Point2 position = placement.col(static_cast<Eigen::Index>(i));
    for (std::size_t j = 0; j < parts_.size(); ++j)
      distances[j] = (placement.col(static_cast<Eigen::Index>(j)) - position).norm();
    const bool seen = position == kept_in_image(frame, position);
    const double similarity = seen ? parts_[i].model.similarity_at(position) : 0;
    const double success =
        std::exp(kSimilarityDecay * (similarity - 1)) /
        (1 +
         std::exp(std::min(500.0, kDistanceDecay * (detail::median(distances) / unit() - kMostDistance))));
    parts_[i].weight += options_.weight_rate * (success - parts_[i].weight);
  }
}

void Lgt::add(const Frame& frame, std::vector<Point2>& placement, const Point2& position) {
  placement.push_back(position);
  parts_.push_back({options_.part, kNewWeight});
  parts_.back().model.init(frame, position, part_size());
}

void Lgt::merge(const Frame& frame, std::vector<Point2>& placement) {
  for (std::size_t i = 0; i < parts_.size(); ++i)
    for (std::size_t j = i + 1; j < parts_.size();) {
      if ((placement[i] - placement[j]).norm() >= kMergeDistance * unit()) {
        ++j;
        continue;
      }
      // The two are replaced by one between them, which learns the image there.
      const double total = std::max(parts_[i].weight + parts_[j].weight, 1e-12);
      placement[i] += parts_[j].weight / total * (placement[j] - placement[i]);
      parts_[i].weight = std::max(parts_[i].weight, parts_[j].weight);
      parts_[i].model = options_.part;
      parts_[i].model.init(frame, placement[i], part_size());
      parts_.erase(parts_.begin() + static_cast<std::ptrdiff_t>(j));
      placement.erase(placement.begin() + static_cast<std::ptrdiff_t>(j));
      j = i + 1;
    }
}

void Lgt::remove(std::vector<Point2>& placement) {
  for (int removed = 0; removed < kFewest && std::ssize(parts_) > kFewest; ++removed) {
    const auto worst = std::min_element(parts_.begin(), parts_.end(),
                                        [](const Part& a, const Part& b) { return a.weight < b.weight; });
    if (worst->weight >= options_.remove_below) break;
    placement.erase(placement.begin() + (worst - parts_.begin()));
    parts_.erase(worst);
  }
}

void Lgt::learn_shape(const std::vector<Point2>& placement) {
  std::vector<cv::Point2f> definite, hull;
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    const Point2 x = (placement[i] - pose_.centre()) / unit();
    if (parts_[i].weight >= kDefinite)
      definite.emplace_back(static_cast<float>(x.x()), static_cast<float>(x.y()));
  }
  if (definite.empty()) return;
  cv::convexHull(definite, hull);
  if (hull.size() < 3) return;
  const cv::Point2f middle =
      std::accumulate(hull.begin(), hull.end(), cv::Point2f()) / static_cast<float>(hull.size());
  std::vector<cv::Point2f> wider = hull;
  for (cv::Point2f& x : wider)
    x += static_cast<float>(kHullMargin / std::max(cv::norm(x - middle), 1e-3)) * (x - middle);
  for (int row = 0; row < kShapeCells; ++row)
    for (int col = 0; col < kShapeCells; ++col) {
      const Point2 x = (cell(row, col) - pose_.centre()) / unit();
      const cv::Point2f point(static_cast<float>(x.x()), static_cast<float>(x.y()));
      const double inside = cv::pointPolygonTest(hull, point, false) >= 0    ? 1
                            : cv::pointPolygonTest(wider, point, false) >= 0 ? kMarginProbability
                                                                             : 0;
      shape_(row, col) += static_cast<float>(kShapeRate * (inside - shape_(row, col)));
    }
  if (shape_.maxCoeff() > 0) shape_ /= shape_.maxCoeff();
}

Lgt::Map Lgt::probability(const Frame& frame, const Segmentation& color, const Segmentation& moving) const {
  Map cues = Map::Ones();
  for (int row = 0; row < kShapeCells; ++row)
    for (int col = 0; col < kShapeCells; ++col) {
      const Point2 x = cell(row, col);
      if (!color.posterior.empty()) cues(row, col) *= static_cast<float>(color.at(x));
      if (!moving.posterior.empty()) cues(row, col) *= static_cast<float>(moving.at(x));
    }
  if (!options_.use_shape) return cues / std::max(cues.maxCoeff(), 1e-12F);
  // Where neither color nor motion tells the object from its surroundings, nothing says that the object goes
  // on in the margin of its shape: parts that joined there would widen the shape in every frame.
  const Map shape = informs(color, frame) || informs(moving, frame)
                        ? shape_
                        : Map((shape_ > (1 + kMarginProbability) / 2).select(shape_, 0.0F));
  const Map result = cues * shape;
  return result / std::max(result.maxCoeff(), 1e-12F);
}

void Lgt::add_likely(const Frame& frame, std::vector<Point2>& placement, Map probability) {
  constexpr double kFar = 10 * kDampingVariance;  // where e^-5 of the damping is left
  const auto damp = [&](const Point2& part) {
    for (int row = 0; row < kShapeCells; ++row)
      for (int col = 0; col < kShapeCells; ++col) {
        const double distance = (cell(row, col) - part).squaredNorm() / (unit() * unit());
        if (distance < kFar)
          probability(row, col) *= static_cast<float>(-std::expm1(-distance / (2 * kDampingVariance)));
      }
  };
  for (int row = 0; row < kShapeCells; ++row)
    for (int col = 0; col < kShapeCells; ++col)
      if (cell(row, col) != kept_in_image(frame, cell(row, col))) probability(row, col) = 0;
  for (const Point2& part : placement) damp(part);
  auto places =
      std::min(std::lround(capacity_) + 1, static_cast<long>(options_.max_parts)) - std::ssize(parts_);
  for (; places > 0; --places) {
    // LGT draws places from the map; taking the most likely one makes every run the same.
    Eigen::Index row = 0, col = 0;
    if (probability.maxCoeff(&row, &col) < kLikely) break;
    add(frame, placement, cell(static_cast<int>(row), static_cast<int>(col)));
    damp(placement.back());
  }
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
