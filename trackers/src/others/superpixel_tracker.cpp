#include <algorithm>
#include <asterism/parts/features/patch.hpp>
#include <asterism/trackers/others/superpixel_tracker.hpp>
#include <asterism/trackers/tracker/tracker_options.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "../tracker/require.hpp"
#include "../tracker/stage_clock.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// However thin an object is, its window is no longer than this, and no shorter [template pixels].
constexpr double kMaxSuperpixelWindow = 512, kMinSuperpixelWindow = 12;
// Nor than this many superpixels, of which all are compared with all.
constexpr double kMaxSuperpixels = 64;
// A part that matches worse is not seen.
constexpr double kMatch = 0.3;

}  // namespace

SuperpixelTracker::SuperpixelTracker(const SuperpixelTrackerOptions& options)
    : options_(check_options("SuperpixelTrackerOptions", options)), parts_(options.springs) {}

void SuperpixelTracker::start(const Frame& frame, const cv::Rect2d& box) {
  color_ = frame.has_color();
  pose_ = ObjectPose(box);
  parts_.clear();
  colors_.resize(0, 3), background_.resize(0, 3);
  unseen_.clear();
  spacing_ = pose_.mean_side() / options_.template_side;
  renew(cut(frame));
}

TrackResult SuperpixelTracker::standing() const {
  return parts_.standing(pose_, Size2::Constant(options_.slic.side * spacing_));
}

TrackResult SuperpixelTracker::follow(const Frame& frame) {
  StageClock clock;
  TrackResult result;

  const Candidates seen = cut(frame);
  const Eigen::ArrayXXf likeness = alike(colors_, seen.colors);
  result.times.push_back({"superpixels", clock.lap()});

  // The motion that most parts have in common, then each part's candidates near there.
  const int n = parts_.size();
  parts_.placement().colwise() += common_displacement(seen, likeness);
  const double sigma = options_.slic.side * spacing_;
  std::vector<Evidence> evidence(static_cast<std::size_t>(n));
  Eigen::ArrayX3f matched(n, 3);
  for (int i = 0; i < n; ++i) {
    Evidence& part = evidence[static_cast<std::size_t>(i)];
    const Point2 expected = parts_.placement().col(i);
    double total = 0;
    Point2 mean = Point2::Zero();
    Eigen::Matrix2d moments = Eigen::Matrix2d::Zero();
    Eigen::Array3d color = Eigen::Array3d::Zero();
    for (int c = 0; c < seen.areas.size(); ++c) {
      const Point2 offset = seen.positions.col(c) - expected;
      const double near = std::exp(-offset.squaredNorm() / (2 * sigma * sigma));
      const double match = near * static_cast<double>(likeness(i, c) * std::sqrt(seen.foreground[c]));
      const double weight = match * static_cast<double>(seen.areas[c]);
      total += weight, mean += weight * offset, moments += weight * offset * offset.transpose();
      color += weight * seen.colors.row(c).transpose().cast<double>();
      part.peak = std::max(part.peak, match);
    }
    part.position = expected;
    matched.row(i) = colors_.row(i);
    if (!(total > 1e-6)) {
      part.peak = 0;
      continue;
    }
    mean /= total;
    part.position += mean;
    part.covariance =
        moments / total - mean * mean.transpose() + sigma * sigma / 12 * Eigen::Matrix2d::Identity();
    matched.row(i) = (color / total).transpose().cast<float>();
  }
  result.times.push_back({"matching", clock.lap()});

  parts_.place(pose_, evidence);
  result.times.push_back({"springs", clock.lap()});

  Eigen::VectorXd weights(n);
  for (int i = 0; i < n; ++i) weights[i] = evidence[static_cast<std::size_t>(i)].peak;
  const double reach = options_.springs.reach;
  pose_.move_to(fit_pose(parts_.layout(), parts_.placement(), weights, pose_, reach).transform);
  pose_.keep_in(frame);
  const Points expected = parts_.posed(pose_);
  double confidence = 0;
  for (int i = 0; i < n; ++i) {
    const Evidence& part = evidence[static_cast<std::size_t>(i)];
    const double strain = (parts_.placement().col(i) - expected.col(i)).norm() / (reach * pose_.mean_side());
    const double success = part.peak / (1 + strain * strain);
    const bool works = success > kMatch;
    confidence += success / n;
    int& unseen = unseen_[static_cast<std::size_t>(i)];
    unseen = works ? 0 : unseen + 1;
    if (works)
      colors_.row(i) += static_cast<float>(options_.learning_rate) * (matched.row(i) - colors_.row(i));
    else
      parts_.placement().col(i) = expected.col(i);
    result.parts.push_back({.position = parts_.placement().col(i),
                            .size = Size2::Constant(sigma),
                            .visual_best = part.position,
                            .weight = success,
                            .updated = works});
  }
  result.links = parts_.links();
  result.box = pose_.box();
  result.angle = pose_.angle();
  result.confidence = std::clamp(confidence, 0.0, 1.0);
  result.lost = confidence < options_.lost_below;
  if (!result.lost) renew(seen);
  spacing_ = pose_.mean_side() / options_.template_side;
  result.times.push_back({"part update", clock.lap()});
  return result;
}

