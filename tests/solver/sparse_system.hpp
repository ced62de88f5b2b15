#pragma once

#include <asterism/solver/topology.hpp>
#include <cmath>
#include <cstdint>

#include "random_system.hpp"

namespace asterism::testing {

/// A large system of local links: nodes uniform at unit density, each linked to its six nearest, start and
/// anchors displaced from the nodes by up to 0.3 an axis; rest lengths before displacement, k_ij =
/// (0.1 mu_ij)^-2, k_i = 0.5 + u mean(k_ij) with u uniform in [0, 1).
template <typename System>
RandomSystem<System> sparse_system(std::uint64_t seed, int n) {
  using Points = typename System::Points;
  Rng rng(seed);
  const Points nodes = random_points<System>(rng, n, 0, std::pow(n, 1.0 / System::kDim));
  const Points displacement = random_points<System>(rng, n, -0.3, 0.3);
  const Points anchor_displacement = random_points<System>(rng, n, -0.3, 0.3);
  RandomSystem<System> result{System(Topology<>::k_nearest(nodes, 6)), nodes + displacement};
  System& system = result.system;
  system.anchors = nodes + anchor_displacement;
  system.set_rest_lengths(nodes);
  system.link_stiffness = (0.1 * system.rest_length.array()).square().inverse();
  const double mean = system.link_stiffness.mean();
  for (int i = 0; i < n; ++i) {
    system.anchor_stiffness[i] = static_cast<typename System::Scalar>(0.5 + rng.uniform(0, 1) * mean);
  }
  return result;
}

}  // namespace asterism::testing
