// The state of the trackers that is saved.

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <asterism/trackers/around/interruption.hpp>
#include <asterism/trackers/around/kalman.hpp>
#include <asterism/trackers/dpt/coarse.hpp>
#include <asterism/trackers/dpt/dpt.hpp>
#include <asterism/trackers/others/lgt.hpp>
#include <asterism/trackers/tracker/tracker_options.hpp>
#include <cmath>
#include <limits>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Tolerance for rounding, e.g. of a correlation matrix that should be symmetric and positive semi-definite.
constexpr double kRounding = 1e-6;

void visit_box(StateArchive& archive, cv::Rect2d& box) {
  archive(box.x), archive(box.y), archive(box.width), archive(box.height);
  archive.require(std::min(box.width, box.height) >= 1e-6 && std::max(box.width, box.height) <= 1e6 &&
                  centre_of(box).cwiseAbs().maxCoeff() <= 1e6);
}

}  // namespace

void CoarseLayer::visit_state(StateArchive& archive) {
  archive.begin("coarse layer", options_);
  pose_.visit_state(archive);
  root_.visit_state(archive);
  color_.visit_state(archive);
}

void MotionModel::visit_state(StateArchive& archive, const Point2& centre, const Size2& size) {
  if (archive.loading()) place(centre, size);
  archive.pixels(previous_, window_.grid(), 1);
  archive(learned_);
  archive.require(learned_ >= 0 && learned_ <= kMostLearned);
  for (Histogram* const histogram : {&foreground_, &background_})
    for (double& share : *histogram) {
      archive(share);
      archive.require(share >= 0 && share <= 1 + kRounding);
    }
}

void CoarseTracker::visit_learned(StateArchive& archive) { layer_.visit_state(archive); }

void Dpt::visit_learned(StateArchive& archive) {
  DptOptions same = options_;
  same.threads = 1;  // without influence on the results
  archive.begin("dpt", same);
  coarse_.visit_state(archive);
  scale_.visit_state(archive);
  if (options_.judge) judge_.visit_state(archive);
  archive.size(part_size_);
  constellation_.visit_placement(archive);
  for (AnyPart& part : parts_) part.visit_state(archive);
  constellation_.visit_rest_lengths(archive);
}

void ConstantVelocityFilter::visit_state(StateArchive& archive) {
  using Correlation = Eigen::Matrix<double, 6, 6>;
  archive(state_);
  archive(covariance_);
  // Checks correlations, not variances, as the units of the coordinates differ.
  const auto variance = covariance_.diagonal().array();
  archive.require((variance >= 0).all());
  const Eigen::Vector<double, 6> weight = variance.max(std::numeric_limits<double>::min()).rsqrt();
  const Correlation correlation = weight.asDiagonal() * covariance_ * weight.asDiagonal();
  archive.require(
      (correlation - correlation.transpose()).cwiseAbs().maxCoeff() <= kRounding &&
      Eigen::SelfAdjointEigenSolver<Correlation>(correlation, Eigen::EigenvaluesOnly).eigenvalues()[0] >=
          -kRounding);
}

void KalmanTracker::visit_learned(StateArchive& archive) {
  archive.begin("kalman", options_);
  tracker_.visit_state(archive);
  filter_.visit_state(archive);
  // The archive's limits of positions and sizes; the velocity may cross them in one frame.
  const Eigen::Vector3d most(1e6, 1e6, std::log(1e6));
  archive.require((filter_.position().cwiseAbs().array() <= most.array()).all() &&
                  (filter_.velocity().cwiseAbs().array() <= 2 * most.array()).all());
}

void ElasticConstellation::visit_state(StateArchive& archive) {
  std::vector<Link> list = this->links();
  int parts = size(), links = static_cast<int>(list.size());
  archive.count(parts, 2 * sizeof(Point2));
  layout_.resize(2, parts), placement().resize(2, parts);
  visit_points(archive, layout_);
  visit_points(archive, placement());
  archive.count(links, sizeof(Link));
  list.resize(static_cast<std::size_t>(links));
  for (Link& link : list) archive(link.i), archive(link.j);
  if (!archive.loading()) return;
  const Topology<> topology = Topology<>::from_links(parts, list);
  archive.require(!topology.defect());
  assign(layout_, placement(), topology);
}

void Lgt::visit_learned(StateArchive& archive) {
  archive.begin("lgt", options_);
  pose_.visit_state(archive);
  filter_.visit_state(archive);
  color_.visit_state(archive);
  archive(shape_);
  archive.require((shape_ >= 0).all() && (shape_ <= 1).all());
  constellation_.visit_state(archive);
  archive.require(constellation_.size() >= 1 && constellation_.size() <= options_.max_parts);
  archive(capacity_);
  archive.require(capacity_ >= 0 && capacity_ <= options_.max_parts);
  archive.size(first_spread_);
  parts_.resize(static_cast<std::size_t>(constellation_.size()), {options_.part, 0});
  for (Part& part : parts_) {
    archive(part.weight);
    archive.require(part.weight >= 0 && part.weight <= 1);
    part.model.visit_state(archive);
  }
  archive(frames_);
  archive.require(frames_ >= 0 && frames_ < kMostFrames);
  visit_box(archive, box_);
  if (options_.use_motion) motion_.visit_state(archive, centre_of(box_), {box_.width, box_.height});
}

void FollowedFrame::visit_state(StateArchive& archive) {
  visit_box(archive, box);
  archive(confidence);
  archive.require(confidence >= 0 && confidence <= 1);
  archive(weak);
  const auto visit = [&archive](auto& cells, int side) {
    cv::Mat image(side, side, CV_8UC1, cells.data());
    archive.pixels(image, image.size(), 1);
    if (archive.loading()) std::copy(image.begin<std::uint8_t>(), image.end<std::uint8_t>(), cells.begin());
  };
  visit(view.levels, SceneView::kCells);
  visit(blanks, kCells);
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
