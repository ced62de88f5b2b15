#include <algorithm>
#include <array>
#include <asterism/trackers/constellation/transform.hpp>
#include <cmath>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

Eigen::Matrix2d rotation(double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  return (Eigen::Matrix2d() << c, -s, s, c).finished();
}

// Two sets of points: their means, and sums over the centred points p and q.
struct Moments {
  Eigen::Vector2d from_mean, to_mean;
  double dot = 0;                         // p . q
  double cross = 0;                       // p x q
  double spread = 0, to_spread = 0;       // |p|^2, |q|^2
  double from_square = 0, to_square = 0;  // of the points, not centred

  double aligned() const { return std::hypot(dot, cross); }
  // Whether the points determine an angle and a scale. Coincident points do not, although rounding of their
  // mean leaves them a spread.
  bool determined() const {
    constexpr double kLeastSpread = 1e-24;  // relative
    return aligned() > 0 && spread > kLeastSpread * from_square && to_spread > kLeastSpread * to_square;
  }
};

template <typename Weight>
Moments moments_about(const Eigen::Vector2d& from_mean, const Eigen::Vector2d& to_mean,
                      const Eigen::Ref<const Eigen::Matrix2Xd>& from,
                      const Eigen::Ref<const Eigen::Matrix2Xd>& to, const Weight& weight) {
  Moments sums{from_mean, to_mean};
  for (Eigen::Index i = 0; i < from.cols(); ++i) {
    const Eigen::Vector2d p = from.col(i) - from_mean, q = to.col(i) - to_mean;
    sums.dot += weight(i) * p.dot(q);
    sums.cross += weight(i) * (p.x() * q.y() - p.y() * q.x());
    sums.spread += weight(i) * p.squaredNorm();
    sums.to_spread += weight(i) * q.squaredNorm();
    sums.from_square += weight(i) * from.col(i).squaredNorm();
    sums.to_square += weight(i) * to.col(i).squaredNorm();
  }
  return sums;
}

Moments moments_of(const Eigen::Ref<const Eigen::Matrix2Xd>& from,
                   const Eigen::Ref<const Eigen::Matrix2Xd>& to) {
  return moments_about(from.rowwise().mean(), to.rowwise().mean(), from, to,
                       [](Eigen::Index) { return 1.0; });
}

// The least-squares transform: its angle maximises sum q . R p = cos sum p . q + sin sum p x q. Components
// that the points do not determine, or the model does not have, are those of `otherwise`.
PlaneTransform transform_of(const Moments& sums, TransformModel model, const PlaneTransform& otherwise = {}) {
  PlaneTransform transform = otherwise;
  if (sums.determined()) {
    transform.angle = std::atan2(sums.cross, sums.dot);
    if (model == TransformModel::Similarity) transform.scale = sums.aligned() / sums.spread;
  }
  transform.translation = sums.to_mean - transform.scale * (rotation(transform.angle) * sums.from_mean);
  return transform;
}

PlaneTransform fit_weighted(const Eigen::Ref<const Eigen::Matrix2Xd>& from,
                            const Eigen::Ref<const Eigen::Matrix2Xd>& to, const Eigen::VectorXd& weights,
                            TransformModel model, const PlaneTransform& otherwise) {
  const double total = weights.sum();
  return transform_of(moments_about(from * weights / total, to * weights / total, from, to,
                                    [&](Eigen::Index i) { return weights[i]; }),
                      model, otherwise);
}

}  // namespace

Eigen::Vector2d PlaneTransform::operator()(const Eigen::Vector2d& x) const {
  return scale * (rotation(angle) * x) + translation;
}

PlaneTransform PlaneTransform::inverse() const {
  return {1 / scale, -angle, -(rotation(-angle) * translation) / scale};
}

PlaneTransform fit_transform(const Eigen::Ref<const Eigen::Matrix2Xd>& from,
                             const Eigen::Ref<const Eigen::Matrix2Xd>& to, TransformModel model) {
  return from.cols() == 0 ? PlaneTransform() : transform_of(moments_of(from, to), model);
}