SuperpixelTracker::Candidates SuperpixelTracker::cut(const Frame& frame) const {
  const Size2 whole = pose_.size() + Size2::Constant(options_.padding * pose_.mean_side());
  const auto pixels = [&](double side) {
    return static_cast<int>(std::clamp(std::round(side / spacing_), kMinSuperpixelWindow,
                                       std::min(kMaxSuperpixelWindow, kMaxSuperpixels * options_.slic.side)));
  };
  const cv::Size grid(pixels(whole.x()), pixels(whole.y()));
  const Size2 pixel = whole.cwiseQuotient(Size2(grid.width, grid.height));
  cv::Mat patch;
  sample_patch(color_ && !frame.bgr().empty() ? frame.bgr() : frame.gray(), pose_.centre(), whole, grid,
               patch);
  if (patch.channels() == 1) cv::cvtColor(patch, patch, cv::COLOR_GRAY2BGR);
  patch.convertTo(patch, CV_32F, 1.0 / 255);
  cv::cvtColor(patch, patch, cv::COLOR_BGR2Lab);
  const auto colors = Eigen::Map<const Eigen::Array<float, Eigen::Dynamic, 3, Eigen::RowMajor>>(
      patch.ptr<float>(), grid.area(), 3);
  const SuperpixelMap map = slic(colors, grid.width, options_.slic);

  Candidates result{.positions = Points::Zero(2, map.areas.size()),
                    .colors = map.colors,
                    .areas = map.areas,
                    .foreground = {}};
  for (int i = 0; i < grid.area(); ++i)
    result.positions.col(map.labels[static_cast<std::size_t>(i)]) += Point2(i % grid.width, i / grid.width);
  const Point2 middle = Point2(grid.width - 1, grid.height - 1) / 2;
  for (Eigen::Index c = 0; c < result.positions.cols(); ++c)
    result.positions.col(c) =
        pose_.centre() +
        pixel.cwiseProduct(result.positions.col(c) / static_cast<double>(map.areas[c]) - middle);
  result.areas /= static_cast<float>(options_.slic.side * options_.slic.side);

  // The share of the object among what has such a color, each as dense as it is around here.
  result.foreground = Eigen::ArrayXf::Ones(map.areas.size());
  if (colors_.rows() > 0 && background_.rows() > 0) {
    const Eigen::ArrayXf object = alike(colors_, map.colors).colwise().mean().transpose(),
                         around = alike(background_, map.colors).colwise().mean().transpose();
    result.foreground = (object + 1e-3f) / (object + around + 2e-3f);
  }
  return result;
}

