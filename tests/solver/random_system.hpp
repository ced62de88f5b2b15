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

  /// Standard normal (Box and Muller), two uniform numbers each.
  double normal() {
    const double u = uniform(0, 1);
    const double v = uniform(0, 1);
    return std::sqrt(-2 * std::log1p(-u)) * std::cos(6.283185307179586 * v);
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

/// What the paper's Sec. 3.2.1 leaves open, and what a tracker makes.
enum class Kind {
  Lit,   ///< literally: anchors displaced from the displaced nodes, k_ij from the lengths before displacement
  Orig,  ///< as Lit, but anchors displaced from the nodes before their displacement
  Disp,  ///< as Lit, but k_ij from the lengths after displacement
  Track  ///< a grid of parts 30 px apart that moved together, one in ten of them found far off
};

/// Random systems of the paper's Sec. 3.2.1: nodes p uniform in the unit cube, displaced by d of up to 0.5 an
/// axis (the start p + d), anchors displaced by b of up to 0.25 an axis, rest lengths |p_i - p_j|, k_ij =
/// (0.1 length)^-2, k_i = 0.5 + u mean(k_ij) with u uniform in [0, 1). Numbers are drawn in the order p, d,
/// b, u.
template <typename System>
RandomSystem<System> random_paper_system(Rng& rng, const typename System::TopologyType& topology, Kind kind) {
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;
  const int n = topology.nodes();
  const Points nodes = random_points<System>(rng, n, 0, 1);
  const Points displacement = random_points<System>(rng, n, -0.5, 0.5);
  const Points anchor_displacement = random_points<System>(rng, n, -0.25, 0.25);

  RandomSystem<System> result{System(topology), nodes + displacement};
  System& system = result.system;
  system.anchors = (kind == Kind::Orig ? nodes : result.start) + anchor_displacement;
  system.set_rest_lengths(kind == Kind::Disp ? result.start : nodes);
  system.link_stiffness = (Scalar(0.1) * system.rest_length.array()).square().inverse();
  system.set_rest_lengths(nodes);
  const Scalar mean = system.link_count() > 0 ? system.link_stiffness.mean() : Scalar(1);
  for (int i = 0; i < n; ++i) {
    const double u = rng.uniform(0, 1);
    system.anchor_stiffness[i] = Scalar(0.5) + static_cast<Scalar>(u) * mean;
  }
  return result;
}

/// Systems such as a tracker makes: parts p on a grid 30 px apart, all moved by t of up to 10 px an axis (the
/// start p + t); anchors p + t + noise of 3 px, 20 px for one part in ten that drifted; k_i = w / sigma^2 and
/// k_ij = ((mu_ij - |a_i - a_j|) / mu_ij)^2 by the stiffness laws of Sec. 2.3.3, mu_ij from p.
template <typename System>
RandomSystem<System> random_track_system(Rng& rng, const typename System::TopologyType& topology) {
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;
  constexpr int kDim = System::kDim;
  const int n = topology.nodes();
  int side = 1;
  while (std::pow(side, kDim) < n) ++side;

  Points grid(kDim, n);
  for (int i = 0; i < n; ++i)
    for (int d = 0, rest = i; d < kDim; ++d, rest /= side)
      grid(d, i) = static_cast<Scalar>(30 * (rest % side));
  typename System::Point shift;
  for (int d = 0; d < kDim; ++d) shift[d] = static_cast<Scalar>(rng.uniform(-10, 10));

  RandomSystem<System> result{System(topology), grid.colwise() + shift};
  System& system = result.system;
  for (int i = 0; i < n; ++i) {
    const bool drifted = rng.uniform(0, 1) < 0.1;
    for (int d = 0; d < kDim; ++d) {
      const double noise = rng.normal() * (drifted ? 20 : 3);
      system.anchors(d, i) = result.start(d, i) + static_cast<Scalar>(noise);
    }
    const double weight = drifted ? rng.uniform(0.1, 0.4) : rng.uniform(0.3, 1);
    const double variance = drifted ? rng.uniform(50, 200) : rng.uniform(10, 60);
    system.anchor_stiffness[i] = static_cast<Scalar>(weight / variance);
  }
  system.set_rest_lengths(grid);
  for (int l = 0; const Link& link : system.links()) {
    const Scalar length = system.rest_length[l];
    const Scalar distance = (system.anchors.col(link.i) - system.anchors.col(link.j)).norm();
    system.link_stiffness[l++] = (length - distance) * (length - distance) / (length * length);
  }
  return result;
}

template <typename System>
RandomSystem<System> random_system(Rng& rng, const typename System::TopologyType& topology,
                                   Kind kind = Kind::Lit) {
  return kind == Kind::Track ? random_track_system<System>(rng, topology)
                             : random_paper_system<System>(rng, topology, kind);
}

}  // namespace asterism::testing
