#pragma once

#include <Eigen/LU>
#include <algorithm>
#include <asterism/parts/concept/part_model.hpp>
#include <cmath>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Stiffness of the spring between a part and its visually best position, k = w / sigma^2 (Eq. 11)
/// [1/px^2]. Never below 1e-12 / sigma^2, so that a constellation without any response stays where it is.
inline double static_stiffness(const Evidence& evidence) {
  return std::max(evidence.peak, 1e-12) / evidence.covariance.trace();
}

/// The same spring with an information matrix, w / 2 Sigma^-1 [1/px^2]: static_stiffness in every direction
/// where the covariance Sigma is isotropic, softer along the axis on which the part is less sure. Ours;
/// bounded below alike.
inline Eigen::Matrix2d static_information(const Evidence& evidence) {
  return std::max(evidence.peak, 1e-12) / 2 * evidence.covariance.inverse();
}

/// Stiffness of the spring between two parts, ((mu - |d_A|) / mu)^2 (Eq. 12): the squared
/// strain that their visually best positions, `distance` apart, put on the nominal length mu >= 0. 0 for mu =
/// 0, where the strain is undefined.
inline double dynamic_stiffness(double nominal_length, double distance) {
  if (nominal_length <= 0) return 0;
  const double strain = (nominal_length - distance) / nominal_length;
  return strain * strain;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