Eigen::ArrayXXf SuperpixelTracker::alike(const Eigen::ArrayX3f& a, const Eigen::ArrayX3f& b) const {
  Eigen::ArrayXXf squares = Eigen::ArrayXXf::Zero(a.rows(), b.rows());
  for (int k = 0; k < 3; ++k)
    squares += (a.col(k).replicate(1, b.rows()) - b.col(k).transpose().replicate(a.rows(), 1)).square();
  return (squares / static_cast<float>(-2 * options_.color_sigma * options_.color_sigma)).exp();
}

Point2 SuperpixelTracker::common_displacement(const Candidates& seen, const Eigen::ArrayXXf& likeness) const {
  // Votes in cells of half a superpixel, as far as the window's margin.
  const double cell = options_.slic.side * spacing_ / 2;
  const int reach = static_cast<int>(options_.padding / 2 * pose_.mean_side() / cell) + 1;
  cv::Mat votes = cv::Mat::zeros(2 * reach + 1, 2 * reach + 1, CV_32F);
  for (int i = 0; i < parts_.size(); ++i)
    for (int c = 0; c < seen.areas.size(); ++c) {
      const Point2 d = (seen.positions.col(c) - parts_.placement().col(i)) / cell;
      const int col = static_cast<int>(std::lround(d.x())) + reach,
                row = static_cast<int>(std::lround(d.y())) + reach;
      if (col < 0 || row < 0 || col >= votes.cols || row >= votes.rows) continue;
      votes.at<float>(row, col) += likeness(i, c) * seen.foreground[c] * seen.areas[c];
    }
  cv::GaussianBlur(votes, votes, {}, 1, 1, cv::BORDER_CONSTANT);
  double most = 0;
  Point2 best = Point2::Zero();
  for (int row = 0; row < votes.rows; ++row)
    for (int col = 0; col < votes.cols; ++col) {
      const Point2 d(col - reach, row - reach);
      // Nearer is likelier.
      const double vote =
          static_cast<double>(votes.at<float>(row, col)) * std::exp(-d.squaredNorm() / (reach * reach));
      if (vote > most) most = vote, best = d;
    }
  return cell * best;
}

void SuperpixelTracker::renew(const Candidates& seen) {
  const PlaneTransform to_object = pose_.transform().inverse();
  std::vector<Point2> layout, placement;
  std::vector<Eigen::Array3f> colors, background;
  std::vector<int> unseen;
  for (int i = 0; i < parts_.size(); ++i) {
    const int frames = unseen_[static_cast<std::size_t>(i)];
    if (frames >= options_.forget_after) continue;
    layout.push_back(parts_.layout().col(i)), placement.push_back(parts_.placement().col(i));
    colors.push_back(colors_.row(i).transpose()), unseen.push_back(frames);
  }
  const double spacing = 0.7 * options_.slic.side * spacing_;
  for (int c = 0; c < seen.areas.size(); ++c) {
    const Point2 position = seen.positions.col(c), in_object = to_object(position);
    if (!pose_.covers(in_object)) {
      background.push_back(seen.colors.row(c).transpose());
      continue;
    }
    const auto too_near = [&](const Point2& other) { return (other - position).norm() < spacing; };
    if (seen.foreground[c] < 0.5f || std::any_of(placement.begin(), placement.end(), too_near)) continue;
    layout.push_back(in_object), placement.push_back(position);
    colors.push_back(seen.colors.row(c).transpose()), unseen.push_back(0);
  }

  Points points(2, std::ssize(layout)), placed(2, std::ssize(layout));
  colors_.resize(points.cols(), 3);
  background_.resize(std::ssize(background), 3);
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    const auto part = static_cast<std::size_t>(i);
    points.col(i) = layout[part], placed.col(i) = placement[part];
    colors_.row(i) = colors[part].transpose();
  }
  for (std::size_t c = 0; c < background.size(); ++c)
    background_.row(static_cast<Eigen::Index>(c)) = background[c].transpose();
  unseen_ = unseen;
  parts_.assign(points, placed, Topology<>::k_nearest(points, options_.neighbours));
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
