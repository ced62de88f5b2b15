#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/numbers.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/spring_element.hpp>
#include <asterism/solver/method/descent.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/session.hpp>
#include <asterism/solver/run/summary.hpp>
#include <cmath>
#include <cstddef>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// Writes a direction in which the energy falls from x to both sides, if the ends of a link that pushes them
/// apart coincide there: it separates them across the direction that the gradient takes for the link, as
/// forces balance along that one. Returns the curvature that the energy falls by at least near x; 0, with
/// `direction` as it was, where there is no such link.
template <typename System>
typename System::Scalar direction_off_peak(const System& system, const typename System::Points& x,
                                           typename System::Points& direction) {
  using Point = typename System::Point;
  const int l = peaked_link(system, x);
  if (l < 0) [[likely]]
    return 0;
  const Link link = system.links()[static_cast<std::size_t>(l)];
  Point across = spring(system, link, Point(Point::Zero())).direction;
  if constexpr (System::kDim > 1) {
    int axis = 0;
    for (int c = 1; c < System::kDim; ++c) axis = std::abs(across[c]) < std::abs(across[axis]) ? c : axis;
    const auto along = across[axis];
    across *= -along;
    across[axis] += 1;
    normalise(across);
  }
  direction.setZero(System::kDim, x.cols());
  if (!system.is_fixed(link.i)) direction.col(link.i) = across;
  if (!system.is_fixed(link.j)) direction.col(link.j) = -across;
  return -system.link_stiffness[l];
}

/// The way down from a saddle x of the given energy along `direction`, whose curvature is negative: scales
/// the direction to the characteristic length and returns the longest of ever shorter steps along it,
/// negative for the other side, that lowers the energy by a tenth of what the curvature promises, up to that
/// of K_dyn; 0 if none does. `trial` is scratch.
template <typename System>
[[gnu::cold]] typename System::Scalar step_off_saddle(Session<System>& session, const System& system,
                                                      const typename System::Points& x,
                                                      typename System::Scalar here,
                                                      typename System::Scalar curvature,
                                                      typename System::Points& direction,
                                                      typename System::Points& trial, Summary& summary) {
  using Scalar = typename System::Scalar;
  Scalar farthest = 0;
  for (int i = 0; i < system.nodes(); ++i) farthest = std::max(farthest, direction.col(i).squaredNorm());
  const Scalar scale = session.length() / std::sqrt(farthest);
  direction *= scale;
  // Where linked nodes nearly coincide, the curvature has no limit, but holds over next to no distance.
  curvature = std::max(curvature * scale * scale, -stiffness_along(system, direction));
  const Scalar rounding = rounding_of_energy(system, x, here);
  constexpr int kMaxHalvings = 30;
  Scalar t = Scalar(0.5);
  for (int halving = 0; halving < kMaxHalvings; ++halving, t /= 2) {
    step_from(x, t, direction, trial);
    session.evaluate(system, trial);
    const Scalar ahead = session.energy();
    step_from(x, -t, direction, trial);
    session.evaluate(system, trial);
    const Scalar behind = session.energy();
    summary.energy_evaluations += 2;
    if (std::min(ahead, behind) < here + t * t * curvature / 20 - rounding) return ahead <= behind ? t : -t;
  }
  return 0;
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
