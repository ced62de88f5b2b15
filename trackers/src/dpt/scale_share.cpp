#include <asterism/trackers/dpt/scale_share.hpp>
#include <cmath>

namespace asterism {
inline namespace ASTERISM_ABI {

void ScaleShare::init(const Frame& frame, const ObjectPose& pose) {
  if (enabled()) filter_.init(frame, pose.centre(), pose.size());
}

double ScaleShare::growth(const Frame& frame, const Point2& centre, double by_constellation) {
  if (!enabled()) return by_constellation;
  const double seen = filter_.localize(frame, centre);
  return std::pow(by_constellation, 1 - share_) * std::pow(seen, share_);
}

void ScaleShare::share(Eigen::Matrix3d& covariance) const {
  if (!enabled()) return;
  const Eigen::Vector3d kept(1, 1, 1 - share_);
  covariance = kept.asDiagonal() * covariance * kept.asDiagonal();
  covariance(2, 2) += std::pow(share_, 2) * filter_.log_variance();
}

void ScaleShare::adapt(const Frame& frame, const ObjectPose& pose) {
  if (enabled()) filter_.adapt(frame, pose.centre(), pose.size());
}

void ScaleShare::visit_state(StateArchive& archive) {
  if (enabled()) filter_.visit_state(archive);
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
