#include <asterism/parts/models/cv_tracker_part.hpp>
#include <cmath>
#include <stdexcept>

#include "../concept/part_geometry.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {
// Shortest side of a search window [window pixels]; OpenCV's trackers fail on less.
constexpr int kLeastSide = 48;
}  // namespace

CvTrackerPart::CvTrackerPart(Factory create, const CvTrackerPartOptions& options)
    : create_(std::move(create)), options_(check_options("CvTrackerPartOptions", options)) {
  require(static_cast<bool>(create_), "CvTrackerPart: the factory must not be empty");
  require_ordered(options.window, "CvTrackerPartOptions");
}

void CvTrackerPart::init(const Frame& frame, const Point2& centre, const Size2& size) {
  require_target(centre, size);
  const auto [to_window, cols, rows] = window_geometry(size, options_.window, kLeastSide);
  size_ = size, spacing_.setConstant(1 / to_window), cols_ = cols, rows_ = rows;
  response_ = {};
  const Size2 side = (size * to_window).array().round().max(1);
  target_ = {(cols - static_cast<int>(side.x())) / 2, (rows - static_cast<int>(side.y())) / 2,
             static_cast<int>(side.x()), static_cast<int>(side.y())};
  learned_ = sample(frame, centre);
}

Evidence CvTrackerPart::localize(const Frame& frame, const Point2& around) {
  if (learned_.empty()) throw std::logic_error("CvTrackerPart: localize before init");
  const cv::Mat seen = sample(frame, around);
  const cv::Ptr<cv::Tracker> tracker = create_();
  if (tracker == nullptr) throw std::runtime_error("CvTrackerPart: the factory made no tracker");
  tracker->init(learned_, target_);
  cv::Rect found;
  response_.centre = around;
  response_.window = window();
  Evidence& evidence = response_.evidence;
  if (tracker->update(seen, found) && !found.empty()) {
    const Point2 moved = centre_of(found) - centre_of(target_);
    evidence = {
        .position = around + spacing_.cwiseProduct(moved),
        .peak = 1,
        .covariance = std::pow(options_.deviation * mean_side(size_), 2) * Eigen::Matrix2d::Identity()};
  } else {
    evidence = {.position = around, .peak = 0, .covariance = (window().cwiseAbs2() / 12).asDiagonal()};
  }
  return evidence;
}

void CvTrackerPart::adapt(const Frame& frame, const Point2& at) {
  if (learned_.empty()) throw std::logic_error("CvTrackerPart: adapt before init");
  cv::Mat seen = sample(frame, at);  // before the test: also throws if the position is not finite
  if (options_.adaptive) learned_ = seen;
}

void CvTrackerPart::resize(const Size2& size) {
  require_size(size);
  spacing_ = spacing_.cwiseProduct(size).cwiseQuotient(size_);
  size_ = size;
}

cv::Mat CvTrackerPart::sample(const Frame& frame, const Point2& centre) const {
  cv::Mat seen;
  sample_bgr(frame, centre, window(), {cols_, rows_}, seen);
  return seen;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
