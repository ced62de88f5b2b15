#pragma once

#include <Eigen/Core>
#include <asterism/solver/config.hpp>

namespace asterism::inline ASTERISM_ABI {

/// A similarity of the plane, x -> scale R(angle) x + translation.
struct PlaneTransform {
  double scale = 1;
  double angle = 0;  ///< [rad], from the x axis towards the y axis
  Eigen::Vector2d translation = Eigen::Vector2d::Zero();

  Eigen::Vector2d operator()(const Eigen::Vector2d& x) const;
};

enum class TransformModel {
  Translation,
  Euclidean,  ///< rotation and translation, the paper's words (Sec. 2.5.2)
  Similarity  ///< with a uniform scale, which Algorithm 2's "position and size" needs
};

/// The least-squares transform from one point set to another (2 x N each, columns correspond; Umeyama 1991,
/// without reflection). Rotation and scale stay at their identity where the points do not determine them (N <
/// 2, or all points of a set coincident). N = 0 gives the identity.
PlaneTransform fit_transform(const Eigen::Ref<const Eigen::Matrix2Xd>& from,
                             const Eigen::Ref<const Eigen::Matrix2Xd>& to, TransformModel model);

}  // namespace asterism::inline ASTERISM_ABI
