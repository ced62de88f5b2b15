#pragma once

#include <Eigen/Core>
#include <asterism/solver/base/config.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

/// A similarity of the plane, x -> scale R(angle) x + translation.
struct ASTERISM_API PlaneTransform {
  double scale = 1;                                       ///< > 0
  double angle = 0;                                       ///< [rad], from the x axis towards the y axis
  Eigen::Vector2d translation = Eigen::Vector2d::Zero();  ///< [px]

  /// A point moved by it.
  Eigen::Vector2d operator()(const Eigen::Vector2d& x) const;
  /// The transform that undoes this one; scale must not be 0.
  PlaneTransform inverse() const;
};

/// The changes that a transform may make.
enum class TransformModel {
  Euclidean,  ///< rotation and translation, the paper's words (Sec. 2.5.2)
  Similarity  ///< with a uniform scale, which Algorithm 2's "position and size" needs
};

/// The least-squares transform from one point set to another (2 x N each, columns correspond; Umeyama 1991,
/// without reflection). Rotation and scale stay at their identity where the points do not determine them (N <
/// 2, or all points of a set coincident). N = 0 gives the identity.
ASTERISM_API PlaneTransform fit_transform(const Eigen::Ref<const Eigen::Matrix2Xd>& from,
                                          const Eigen::Ref<const Eigen::Matrix2Xd>& to, TransformModel model);

/// The derivative of the least-squares transform by the points that it fits: of
/// fit_transform(from, to, model)(point), x and y, and of the logarithm of its scale (rows) by `to`
/// (coordinate d of column i is column 2 i + d). jacobian: 3 x 2N, written.
ASTERISM_API void fit_jacobian(const Eigen::Ref<const Eigen::Matrix2Xd>& from,
                               const Eigen::Ref<const Eigen::Matrix2Xd>& to, TransformModel model,
                               const Eigen::Vector2d& point, Eigen::Ref<Eigen::Matrix3Xd> jacobian);

/// A transform and how much of the points moves by it.
struct RobustTransform {
  PlaneTransform transform;  ///< of the points that agree
  double support = 0;        ///< share of the weight, in [0, 1]: a point counts 1 / (1 + (error / radius)^2)
};

/// The transform that most points agree with, whatever the others do: the least of sum_i w_i rho(error_i),
/// rho the loss of Geman and McClure that lets go beyond `radius` [px, > 0]. `start` and transforms through
/// up to 128 pairs of points compete, the best is refined by reweighted least squares (Holland and Welsch
/// 1977). Hypotheses of more than twice or less than half the scale of `start` are left out. Rotation and
/// scale that the points do not determine, or the model does not change, stay those of `start`.
///
/// from, to: 2 x N, finite; weights: N, >= 0. Without any positive weight the result is `start`, support 0.
ASTERISM_API RobustTransform fit_robust_transform(const Eigen::Ref<const Eigen::Matrix2Xd>& from,
                                                  const Eigen::Ref<const Eigen::Matrix2Xd>& to,
                                                  const Eigen::Ref<const Eigen::VectorXd>& weights,
                                                  TransformModel model, double radius,
                                                  const PlaneTransform& start);

}  // namespace ASTERISM_ABI
}  // namespace asterism
