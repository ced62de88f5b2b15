#include <asterism/trackers/transform.hpp>
#include <cmath>

namespace asterism::inline ASTERISM_ABI {

namespace {

Eigen::Matrix2d rotation(double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  return (Eigen::Matrix2d() << c, -s, s, c).finished();
}

}  // namespace

Eigen::Vector2d PlaneTransform::operator()(const Eigen::Vector2d& x) const {
  return scale * (rotation(angle) * x) + translation;
}

PlaneTransform fit_transform(const Eigen::Ref<const Eigen::Matrix2Xd>& from,
                             const Eigen::Ref<const Eigen::Matrix2Xd>& to, TransformModel model) {
  PlaneTransform transform;
  if (from.cols() == 0) return transform;
  const Eigen::Vector2d from_mean = from.rowwise().mean(), to_mean = to.rowwise().mean();
  if (model != TransformModel::Translation) {
    // With p, q the centred points: the angle maximises sum q . R p = cos sum p . q + sin sum p x q.
    double dot = 0, cross = 0, spread = 0;
    for (Eigen::Index i = 0; i < from.cols(); ++i) {
      const Eigen::Vector2d p = from.col(i) - from_mean, q = to.col(i) - to_mean;
      dot += p.dot(q);
      cross += p.x() * q.y() - p.y() * q.x();
      spread += p.squaredNorm();
    }
    const double aligned = std::hypot(dot, cross);
    if (aligned > 0 && spread > 0) {
      transform.angle = std::atan2(cross, dot);
      if (model == TransformModel::Similarity) transform.scale = aligned / spread;
    }
  }
  transform.translation = to_mean - transform.scale * (rotation(transform.angle) * from_mean);
  return transform;
}

}  // namespace asterism::inline ASTERISM_ABI
