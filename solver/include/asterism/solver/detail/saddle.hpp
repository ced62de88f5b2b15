#pragma once

#include <algorithm>
#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/run/session.hpp>
#include <asterism/solver/run/summary.hpp>
#include <cmath>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// The way down from a saddle x of the given energy along `direction`, whose curvature is negative: scales
/// the direction to the characteristic `length` and returns the longest of ever shorter steps along it,
/// negative for the other side, that lowers the energy by a tenth of what the curvature promises; 0 if none
/// does. `trial` is scratch.
template <typename System>
typename System::Scalar step_off_saddle(const System& system, const typename System::Points& x,
                                        typename System::Scalar here, typename System::Scalar length,
                                        typename System::Scalar curvature, typename System::Points& direction,
                                        typename System::Points& trial, Summary& summary) {
  using Scalar = typename System::Scalar;
  const Scalar scale = length / std::sqrt(direction.colwise().squaredNorm().maxCoeff());
  direction *= scale;
  curvature *= scale * scale;
  const Scalar rounding = rounding_of_energy(system, x, here);
  constexpr int kMaxHalvings = 30;
  Scalar t = Scalar(0.5);
  for (int halving = 0; halving < kMaxHalvings; ++halving, t /= 2) {
    const Scalar ahead = energy(system, trial = x + t * direction);
    const Scalar behind = energy(system, trial = x - t * direction);
    summary.energy_evaluations += 2;
    if (std::min(ahead, behind) < here + t * t * curvature / 20 - rounding) return ahead <= behind ? t : -t;
  }
  return 0;
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
