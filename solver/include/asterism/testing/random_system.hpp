#pragma once

// Random systems for tests and benchmarks, the same on every compiler and machine: arithmetic is in double,
// fused operations are explicit where a compiler might choose them, and results that mathematical libraries
// round differently are rounded to fewer digits.

#include <array>
#include <asterism/solver/base/split_mix.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>

namespace asterism::testing {

/// xoshiro256** seeded by splitmix64 (Blackman and Vigna): the same numbers with every compiler and library.
class Rng {
 public:
  /// Any seed will do.
  explicit Rng(std::uint64_t seed) {
    detail::SplitMix64 words(seed);
    for (auto& word : state_) word = words();
  }

  /// The next 64 bits.
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
    return std::fma(high - low, unit, low);
  }

  /// Standard normal (Box and Muller) to a multiple of 2^-32, two uniform numbers each.
  double normal() {
    const double u = uniform(0, 1);
    const double v = uniform(0, 1);
    const double exact = std::sqrt(-2 * std::log1p(-u)) * std::cos(6.283185307179586 * v);
    return std::round(exact * 0x1p32) * 0x1p-32;
  }

 private:
  std::uint64_t state_[4];
};

/// A system and the start that the paper solves it from.
template <typename System>
struct RandomSystem {
  System system;                  ///< all of its values are set
  typename System::Points start;  ///< Dim x N
};

/// The kinds of random systems: those that the paper's Sec. 3.2.1 leaves open, and those of a tracker.
enum class Kind {
  Lit,   ///< literally: anchors displaced from the displaced nodes, k_ij from the lengths before displacement
  Orig,  ///< as Lit, but anchors displaced from the nodes before their displacement
  Disp,  ///< as Lit, but k_ij from the lengths after displacement
  Track  ///< a grid of parts 30 px apart that moved together, one in ten of them found far off
};
/// All of them.
inline constexpr std::array kKinds = {Kind::Lit, Kind::Orig, Kind::Disp, Kind::Track};

constexpr std::string_view to_string(Kind kind) {
  constexpr std::array<std::string_view, kKinds.size()> kNames = {"lit", "orig", "disp", "track"};
  return kNames[static_cast<std::size_t>(kind)];
}

namespace detail {

template <int kDim>
using Doubles = Eigen::Matrix<double, kDim, Eigen::Dynamic>;

template <int kDim>
double distance(const Doubles<kDim>& x, const Link& link) {
  double square = 0;
  for (int d = 0; d < kDim; ++d) {
    const double difference = x(d, link.i) - x(d, link.j);
    square = std::fma(difference, difference, square);
  }
  return std::sqrt(square);
}

/// The spring stiffness of the paper, (0.1 length)^-2.
inline double paper_stiffness(double length) {
  const double deviation = 0.1 * length;
  return 1 / (deviation * deviation);
}

template <int kDim>
Doubles<kDim> random_points(Rng& rng, int n, double low, double high) {
  Doubles<kDim> points(kDim, n);
  for (double& coordinate : points.reshaped()) coordinate = rng.uniform(low, high);
  return points;
}

/// k_i = 0.5 + u mean(k_ij) with u uniform in [0, 1).
template <typename System>
void draw_anchor_stiffness(Rng& rng, System& system, double sum_of_links) {
  const double mean = system.link_count() > 0 ? sum_of_links / system.link_count() : 1;
  for (auto& k : system.anchor_stiffness) {
    k = static_cast<typename System::Scalar>(std::fma(rng.uniform(0, 1), mean, 0.5));
  }
}

}  // namespace detail

/// Dim x n coordinates, each uniform in [low, high), drawn node by node. Throws std::invalid_argument where
/// the system's type has no room for n nodes.
template <typename System>
typename System::Points random_points(Rng& rng, int n, double low, double high) {
  using Points = typename System::Points;
  if ((Points::ColsAtCompileTime != Eigen::Dynamic && n != Points::ColsAtCompileTime) ||
      (Points::MaxColsAtCompileTime != Eigen::Dynamic && n > Points::MaxColsAtCompileTime)) {
    throw std::invalid_argument("random_points: " + std::to_string(n) +
                                " nodes do not fit the system's type");
  }
  return detail::random_points<System::kDim>(rng, n, low, high).template cast<typename System::Scalar>();
}

