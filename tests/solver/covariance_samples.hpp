#pragma once

#include <Eigen/Core>
#include <asterism/solver/problem/spring_system.hpp>
#include <cstdint>

namespace asterism::testing {

/// The deviations of the nodes of p, E = -log p, and the share of proposals that were accepted.
struct Samples {
  Eigen::Vector4d deviations;
  double acceptance;
};

/// By random walk Metropolis, whose proposals know nothing of H.
Samples sample(const SpringSystem<double, 2, 4>& system, const SpringSystem<double, 2, 4>::Points& start,
               std::uint64_t seed, int count);

}  // namespace asterism::testing
