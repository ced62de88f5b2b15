#include <algorithm>
#include <asterism/trackers/constellation/pose.hpp>
#include <cmath>
#include <numbers>

namespace asterism {
inline namespace ASTERISM_ABI {

Point2 kept_in_image(const Frame& frame, const Point2& centre) {
  const Point2 last(frame.size().width - 1, frame.size().height - 1);
  return centre.cwiseMax(0).cwiseMin(last);
}

void ObjectPose::move_to(const PlaneTransform& transform) {
  scale_ = std::clamp(transform.scale, kMinScale, kMaxScale);
  angle_ = transform.angle;
  centre_ = transform.translation;
  size_ = scale_ * first_size_;
}

void ObjectPose::move_by(const PlaneTransform& step, double growth) {
  centre_ = step(centre_);
  angle_ = std::remainder(angle_ + step.angle, 2 * std::numbers::pi);
  size_ = (growth * size_).cwiseMax(kMinScale * first_size_).cwiseMin(kMaxScale * first_size_);
  scale_ = size_.x() / first_size_.x();
}

void ObjectPose::resize(const Size2& size) {
  size_ = size.cwiseMax(kMinScale * first_size_).cwiseMin(kMaxScale * first_size_);
  scale_ = std::sqrt(size_.cwiseQuotient(first_size_).prod());
}

Point2 ObjectPose::keep_in(const Frame& frame) {
  const Point2 before = centre_;
  centre_ = kept_in_image(frame, centre_);
  return before - centre_;
}

void ObjectPose::visit_state(StateArchive& archive) {
  constexpr double kRounding = 1e-9;
  archive.size(first_size_);
  archive.size(size_);
  archive.position(centre_);
  archive(angle_);
  archive(scale_);
  const Size2 growth = size_.cwiseQuotient(first_size_);
  archive.require(growth.minCoeff() >= (1 - kRounding) * kMinScale &&
                  growth.maxCoeff() <= (1 + kRounding) * kMaxScale);
  archive.require(std::abs(std::sqrt(growth.prod()) - scale_) <= kRounding * scale_);
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
