// The staircase: compared with many starts and known minima, and the inputs that must pass through it
// unchanged.
#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/method/make_solver.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/method/staircase.hpp>
#include <atomic>
#include <cstdint>
#include <limits>
#include <string_view>

#include "lowest_energy.hpp"
#include "model_kits.hpp"
#include "test_systems.hpp"

namespace asterism {
namespace {

using detail::AutoStaircase;
using testing::Fixed2;
using testing::Fixed2f;
using testing::Kind;
using testing::Line;
using testing::lowest_energy;
using testing::Plane;
using testing::Rng;
using testing::Space;

constexpr std::string_view kProven = "within the gap of the global minimum";

template <typename System>
void expect_lowest(Kind kind, int nodes, int systems, double share, double accuracy) {
  AutoStaircase<System> staircase;
  Auto<System> plain;
  int lowest_found = 0, proven = 0, plain_certified = 0;
  for (int index = 0; index < systems; ++index) {
    const auto [system, start] = testing::numbered_system<System>(kind, System::TopologyType::full(nodes),
                                                                  5000 + static_cast<std::uint64_t>(index));
    typename System::Points x = start, y = start;
    const Summary summary = staircase.solve(system, x);
    ASSERT_TRUE(summary.usable()) << summary;
    EXPECT_LE(summary.final_energy, plain.solve(system, y).final_energy);
    EXPECT_NEAR(summary.final_energy, static_cast<double>(energy(system, x)),
                accuracy * summary.final_energy);
    const double lowest = lowest_energy(system, start, 60, static_cast<std::uint64_t>(index));
    EXPECT_LE(summary.lower_bound, lowest * (1 + accuracy)) << index;
    EXPECT_GT(summary.lower_bound, 0.5 * summary.final_energy) << index;
    lowest_found += summary.final_energy <= lowest * (1 + accuracy) ? 1 : 0;
    plain_certified += certify(system, y).certified() ? 1 : 0;
    if (!(summary.message == kProven)) continue;
    ++proven;
    EXPECT_LE(summary.final_energy, lowest * (1 + accuracy)) << index;
  }
  EXPECT_GE(lowest_found, share * systems);
  EXPECT_GE(proven, plain_certified);
}

TEST(Staircase, EndsInTheLowestMinimumThatManyStartsFind) {
  expect_lowest<Fixed2>(Kind::Lit, 4, 400, 0.985, 1e-6);
  expect_lowest<Plane>(Kind::Track, 9, 60, 0.99, 1e-6);
  expect_lowest<Space>(Kind::Lit, 5, 60, 0.95, 1e-6);
  expect_lowest<Fixed2f>(Kind::Lit, 4, 100, 0.97, 1e-4);
}

// Two nodes on a line that start in swapped order cannot pass each other there, but can in the plane.
TEST(Staircase, LetsNodesPassEachOther) {
  Line system(Line::TopologyType::full(2));
  system.anchors << 0, 1;
  system.anchor_stiffness << 1, 1;
  system.rest_length << 1;
  system.link_stiffness << 50;
  Line::Points x{{1, 0}};
  Line::Points alone = x;
  EXPECT_GT(Newton<Line>(system, AlignedOptions()).solve(system, alone).final_energy, 0.5);
  const Summary summary = AutoStaircase<Line>().solve(system, x);
  EXPECT_EQ(summary.status, Status::Converged);
  EXPECT_LT(summary.final_energy, 1e-12);
  EXPECT_EQ(summary.message, kProven);
  EXPECT_TRUE(x.isApprox(system.anchors, 1e-6));
}

TEST(Staircase, KeepsFixedNodes) {
  int moved = 0;
  for (std::uint64_t index = 0; index < 60; ++index) {
    auto [system, start] = testing::numbered_system<Plane>(Kind::Lit, Topology<>::full(5), index);
    system.fix(1);
    Plane::Points x = start, alone = start;
    const Summary summary = AutoStaircase<Plane>().solve(system, x);
    ASSERT_TRUE(summary.usable());
    EXPECT_EQ(x.col(1), start.col(1));
    EXPECT_LE(summary.lower_bound, summary.final_energy * (1 + 1e-12));
    moved += summary.final_energy < (1 - 1e-6) * Auto<Plane>().solve(system, alone).final_energy ? 1 : 0;
  }
  EXPECT_GT(moved, 0);
}

TEST(Staircase, TakesComponentsThatNothingHolds) {
  auto [system, start] = testing::numbered_system<Plane>(Kind::Lit, Topology<>::full(5), 1);
  system.anchor_stiffness.setZero();
  AutoStaircase<Plane> staircase;
  Plane::Points x = start;
  EXPECT_EQ(staircase.solve(system, x).status, Status::InvalidInput);
  EXPECT_EQ(x, start);
  staircase.options.ground_components = true;
  const Summary summary = staircase.solve(system, x);
  EXPECT_TRUE(summary.usable()) << summary;
  EXPECT_EQ(x.col(0), start.col(0));
  EXPECT_LE(summary.lower_bound, summary.final_energy * (1 + 1e-12));
}

TEST(Staircase, OfLargeSparseSystems) {
  auto [system, start] = testing::sparse_system<Plane>(3, 400);
  Plane::Points x = start, alone = start;
  const Summary plain = Auto<Plane>().solve(system, alone);
  const Summary summary = AutoStaircase<Plane>().solve(system, x);
  EXPECT_TRUE(summary.usable());
  EXPECT_LE(summary.final_energy, plain.final_energy);
  EXPECT_LE(summary.lower_bound, summary.final_energy);
  EXPECT_GT(summary.lower_bound, certify(system, alone).lower_bound);
}

TEST(Staircase, PassesOnWhatItsMethodSays) {
  auto [system, start] = testing::numbered_system<Plane>(Kind::Lit, Topology<>::full(6), 2);
  AutoStaircase<Plane> staircase;
  Plane::Points x = start;
  staircase.options.tolerance = -1;
  EXPECT_EQ(staircase.solve(system, x).status, Status::InvalidInput);
  staircase.options = {};
  std::atomic<bool> stop = true;
  staircase.options.stop = &stop;
  EXPECT_EQ(staircase.solve(system, x).status, Status::Interrupted);
  EXPECT_EQ(x, start);
  staircase.options = {};
  staircase.options.max_iterations = 0;
  EXPECT_EQ(staircase.solve(system, x).status, Status::MaxIterations);
  // After a system of another size, the first one gives the same bits.
  staircase.options = {};
  const Summary first = staircase.solve(system, x);
  auto [other, other_x] = testing::numbered_system<Plane>(Kind::Lit, Topology<>::full(9), 3);
  EXPECT_TRUE(staircase.solve(other, other_x).usable());
  Plane::Points again = start;
  EXPECT_EQ(staircase.solve(system, again).final_energy, first.final_energy);
  EXPECT_EQ(again, x);
}

// Even if it touches links beyond their length, the quadratic is below the energy, wherever it is expanded.
TEST(Staircase, StretchedMinorisersAreBelowTheEnergy) {
  Rng rng(5);
  detail::Prover<Plane, detail::SparseFactor<double>> prover;
  int positive = 0;
  for (std::uint64_t index = 0; index < 100; ++index) {
    const auto [system, start] = testing::numbered_system<Plane>(Kind::Lit, Topology<>::full(6), index);
    const double lowest = lowest_energy(system, start, 30, index);
    Plane::Points x = start;
    Newton<Plane>().solve(system, x);
    for (const double share : {0.0, 0.01, 0.3}) {
      Plane::Points y = x;
      for (double& coordinate : y.reshaped())
        coordinate += share * characteristic_length(system, x) * rng.uniform(-1, 1);
      const double bound = prover.stretched_bound(system, y);
      EXPECT_LE(bound, lowest * (1 + 1e-12));
      positive += bound > 0 ? 1 : 0;
    }
  }
  EXPECT_GT(positive, 100);
}

// It lowers the energy, but robust losses allow no lower bound.
TEST(Staircase, ClaimsNothingOfRobustAnchors) {
  using Robust = testing::Hubers::System;
  int lifted = 0;
  for (std::uint64_t index = 0; index < 20; ++index) {
    auto [system, start] = testing::numbered_system<Robust>(Kind::Lit, Robust::TopologyType::full(4), index);
    system.anchor_loss.scale = 0.5 * characteristic_length(system, start);
    Robust::Points x = start, alone = start;
    const Summary plain = Newton<Robust>().solve(system, alone);
    const Summary summary = Staircase<Robust, Newton<Robust>>().solve(system, x);
    EXPECT_LE(summary.final_energy, plain.final_energy);
    EXPECT_EQ(summary.lower_bound, 0);
    EXPECT_NE(summary.message, kProven);
    lifted += summary.iterations > plain.iterations ? 1 : 0;
  }
  EXPECT_GT(lifted, 0);
}

TEST(Staircase, IsMadeByName) {
  auto solver = make_solver<Plane>("staircase", {{"gap", 1e-3}});
  auto [system, x] = testing::numbered_system<Plane>(Kind::Track, Topology<>::full(4), 0);
  const Summary summary = solver.solve(system, x);
  EXPECT_TRUE(summary.is_within(1e-3));
  EXPECT_EQ(summary.solver, "Newton, repaired LDL^T") << "that of the solve that found it";
}

}  // namespace
}  // namespace asterism