/// Random systems of the paper's Sec. 3.2.1: nodes p uniform in the unit cube, displaced by d of up to 0.5 an
/// axis (the start p + d), anchors displaced by b of up to 0.25 an axis, rest lengths |p_i - p_j|, k_ij =
/// (0.1 length)^-2, k_i = 0.5 + u mean(k_ij) with u uniform in [0, 1). Numbers are drawn in the order p, d,
/// b, u.
template <typename System>
RandomSystem<System> random_paper_system(Rng& rng, const typename System::TopologyType& topology, Kind kind) {
  using Scalar = typename System::Scalar;
  using Doubles = detail::Doubles<System::kDim>;
  const int n = topology.nodes();
  const Doubles nodes = detail::random_points<System::kDim>(rng, n, 0, 1);
  const Doubles displaced = nodes + detail::random_points<System::kDim>(rng, n, -0.5, 0.5);
  const Doubles anchor_displacement = detail::random_points<System::kDim>(rng, n, -0.25, 0.25);

  RandomSystem<System> result{System(topology), displaced.template cast<Scalar>()};
  System& system = result.system;
  system.anchors =
      Doubles((kind == Kind::Orig ? nodes : displaced) + anchor_displacement).template cast<Scalar>();
  double sum = 0;
  for (int l = 0; const Link& link : system.links()) {
    const double k =
        detail::paper_stiffness(detail::distance<System::kDim>(kind == Kind::Disp ? displaced : nodes, link));
    system.rest_length[l] = static_cast<Scalar>(detail::distance<System::kDim>(nodes, link));
    system.link_stiffness[l++] = static_cast<Scalar>(k);
    sum += k;
  }
  detail::draw_anchor_stiffness(rng, system, sum);
  return result;
}

/// Systems such as a tracker makes: parts p on a grid 30 px apart, all moved by t of up to 10 px an axis (the
/// start p + t); anchors p + t + noise of 3 px, 20 px for one part in ten that drifted; k_i = w / sigma^2 and
/// k_ij = ((mu_ij - |a_i - a_j|) / mu_ij)^2 by the stiffness laws of Sec. 2.3.3, mu_ij from p.
template <typename System>
RandomSystem<System> random_track_system(Rng& rng, const typename System::TopologyType& topology) {
  using Scalar = typename System::Scalar;
  constexpr int kDim = System::kDim;
  using Doubles = detail::Doubles<kDim>;
  const int n = topology.nodes();
  const auto cells = [](int side) {
    int count = 1;
    for (int d = 0; d < kDim; ++d) count *= side;
    return count;
  };
  int side = 1;
  while (cells(side) < n) ++side;

  Doubles grid(kDim, n);
  for (int i = 0; i < n; ++i)
    for (int d = 0, rest = i; d < kDim; ++d, rest /= side) grid(d, i) = 30 * (rest % side);
  Eigen::Matrix<double, kDim, 1> shift;
  for (double& t : shift) t = rng.uniform(-10, 10);
  const Doubles moved = grid.colwise() + shift;

  RandomSystem<System> result{System(topology), moved.template cast<Scalar>()};
  System& system = result.system;
  Doubles anchors(kDim, n);
  for (int i = 0; i < n; ++i) {
    const bool drifted = rng.uniform(0, 1) < 0.1;
    for (int d = 0; d < kDim; ++d) anchors(d, i) = std::fma(rng.normal(), drifted ? 20 : 3, moved(d, i));
    const double weight = drifted ? rng.uniform(0.1, 0.4) : rng.uniform(0.3, 1);
    const double variance = drifted ? rng.uniform(50, 200) : rng.uniform(10, 60);
    system.anchor_stiffness[i] = static_cast<Scalar>(weight / variance);
  }
  system.anchors = anchors.template cast<Scalar>();
  for (int l = 0; const Link& link : system.links()) {
    const double length = detail::distance<kDim>(grid, link);
    const double strain = (length - detail::distance<kDim>(anchors, link)) / length;
    system.rest_length[l] = static_cast<Scalar>(length);
    system.link_stiffness[l++] = static_cast<Scalar>(strain * strain);
  }
  return result;
}

/// A system of any kind.
template <typename System>
RandomSystem<System> random_system(Rng& rng, const typename System::TopologyType& topology,
                                   Kind kind = Kind::Lit) {
  return kind == Kind::Track ? random_track_system<System>(rng, topology)
                             : random_paper_system<System>(rng, topology, kind);
}

/// System number `index` of its kind and size: the same whatever was drawn before.
template <typename System>
RandomSystem<System> numbered_system(Kind kind, const typename System::TopologyType& topology,
                                     std::uint64_t index) {
  const auto group = static_cast<std::uint64_t>(kind) << 16 | static_cast<std::uint64_t>(topology.nodes());
  Rng rng(group << 32 | index);
  return random_system<System>(rng, topology, kind);
}

/// FNV-1a of every number of a system and its start, going on from `digest`.
template <typename System>
std::uint64_t digest(const RandomSystem<System>& random, std::uint64_t digest = 0xcbf29ce484222325ULL) {
  const auto add = [&digest](const auto& values) {
    for (const double value : values.reshaped()) {
      const auto bits = std::bit_cast<std::uint64_t>(value);
      for (int shift = 0; shift < 64; shift += 8) {
        digest = (digest ^ (bits >> shift & 0xff)) * 0x100000001b3ULL;
      }
    }
  };
  add(random.system.anchors);
  add(random.system.anchor_stiffness);
  add(random.system.rest_length);
  add(random.system.link_stiffness);
  add(random.start);
  return digest;
}

}  // namespace asterism::testing
