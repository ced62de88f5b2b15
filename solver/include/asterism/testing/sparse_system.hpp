#pragma once

#include <asterism/solver/problem/topology.hpp>
#include <asterism/testing/random_system.hpp>
#include <cmath>
#include <cstdint>

namespace asterism::testing {

/// A large system of local links: nodes uniform at unit density, each linked to its six nearest, start and
/// anchors displaced from the nodes by up to 0.3 an axis; rest lengths before displacement, k_ij =
/// (0.1 mu_ij)^-2, k_i = 0.5 + u mean(k_ij) with u uniform in [0, 1).
template <typename System>
RandomSystem<System> sparse_system(std::uint64_t seed, int n) {
  constexpr int kDim = System::kDim;
  using Scalar = typename System::Scalar;
  using Doubles = detail::Doubles<kDim>;
  Rng rng(seed);
  const double side = std::round(std::pow(n, 1.0 / kDim) * 0x1p20) * 0x1p-20;
  const Doubles nodes = detail::random_points<kDim>(rng, n, 0, side);
  const Doubles start = nodes + detail::random_points<kDim>(rng, n, -0.3, 0.3);
  const Doubles anchors = nodes + detail::random_points<kDim>(rng, n, -0.3, 0.3);
  RandomSystem<System> result{System(Topology<>::k_nearest(nodes, 6)), start.template cast<Scalar>()};
  System& system = result.system;
  system.anchors = anchors.template cast<Scalar>();
  double sum = 0;
  for (int l = 0; const Link& link : system.links()) {
    const double length = detail::distance<kDim>(nodes, link);
    const double k = detail::paper_stiffness(length);
    system.rest_length[l] = static_cast<Scalar>(length);
    system.link_stiffness[l++] = static_cast<Scalar>(k);
    sum += k;
  }
  detail::draw_anchor_stiffness(rng, system, sum);
  return result;
}

}  // namespace asterism::testing
