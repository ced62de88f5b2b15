#include <asterism/parts/concept/part_options.hpp>
#include <asterism/parts/models/flow.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

#include "../concept/part_geometry.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Shortest side of a search window [template pixels].
constexpr int kMinWindowSide = 16;
// Standard deviation of a displacement to which Lucas-Kanade has converged [template pixels].
constexpr double kConvergence = 0.05;

// Displacement of one point, and how far its backward track ends from where it started [template pixels].
struct Track {
  Point2 displacement, error;
  double squared_error;
};

// Median of one axis; reorders the tracks.
double median(std::vector<Track>& tracks, int axis) {
  const auto middle = tracks.begin() + static_cast<std::ptrdiff_t>(tracks.size() / 2);
  std::nth_element(tracks.begin(), middle, tracks.end(), [&](const Track& a, const Track& b) {
    return a.displacement(axis) < b.displacement(axis);
  });
  if (tracks.size() % 2 == 1) return middle->displacement(axis);
  const auto below = std::max_element(tracks.begin(), middle, [&](const Track& a, const Track& b) {
    return a.displacement(axis) < b.displacement(axis);
  });
  return (below->displacement(axis) + middle->displacement(axis)) / 2;
}

Point2 difference(const cv::Point2f& a, const cv::Point2f& b) {
  return {static_cast<double>(a.x) - static_cast<double>(b.x),
          static_cast<double>(a.y) - static_cast<double>(b.y)};
}

}  // namespace

Flow::Flow(const FlowOptions& options) : options_(check_options("FlowOptions", options)) {
  require(options.lk_window % 2 == 1, "FlowOptions: lk_window must be odd");
  require_ordered(options.window, "FlowOptions");
}

void Flow::init(const Frame& frame, const Point2& centre, const Size2& size) {
  require_target(centre, size);
  prepare(size);
  learned_ = sample(frame, centre);
}

void Flow::prepare(const Size2& size) {
  size_ = size;
  response_ = {};
  const auto [to_template, cols, rows] = window_geometry(size, options_.window, kMinWindowSide);
  spacing_ = 1 / to_template, cols_ = cols, rows_ = rows;

  // The points are the centres of grid x grid cells of the target.
  points_.clear();
  const Point2 middle = Point2(cols_ - 1, rows_ - 1) / 2;
  const Size2 cell = size * to_template / options_.grid;
  for (int r = 0; r < options_.grid; ++r)
    for (int c = 0; c < options_.grid; ++c) {
      const Point2 point =
          middle + cell.cwiseProduct(Point2(c, r) - Point2::Constant(0.5 * (options_.grid - 1)));
      points_.emplace_back(static_cast<float>(point.x()), static_cast<float>(point.y()));
    }
}

void Flow::visit_state(StateArchive& archive) {
  archive.begin("flow", options_);
  if (!archive.loading() && size_.isZero()) throw std::logic_error("Flow: save before init");
  archive.size(size_);
  if (archive.loading()) prepare(Size2(size_));
  cv::Mat window = archive.loading() ? cv::Mat() : learned_[0];
  archive.pixels(window, {cols_, rows_}, 1);
  if (archive.loading()) learned_ = pyramid(window);
}

Evidence Flow::localize(const Frame& frame, const Point2& around) {
  const Pyramid seen = sample(frame, around);
  std::vector<cv::Point2f> forward, back;
  std::vector<uchar> found, returned;
  const cv::Size side(options_.lk_window, options_.lk_window);
  cv::calcOpticalFlowPyrLK(learned_, seen, points_, forward, found, cv::noArray(), side, options_.lk_levels);
  cv::calcOpticalFlowPyrLK(seen, learned_, forward, back, returned, cv::noArray(), side, options_.lk_levels);

  std::vector<Track> tracks;
  for (std::size_t i = 0; i < points_.size(); ++i) {
    const Point2 error = difference(back[i], points_[i]);
    if (found[i] && returned[i] && error.norm() <= options_.max_error)
      tracks.push_back({difference(forward[i], points_[i]), error, error.squaredNorm()});
  }

  response_.centre = around;
  response_.window = window();
  Evidence& evidence = response_.evidence;
  evidence.peak = static_cast<double>(tracks.size()) / static_cast<double>(points_.size());
  if (tracks.empty()) {
    evidence.position = around;
    evidence.covariance = (window().cwiseAbs2() / 12).asDiagonal();
    return evidence;
  }

  // Keep the better half.
  std::sort(tracks.begin(), tracks.end(),
            [](const Track& a, const Track& b) { return a.squared_error < b.squared_error; });
  tracks.resize((tracks.size() + 1) / 2);
  const Point2 displacement(median(tracks, 0), median(tracks, 1));
  Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
  for (const Track& track : tracks) {
    const Point2 deviation = track.displacement - displacement;
    scatter += deviation * deviation.transpose() + track.error * track.error.transpose();
  }
  scatter /= static_cast<double>(tracks.size());
  scatter.diagonal().array() += kConvergence * kConvergence;
  evidence.position = around + spacing_ * displacement;
  evidence.covariance = spacing_ * spacing_ * scatter;
  return evidence;
}

void Flow::adapt(const Frame& frame, const Point2& at) { learned_ = sample(frame, at); }

Flow::Pyramid Flow::sample(const Frame& frame, const Point2& centre) {
  sample_patch(frame.gray(), centre, window(), {cols_, rows_}, patch_.mat);
  return pyramid(patch_.mat);
}

Flow::Pyramid Flow::pyramid(const cv::Mat& window) const {
  Pyramid levels;
  cv::buildOpticalFlowPyramid(window, levels, {options_.lk_window, options_.lk_window}, options_.lk_levels);
  return levels;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
