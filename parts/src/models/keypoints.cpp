#include <algorithm>
#include <asterism/parts/concept/part_options.hpp>
#include <asterism/parts/models/keypoints.hpp>
#include <opencv2/features2d.hpp>

#include "../concept/part_geometry.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Shortest side of a search window [template pixels]: that of a descriptor.
constexpr int kDescriptorSide = 32;
// A peak of 1 needs at least this many votes: with fewer key-points no match is certain.
constexpr std::size_t kFewest = 5;
// A vote with which no other agrees is probably that of a key-point that is not seen.
constexpr std::size_t kFewestVotes = 2;
// Bits of an ORB descriptor.
constexpr int kDescriptorBits = 256;

}  // namespace

Keypoints::Keypoints(const KeypointsOptions& options) : options_(check_options("KeypointsOptions", options)) {
  require_ordered(options.window, "KeypointsOptions");
}

void Keypoints::init(const Frame& frame, const Point2& centre, const Size2& size) {
  require_target(centre, size);
  prepare(size);
  const Detection all = detect(frame, centre);
  const double to_template = template_scale(size, options_.window);
  const Size2 half = size * to_template / 2;
  offsets_.clear();
  descriptors_ = cv::Mat();
  for (std::size_t i = 0; i < all.offsets.size(); ++i) {
    if ((all.offsets[i].cwiseAbs().array() > half.array()).any()) continue;
    offsets_.push_back(all.offsets[i]);
    descriptors_.push_back(all.descriptors.row(static_cast<int>(i)));
  }
}

void Keypoints::prepare(const Size2& size) {
  size_ = size;
  response_ = {};
  const auto [to_template, cols, rows] = window_geometry(size, options_.window, kDescriptorSide);
  spacing_ = 1 / to_template, cols_ = cols, rows_ = rows;
}

void Keypoints::visit_state(StateArchive& archive) {
  archive.begin("keypoints", options_);
  if (!archive.loading() && size_.isZero()) throw std::logic_error("Keypoints: save before init");
  archive.size(size_);
  if (archive.loading()) prepare(Size2(size_));
  int count = size();
  archive.count(count, sizeof(Point2));
  offsets_.resize(static_cast<std::size_t>(count));
  for (Point2& offset : offsets_) archive.position(offset);
  if (archive.loading()) descriptors_ = cv::Mat();
  if (count > 0) archive.pixels(descriptors_, {kDescriptorBits / 8, count}, 1);
}

Evidence Keypoints::localize(const Frame& frame, const Point2& around) {
  const Detection seen = detect(frame, around);
  std::vector<std::vector<cv::DMatch>> matches;
  if (!offsets_.empty() && !seen.offsets.empty())
    cv::BFMatcher(cv::NORM_HAMMING).knnMatch(descriptors_, seen.descriptors, matches, 2);

  // The learned key-point that each seen one is most like. Others that are matched to it are not seen.
  std::vector<const cv::DMatch*> owners(seen.offsets.size());
  for (const std::vector<cv::DMatch>& match : matches) {
    const cv::DMatch& best = match[0];
    if (best.distance > options_.max_distance * kDescriptorBits) continue;
    if (match.size() > 1 && best.distance >= options_.max_ratio * match[1].distance) continue;
    const cv::DMatch*& owner = owners[static_cast<std::size_t>(best.trainIdx)];
    if (owner == nullptr || best.distance < owner->distance) owner = &best;
  }
  std::vector<Point2> votes;  // for the target's displacement [template pixels]
  for (const cv::DMatch* owner : owners)
    if (owner != nullptr)
      votes.push_back(seen.offsets[static_cast<std::size_t>(owner->trainIdx)] -
                      offsets_[static_cast<std::size_t>(owner->queryIdx)]);

  // The vote with which most others agree; the first if several tie.
  std::vector<Point2> agreed;
  for (const Point2& vote : votes) {
    std::vector<Point2> group;
    for (const Point2& other : votes)
      if ((other - vote).norm() <= options_.vote_radius) group.push_back(other);
    if (group.size() > agreed.size()) agreed = std::move(group);
  }

  response_.centre = around;
  response_.window = window();
  Evidence& evidence = response_.evidence;
  evidence.peak =
      static_cast<double>(agreed.size()) / static_cast<double>(std::max(kFewest, offsets_.size()));
  if (agreed.size() < kFewestVotes) {
    evidence.peak = 0;
    evidence.position = around;
    evidence.covariance = (window().cwiseAbs2() / 12).asDiagonal();
    return evidence;
  }
  const auto n = static_cast<double>(agreed.size());
  Point2 mean = Point2::Zero();
  for (const Point2& vote : agreed) mean += vote / n;
  Eigen::Matrix2d scatter = options_.vote_radius * options_.vote_radius / n * Eigen::Matrix2d::Identity();
  for (const Point2& vote : agreed) scatter += (vote - mean) * (vote - mean).transpose() / n;
  evidence.position = around + spacing_ * mean;
  evidence.covariance = spacing_ * spacing_ * scatter;
  return evidence;
}

void Keypoints::adapt(const Frame& frame, const Point2& at) {
  const Detection seen = detect(frame, at);
  cv::Mat fresh = descriptors_.clone();
  std::vector<double> best(offsets_.size(), options_.max_distance * kDescriptorBits);
  for (std::size_t j = 0; j < seen.offsets.size(); ++j) {
    // The learned one whose place is nearest: another one that is not seen must not take its descriptor.
    const auto distance_to = [&](const Point2& offset) { return (seen.offsets[j] - offset).norm(); };
    const auto nearest = std::ranges::min_element(offsets_, {}, distance_to);
    if (nearest == offsets_.end() || distance_to(*nearest) > options_.vote_radius) continue;
    const int row = static_cast<int>(nearest - offsets_.begin());
    const cv::Mat descriptor = seen.descriptors.row(static_cast<int>(j));
    const double distance = cv::norm(descriptors_.row(row), descriptor, cv::NORM_HAMMING);
    double& least = best[static_cast<std::size_t>(row)];
    if (distance > least) continue;
    least = distance;
    descriptor.copyTo(fresh.row(row));
  }
  descriptors_ = fresh;
}

Keypoints::Detection Keypoints::detect(const Frame& frame, const Point2& centre) {
  sample_patch(frame.gray(), centre, window(), {cols_, rows_}, patch_.mat);
  // One scale, with key-points up to the window's border, where ORB extrapolates the image itself.
  const auto orb = cv::ORB::create(options_.max_points, 1.2f, 1, 0, 0, 2, cv::ORB::HARRIS_SCORE, 31,
                                   options_.fast_threshold);
  std::vector<cv::KeyPoint> points;
  Detection result;
  orb->detectAndCompute(patch_.mat, cv::noArray(), points, result.descriptors);
  const Point2 middle = Point2(cols_ - 1, rows_ - 1) / 2;
  for (const cv::KeyPoint& point : points)
    result.offsets.push_back(Point2(static_cast<double>(point.pt.x), static_cast<double>(point.pt.y)) -
                             middle);
  return result;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
