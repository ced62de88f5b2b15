#include <asterism/trackers/dpt/coarse.hpp>
#include <asterism/trackers/tracker/tracker_options.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "../tracker/stage_clock.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

AnyPart paper_filter() { return Kcf(); }

CoarseLayer::CoarseLayer(const CoarseOptions& options)
    : options_(check_options("CoarseOptions", options)), root_(options.root), color_(options.color) {}

void CoarseLayer::init(const Frame& frame, const cv::Rect2d& box) {
  root_.init(frame, centre_of(box), {box.width, box.height});
  pose_ = ObjectPose(box);
  if (options_.use_color) color_.init(frame, box);
}

CoarseLayer::Estimate CoarseLayer::localize(const Frame& frame) {
  Estimate estimate;
  StageClock clock;
  estimate.evidence = root_.localize(frame, pose_.centre());
  estimate.similarity = estimate.evidence.peak;
  estimate.root_milliseconds = clock.lap();
  const ResponseMap* const response = root_.response();
  if (options_.use_color && color_.enabled()) {
    const Segmentation& segmentation = estimate.segmentation =
        color_.segment(frame, search_window(), pose_.size());
    const bool adds = options_.color_share > 0;
    if (response != nullptr && (adds ? !segmentation.posterior.empty() : segmentation.informative)) {
      density_ = *response;
      if (adds)
        add_posterior(segmentation);
      else
        multiply_color(segmentation);
      estimate.evidence = evidence_of(density_, options_.sub_pixel);
      // If the root found no peak, the similarity stays 0.
      if (estimate.similarity > 0) estimate.similarity = root_.similarity_at(estimate.evidence.position);
    }
    estimate.color_milliseconds = clock.lap();
  }
  evidence_ = estimate.evidence;
  estimate.weak = !(estimate.similarity >= options_.lost_below);
  return estimate;
}

void CoarseLayer::report(const Estimate& estimate, TrackResult& result) const {
  result.confidence = std::clamp(estimate.similarity, 0.0, 1.0);
  result.lost = estimate.weak;
  result.weak = estimate.weak;
  result.times.push_back({"root", estimate.root_milliseconds});
  result.times.push_back({"color", estimate.color_milliseconds});
}

void CoarseLayer::multiply_color(const Segmentation& segmentation) {
  // Eq. 4: template probability times color probability.
  for (Eigen::Index row = 0; row < density_.values.rows(); ++row)
    for (Eigen::Index col = 0; col < density_.values.cols(); ++col) {
      const Point2 position = density_.position(static_cast<double>(row), static_cast<double>(col));
      density_.values(row, col) = std::max(0.0f, density_.values(row, col)) *
                                  static_cast<float>(color_.probability(segmentation, position));
    }
}

void CoarseLayer::add_posterior(const Segmentation& segmentation) {
  // Sum of the posterior above and to the left of a point: bilinear between the corners of the cells, as the
  // posterior is constant in each; it is 0 beyond the grid.
  cv::Mat sums;
  cv::integral(segmentation.posterior, sums, CV_64F);
  const int cols = segmentation.posterior.cols, rows = segmentation.posterior.rows;
  const auto sum_to = [&](double x, double y) {
    x = std::clamp(x, 0.0, static_cast<double>(cols));
    y = std::clamp(y, 0.0, static_cast<double>(rows));
    const int col = std::min(static_cast<int>(x), cols - 1), row = std::min(static_cast<int>(y), rows - 1);
    const double *upper = sums.ptr<double>(row) + col, *lower = sums.ptr<double>(row + 1) + col;
    const double fx = x - col, fy = y - row;
    return (1 - fy) * ((1 - fx) * upper[0] + fx * upper[1]) + fy * ((1 - fx) * lower[0] + fx * lower[1]);
  };
  const Size2 half = pose_.size().cwiseQuotient(segmentation.spacing) / 2;  // [cells]
  const auto share = static_cast<float>(options_.color_share);
  for (Eigen::Index row = 0; row < density_.values.rows(); ++row)
    for (Eigen::Index col = 0; col < density_.values.cols(); ++col) {
      const Point2 position = density_.position(static_cast<double>(row), static_cast<double>(col));
      const Point2 middle =
          (position - segmentation.origin).cwiseQuotient(segmentation.spacing) + Point2(0.5, 0.5);
      const Point2 first = middle - half, end = middle + half;
      const double sum = sum_to(end.x(), end.y()) - sum_to(first.x(), end.y()) - sum_to(end.x(), first.y()) +
                         sum_to(first.x(), first.y());
      float& value = density_.values(row, col);
      value = (1 - share) * value + share * static_cast<float>(sum / (4 * half.prod()));
    }
}

cv::Rect2d CoarseLayer::search_window() const {
  if (const ResponseMap* const response = root_.response()) {
    const Size2 cells(static_cast<double>(response->values.cols()),
                      static_cast<double>(response->values.rows()));
    return box_around(pose_.centre(), response->spacing.cwiseProduct(cells));
  }
  return box_around(pose_.centre(), pose_.size() + Size2::Constant(KcfOptions().window.padding *
                                                                   std::sqrt(pose_.size().prod())));
}

void CoarseLayer::move(const ObjectPose& pose) {
  pose_ = pose;
  pose_.settle();
  root_.resize(pose_.size());
}

void CoarseLayer::adapt(const Frame& frame, bool informative) {
  root_.adapt(frame, pose_.centre());
  if (informative) color_.adapt(frame, pose_.box());
}

CoarseTracker::CoarseTracker(const CoarseOptions& options) : layer_(options) {}

void CoarseTracker::start(const Frame& frame, const cv::Rect2d& box) { layer_.init(frame, box); }

TrackResult CoarseTracker::standing() const {
  TrackResult result;
  result.box = layer_.pose().box();
  return result;
}

TrackResult CoarseTracker::follow(const Frame& frame) {
  TrackResult result;
  const CoarseLayer::Estimate estimate = layer_.localize(frame);
  layer_.report(estimate, result);

  StageClock clock;
  ObjectPose pose = layer_.pose();
  pose.move_to(estimate.evidence.position);
  if (const std::optional<Size2> size = layer_.found_size()) pose.resize(*size);
  pose.keep_in(frame);
  layer_.move(pose);
  layer_.adapt(frame, estimate.segmentation.informative);
  result.times.push_back({"update", clock.lap()});
  result.box = layer_.pose().box();
  return result;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
