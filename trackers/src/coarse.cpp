#include <asterism/trackers/coarse.hpp>
#include <cmath>
#include <stdexcept>

#include "stage_clock.hpp"

namespace asterism::inline ASTERISM_ABI {

void check_start(const Frame& frame, const cv::Rect2d& box) {
  if (!(std::isfinite(box.x) && std::isfinite(box.y) && std::isfinite(box.width) &&
        std::isfinite(box.height)))
    throw std::invalid_argument("the start box is not finite");
  if (!(box.width >= 1 && box.height >= 1))
    throw std::invalid_argument("the start box must be at least one pixel wide and high");
  if (!(box.x < frame.size().width && box.y < frame.size().height && box.x + box.width > 0 &&
        box.y + box.height > 0))
    throw std::invalid_argument("the start box lies outside the image");
}

AnyPart paper_filter() { return Kcf(); }

CoarseLayer::CoarseLayer(const CoarseOptions& options)
    : options_(options), root_(options.root), colour_(options.colour) {}

void CoarseLayer::init(const Frame& frame, const cv::Rect2d& box) {
  root_.init(frame, centre_of(box), {box.width, box.height});
  centre_ = centre_of(box);
  size_ = {box.width, box.height};
  if (options_.use_colour) colour_.init(frame, box);
}

CoarseLayer::Estimate CoarseLayer::localize(const Frame& frame) {
  Estimate estimate;
  StageClock clock;
  estimate.evidence = root_.localize(frame, centre_);
  estimate.similarity = estimate.evidence.peak;
  estimate.root_milliseconds = clock.lap();
  evidence_ = estimate.evidence;
  if (!options_.use_colour || !colour_.enabled()) return estimate;

  const ResponseMap* const response = root_.response();
  estimate.segmentation = colour_.segment(frame, search_window(), size_);
  if (response != nullptr && estimate.segmentation.informative) {
    // Eq. position_posterior_root: template probability times colour probability.
    density_ = *response;
    for (Eigen::Index row = 0; row < density_.values.rows(); ++row)
      for (Eigen::Index col = 0; col < density_.values.cols(); ++col) {
        const Point2 position = density_.position(static_cast<double>(row), static_cast<double>(col));
        density_.values(row, col) = std::max(0.0f, density_.values(row, col)) *
                                    static_cast<float>(colour_.probability(estimate.segmentation, position));
      }
    estimate.evidence = evidence_ = evidence_of(density_, options_.sub_pixel);
    estimate.similarity = root_.similarity_at(estimate.evidence.position);
  }
  estimate.colour_milliseconds = clock.lap();
  return estimate;
}

cv::Rect2d CoarseLayer::search_window() const {
  if (const ResponseMap* const response = root_.response()) {
    const Size2 cells(static_cast<double>(response->values.cols()),
                      static_cast<double>(response->values.rows()));
    return box_around(centre_, response->spacing.cwiseProduct(cells));
  }
  return box_around(centre_, size_ + Size2::Constant(KcfOptions().padding * std::sqrt(size_.prod())));
}

void CoarseLayer::move(const cv::Rect2d& box) {
  centre_ = centre_of(box);
  size_ = {box.width, box.height};
  root_.resize(size_);
}

void CoarseLayer::adapt(const Frame& frame, bool informative) {
  root_.adapt(frame, centre_);
  if (informative) colour_.adapt(frame, box());
}

CoarseTracker::CoarseTracker(const CoarseOptions& options) : layer_(options) {}

void CoarseTracker::init(const cv::Mat& image, const cv::Rect2d& box) {
  const Frame frame(image);
  check_start(frame, box);
  layer_.init(frame, box);
  initialized_ = true;
}

TrackResult CoarseTracker::update(const cv::Mat& image) {
  if (!initialized_) throw std::logic_error("CoarseTracker: update before init");
  StageClock clock;
  const Frame frame(image);
  TrackResult result;
  result.times.push_back({"frame", clock.lap()});

  const CoarseLayer::Estimate estimate = layer_.localize(frame);
  result.times.push_back({"root", estimate.root_milliseconds});
  result.times.push_back({"colour", estimate.colour_milliseconds});
  clock.lap();

  layer_.move(box_around(estimate.evidence.position, layer_.size()));
  layer_.adapt(frame, estimate.segmentation.informative);
  result.times.push_back({"update", clock.lap()});

  result.box = layer_.box();
  result.confidence = std::clamp(estimate.similarity, 0.0, 1.0);
  result.lost = result.confidence < layer_.options().lost_below;
  return result;
}

}  // namespace asterism::inline ASTERISM_ABI
