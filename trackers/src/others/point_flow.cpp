#include <algorithm>
#include <asterism/trackers/others/point_flow.hpp>
#include <asterism/trackers/tracker/tracker_options.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <stdexcept>

#include "../tracker/require.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Deviation of a position that Lucas-Kanade has converged to [window pixels].
constexpr double kConvergence = 0.3;

// Normalised cross-correlation of the patches around two points, 0 where one is flat.
double correlation(const cv::Mat& a, const cv::Point2f& at, const cv::Mat& b, const cv::Point2f& bt,
                   int side) {
  cv::Mat p, q;
  cv::getRectSubPix(a, {side, side}, at, p, CV_32F);
  cv::getRectSubPix(b, {side, side}, bt, q, CV_32F);
  p -= cv::mean(p), q -= cv::mean(q);
  const double product = cv::norm(p) * cv::norm(q);
  return product > 0 ? p.dot(q) / product : 0;
}

}  // namespace

PointFlow::PointFlow(const PointFlowOptions& options) : options_(check_options("PointFlowOptions", options)) {
  require(options.lk_window % 2 == 1, "PointFlowOptions: lk_window must be odd");
  require(options.window.ordered(), "PointFlowOptions: template sides must satisfy min <= max");
}

void PointFlow::learn(const Frame& frame, const Point2& centre, const Size2& size) {
  window_ = window_of(centre, size);
  learned_ = pyramid(window_.sample(frame));
}

void PointFlow::visit_state(StateArchive& archive, const Point2& centre, const Size2& size) {
  if (archive.loading()) window_ = window_of(centre, size);
  cv::Mat window = archive.loading() ? cv::Mat() : learned_[0];
  archive.pixels(window, window_.grid(), 1);
  if (archive.loading()) learned_ = pyramid(window);
}

ObjectWindow PointFlow::window_of(const Point2& centre, const Size2& size) const {
  return {centre, size, options_.window};
}

std::vector<cv::Mat> PointFlow::pyramid(const cv::Mat& window) const {
  std::vector<cv::Mat> levels;
  cv::buildOpticalFlowPyramid(window, levels, {options_.lk_window, options_.lk_window}, options_.lk_levels);
  return levels;
}

std::vector<Evidence> PointFlow::follow(const Frame& frame,
                                        const Eigen::Ref<const Eigen::Matrix2Xd>& points) const {
  const auto count = static_cast<std::size_t>(points.cols());
  std::vector<Evidence> result(count);
  if (count == 0) return result;
  const cv::Size side(options_.lk_window, options_.lk_window);
  const cv::Mat patch = window_.sample(frame);
  const std::vector<cv::Mat> seen = pyramid(patch);

  std::vector<cv::Point2f> from(count), forward, back;
  for (std::size_t i = 0; i < count; ++i)
    from[i] = window_.to_window(points.col(static_cast<Eigen::Index>(i)));
  std::vector<uchar> found, returned;
  cv::calcOpticalFlowPyrLK(learned_, seen, from, forward, found, cv::noArray(), side, options_.lk_levels);
  cv::calcOpticalFlowPyrLK(seen, learned_, forward, back, returned, cv::noArray(), side, options_.lk_levels);

  const cv::Rect2f inside({0, 0}, cv::Size2f(window_.grid()));
  for (std::size_t i = 0; i < count; ++i) {
    result[i].position = points.col(static_cast<Eigen::Index>(i));
    const double error = cv::norm(back[i] - from[i]);
    const bool ok = found[i] && returned[i] && error <= options_.max_error && inside.contains(forward[i]);
    if (!ok) continue;
    const double variance = kConvergence * kConvergence + error * error;
    result[i].position = window_.to_image(forward[i]);
    result[i].covariance = window_.spacing() * window_.spacing() * variance * Eigen::Matrix2d::Identity();
    result[i].peak = std::max(0.0, correlation(learned_[0], from[i], patch, forward[i], options_.lk_window));
  }
  return result;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
