#pragma once

#include <asterism/solver/spring_system.hpp>
#include <bit>
#include <cmath>
#include <cstdint>
#include <utility>

namespace asterism::testing {

/// xoshiro256** seeded by splitmix64 (Blackman and Vigna): the same numbers with every compiler and library.
class Rng {
 public:
  explicit Rng(std::uint64_t seed) {
    for (auto& word : state_) {
      seed += 0x9e3779b97f4a7c15ULL;
      std::uint64_t z = seed;
      z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
      z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
      word = z ^ (z >> 31);
    }
  }

  std::uint64_t operator()() {
    const std::uint64_t result = std::rotl(state_[1] * 5, 7) * 9;
    const std::uint64_t t = state_[1] << 17;
    state_[2] ^= state_[0];
    state_[3] ^= state_[1];
    state_[1] ^= state_[2];
    state_[0] ^= state_[3];
    state_[2] ^= t;
    state_[3] = std::rotl(state_[3], 45);
    return result;
  }

  /// Uniform in [low, high).
  double uniform(double low, double high) {
    const double unit = static_cast<double>((*this)() >> 11) * 0x1p-53;
    return low + (high - low) * unit;
  }

 private:
  std::uint64_t state_[4];
};

/// Dim x n coordinates, each uniform in [low, high), drawn node by node.
template <typename System>
typename System::Points random_points(Rng& rng, int n, double low, double high) {
  typename System::Points points(System::kDim, n);
  for (int i = 0; i < n; ++i) {
    for (int d = 0; d < System::kDim; ++d) {
      const double coordinate = rng.uniform(low, high);
      points(d, i) = static_cast<typename System::Scalar>(coordinate);
    }
  }
  return points;
}

/// A system and the start that the paper solves it from.
template <typename System>
struct RandomSystem {
  System system;
  typename System::Points start;
};

/// The random systems of the paper's Sec. 4.2.1: nodes uniform in the unit cube, displaced by up to 0.5 an
/// axis (the start), anchors displaced from the start by as much again; rest lengths before displacement,
/// k_ij = (0.1 mu_ij)^-2, k_i = (0.5 + u) mean(k_ij) with u uniform in [0, 1).
template <typename System>
RandomSystem<System> random_system(Rng& rng, const typename System::TopologyType& topology) {
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;
  const int n = topology.nodes();
  const Points nodes = random_points<System>(rng, n, 0, 1);
  const Points displacement = random_points<System>(rng, n, -0.5, 0.5);
  const Points anchor_displacement = random_points<System>(rng, n, -0.5, 0.5);

  RandomSystem<System> result{System(topology), nodes + displacement};
  System& system = result.system;
  system.anchors = result.start + anchor_displacement;
  system.set_rest_lengths(nodes);
  system.link_stiffness = (Scalar(0.1) * system.rest_length.array()).square().inverse();
  const Scalar mean = system.link_count() > 0 ? system.link_stiffness.mean() : Scalar(1);
  for (int i = 0; i < n; ++i) {
    const double u = rng.uniform(0, 1);
    system.anchor_stiffness[i] = static_cast<Scalar>(0.5 + u) * mean;
  }
  return result;
}

}  // namespace asterism::testing
