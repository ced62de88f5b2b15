#pragma once

#include <Eigen/Core>
#include <asterism/solver/problem/spring_system.hpp>
#include <cstdint>

namespace asterism::testing {

/// The nodes' standard deviations under p, E = -log p, and the fraction of accepted proposals.
struct Samples {
  Eigen::Vector4d deviations;
  double acceptance;
};

/// Samples by random walk Metropolis, whose proposals do not depend on H.
Samples sample(const SpringSystem<double, 2, 4>& system, const SpringSystem<double, 2, 4>::Points& start,
               std::uint64_t seed, int count);

}  // namespace asterism::testing
