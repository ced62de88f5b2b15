#pragma once

#include <algorithm>
#include <asterism/parts/concept/part_model.hpp>
#include <cmath>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Parameters of the laws below, which give the springs their stiffness. The defaults are the paper's laws,
/// to the last bit; bench/evaluation/learn_laws.py fits others to annotated video. The anchors have no scale
/// of their own: a factor common to all springs does not change the placement. As in the paper, the stiffness
/// of an anchor depends on the unit of length, the pixel, and that of a link does not.
struct StiffnessLaw {
  /// Exponent of the evidence's peak w in the stiffness of an anchor, in [0, 4].
  double peak_exponent = 1;
  /// Exponent of the evidence's variance sigma^2 [px^2] in the stiffness of an anchor, in [0, 4].
  double variance_exponent = 1;
  /// Factor of the stiffness of links, in [1e-9, 1e9].
  double link_scale = 1;
  /// Exponent of the strain in the stiffness of a link, in [0, 8]; with 0, all links are alike.
  double strain_exponent = 2;
  /// The strain of a link counts as (strain^2 + strain_floor^2)^(1/2), so that a link without strain has some
  /// stiffness, too; in [0, 1e3].
  double strain_floor = 0;
};

namespace detail {
/// x^exponent; x itself, to the last bit, for an exponent of 1.
inline double power(double x, double exponent) { return exponent == 1 ? x : std::pow(x, exponent); }
/// w^a of the evidence.
inline double weight(const Evidence& evidence, const StiffnessLaw& law) {
  return std::max(power(std::max(evidence.peak, 0.0), law.peak_exponent), 1e-12);
}
}  // namespace detail

/// Stiffness of the spring between a part and its visually best position, k = w^a / sigma^(2b), a and b the
/// law's exponents; k = w / sigma^2 by default (Eq. 11) [1/px^2]. w^a counts as 1e-12 at least, so that a
/// constellation without any response stays where it is.
inline double static_stiffness(const Evidence& evidence, const StiffnessLaw& law = {}) {
  return detail::weight(evidence, law) / detail::power(evidence.covariance.trace(), law.variance_exponent);
}

/// Stiffness of the spring between two parts, beta (strain^2 + floor^2)^(c/2), where beta is the law's
/// link_scale and c its strain_exponent. The strain (mu - |d_A|) / mu is what the parts' visually best
/// positions, `distance` apart, put on the nominal length mu >= 0. By default strain^2 (Eq. 12). 0 for mu =
/// 0, where the strain is undefined.
inline double dynamic_stiffness(double nominal_length, double distance, const StiffnessLaw& law = {}) {
  if (nominal_length <= 0) return 0;
  const double strain = (nominal_length - distance) / nominal_length;
  return law.link_scale *
         detail::power(strain * strain + law.strain_floor * law.strain_floor, law.strain_exponent / 2);
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