void fit_jacobian(const Eigen::Ref<const Eigen::Matrix2Xd>& from,
                  const Eigen::Ref<const Eigen::Matrix2Xd>& to, TransformModel model,
                  const Eigen::Vector2d& point, Eigen::Ref<Eigen::Matrix3Xd> jacobian) {
  const Eigen::Index n = from.cols();
  const auto turned = [](const Eigen::Vector2d& v) { return Eigen::Vector2d(-v.y(), v.x()); };
  if (n == 0) return;
  // scale (cos, sin) = (dot, cross) / spread, both linear in `to`.
  const Moments sums = moments_of(from, to);
  const double aligned = sums.aligned();
  const bool turns = sums.determined();
  const double scale = turns && model == TransformModel::Similarity ? aligned / sums.spread : 1;
  const Eigen::Vector2d direction =
      turns ? Eigen::Vector2d(sums.dot, sums.cross) / aligned : Eigen::Vector2d(1, 0);
  const Eigen::Vector2d d = point - sums.from_mean;
  const Eigen::Vector2d arm = scale * (direction.x() * d + direction.y() * turned(d));
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::Vector2d p = from.col(i) - sums.from_mean;
    auto block = jacobian.middleCols<2>(2 * i);
    block.setZero();
    block.topRows<2>().diagonal().setConstant(1 / static_cast<double>(n));
    if (!turns) continue;
    const Eigen::RowVector2d by_angle = (direction.x() * turned(p) - direction.y() * p).transpose() / aligned;
    block.topRows<2>() += turned(arm) * by_angle;
    if (model != TransformModel::Similarity) continue;
    const Eigen::RowVector2d by_log_scale =
        (direction.x() * p + direction.y() * turned(p)).transpose() / aligned;
    block.topRows<2>() += arm * by_log_scale;
    block.row(2) = by_log_scale;
  }
}

RobustTransform fit_robust_transform(const Eigen::Ref<const Eigen::Matrix2Xd>& from,
                                     const Eigen::Ref<const Eigen::Matrix2Xd>& to,
                                     const Eigen::Ref<const Eigen::VectorXd>& weights, TransformModel model,
                                     double radius, const PlaneTransform& start) {
  constexpr std::size_t kHypotheses = 128;
  constexpr int kRefinements = 10;
  constexpr double kLargestChange = 2;  // of scale
  RobustTransform best{start, 0};
  const double total = weights.sum();
  if (!(total > 0)) return best;

  // 1 / (1 + (error / radius)^2) for each point.
  const auto shares = [&](const PlaneTransform& transform) {
    const Eigen::Matrix2d turn = transform.scale * rotation(transform.angle);
    Eigen::VectorXd result(from.cols());
    for (Eigen::Index i = 0; i < from.cols(); ++i) {
      const Eigen::Vector2d error = turn * from.col(i) + transform.translation - to.col(i);
      result[i] = 1 / (1 + error.squaredNorm() / (radius * radius));
    }
    return result;
  };
  const auto offer = [&](const PlaneTransform& transform) {
    const double change = transform.scale / start.scale;
    if (!(change <= kLargestChange && change >= 1 / kLargestChange)) return;
    const double support = shares(transform).dot(weights) / total;
    if (support > best.support) best = {transform, support};
  };
  offer(start);

  std::vector<Eigen::Index> used;
  for (Eigen::Index i = 0; i < from.cols(); ++i)
    if (weights[i] > 0) used.push_back(i);
  // Pairs points far apart in their order, and so mostly in the plane: this makes their angle more accurate.
  for (const std::size_t stride : {used.size() / 2, used.size() / 3 + 1})
    for (std::size_t i = 0; i < used.size() && i < kHypotheses / 2; ++i) {
      const std::size_t first = i * std::max<std::size_t>(1, used.size() / (kHypotheses / 2)) % used.size();
      const std::array<Eigen::Index, 2> pair{used[first], used[(first + stride) % used.size()]};
      const Eigen::Matrix2d a = from(Eigen::all, pair), b = to(Eigen::all, pair);
      offer(transform_of(moments_of(a, b), model, start));
    }

  for (int k = 0; k < kRefinements; ++k) {
    const Eigen::VectorXd left = weights.cwiseProduct(shares(best.transform).cwiseAbs2());
    if (!(left.sum() > 0)) break;
    const double before = best.support;
    offer(fit_weighted(from, to, left, model, start));
    if (best.support <= before) break;
  }
  return best;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
