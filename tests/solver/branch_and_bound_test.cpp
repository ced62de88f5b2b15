// Branch and bound: compares its intervals with many starts, and its cells and quadratics with their
// definitions; checks that it keeps its limits.
#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/method/branch_and_bound.hpp>
#include <asterism/solver/method/cast_system.hpp>
#include <asterism/solver/method/cone_system.hpp>
#include <asterism/solver/method/make_solver.hpp>
#include <asterism/solver/method/solve_global.hpp>
#include <asterism/solver/problem/model.hpp>
#include <asterism/solver/run/iteration.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/testing/random_system.hpp>
#include <atomic>
#include <cstdint>
#include <limits>
#include <string_view>
#include <vector>

#include "by_terms.hpp"
#include "lowest_energy.hpp"
#include "model_kits.hpp"
#include "test_systems.hpp"

namespace asterism {
namespace {

using testing::Kind;
using testing::lowest_energy;
using testing::Plane;
using testing::Rng;
using testing::Space;
using Four = testing::Fixed2;

// `searched` counts the systems that the certificate alone does not prove.
template <typename System>
void expect_global(Kind kind, int nodes, int systems, double gap, double accuracy, int& searched,
                   int fixed = -1) {
  BranchAndBound<System> solver;
  solver.options.gap = gap;
  solver.options.max_seconds = 20;
  for (int index = 0; index < systems; ++index) {
    auto [system, start] = testing::numbered_system<System>(kind, System::TopologyType::full(nodes),
                                                            9000 + static_cast<std::uint64_t>(index));
    if (fixed >= 0) system.fix(fixed);
    typename System::Points x = start;
    const Summary summary = solver.solve(system, x);
    ASSERT_EQ(summary.status, Status::Converged) << index << " " << summary;
    EXPECT_TRUE(summary.is_within(gap)) << index;
    EXPECT_NEAR(static_cast<double>(energy(system, x)), summary.final_energy,
                accuracy * summary.final_energy);
    const double lowest = lowest_energy(system, start, 60, static_cast<std::uint64_t>(index));
    EXPECT_LE(summary.lower_bound, lowest * (1 + accuracy)) << index;
    EXPECT_LE(summary.final_energy, lowest * (1 + gap)) << index;
    if (fixed >= 0) {
      EXPECT_EQ(x.col(fixed), start.col(fixed));
    }
    EXPECT_EQ(summary.solver, solver.name());
    EXPECT_EQ(summary.message, "within the gap of the global minimum");
    searched += certify(system, x, {.gap = gap}).certified() ? 0 : 1;
  }
}

TEST(BranchAndBound, NarrowsTheIntervalToTheGap) {
  int searched = 0;
  expect_global<Four>(Kind::Lit, 4, 100, 1e-3, 1e-9, searched);
  expect_global<Plane>(Kind::Lit, 3, 100, 1e-3, 1e-9, searched);
  expect_global<Plane>(Kind::Lit, 5, 30, 1e-2, 1e-9, searched);
  expect_global<testing::Fixed2f>(Kind::Lit, 4, 60, 1e-2, 1e-4, searched);
  expect_global<Space>(Kind::Lit, 5, 30, 3e-2, 1e-9, searched);
  expect_global<Plane>(Kind::Lit, 4, 60, 1e-2, 1e-9, searched, 2);
  EXPECT_GT(searched, 30);
}

// With a loose gap, parts whose bounds are below the energy found stay unsearched. With one iteration per
// solve, the placement is not a minimum: the bound must then be below the least energy, not only below its
// own.
TEST(BranchAndBound, ItsBoundIsThatOfThePartsLeftAlone) {
  int above = 0;
  for (std::uint64_t index = 0; index < 300; ++index) {
    const auto [system, start] = testing::numbered_system<Four>(Kind::Lit, Topology<4>::full(), index);
    BranchAndBound<Four> solver;
    solver.options.gap = 0.1;
    solver.options.max_iterations = 1;
    Four::Points x = start;
    const Summary summary = solver.solve(system, x);
    const double lowest = lowest_energy(system, start, 40, index);
    EXPECT_LE(summary.lower_bound, lowest * (1 + 1e-9)) << index;
    EXPECT_NEAR(energy(system, x), summary.final_energy, 1e-9 * summary.final_energy);
    EXPECT_TRUE(summary.status != Status::Converged || summary.stationarity <= solver.options.tolerance);
    above += summary.message == std::string_view("within the gap of the global minimum") &&
                     summary.iterations > 1 && summary.final_energy > lowest * (1 + 1e-6)
                 ? 1
                 : 0;
  }
  EXPECT_GT(above, 10);
}

TEST(BranchAndBound, LeavesManyNodesToTheStaircase) {
  const auto [system, start] = testing::numbered_system<Plane>(Kind::Lit, Topology<>::full(65), 0);
  Plane::Points x = start, y = start;
  BranchAndBound<Plane> solver;
  const Summary summary = solver.solve(system, x);
  testing::Staircase<Plane> staircase;
  const Summary up = staircase.solve(system, y);
  ASSERT_FALSE(up.is_within(solver.options.gap));
  EXPECT_EQ(summary.status, Status::MaxIterations);
  EXPECT_EQ(summary.message, "too many nodes for the search: the interval is that of the staircase");
  EXPECT_NEAR(summary.lower_bound, up.lower_bound, 1e-6 * up.lower_bound);
  EXPECT_NEAR(summary.final_energy, up.final_energy, 1e-6 * up.final_energy);
}

// In float, the energy and stationarity are those of the rounded placement.
TEST(BranchAndBound, JudgesWhatItReturns) {
  using Floats = testing::Fixed2f;
  int converged = 0;
  for (std::uint64_t index = 0; index < 100; ++index) {
    const auto [system, start] = testing::numbered_system<Floats>(Kind::Lit, Topology<4>::full(), index);
    BranchAndBound<Floats> solver;
    Floats::Points x = start;
    const Summary summary = solver.solve(system, x);
    const auto in_double = detail::cast_system<Plane>(system);
    const Plane::Points placed = x.cast<double>();
    EXPECT_EQ(summary.final_energy, energy(in_double, placed));
    EXPECT_EQ(summary.stationarity, stationarity(in_double, placed));
    EXPECT_LE(summary.lower_bound, summary.final_energy);
    converged += summary.is_within(solver.options.gap) ? 1 : 0;
  }
  EXPECT_GT(converged, 95);
}

template <typename System>
void expect_solves_globally(std::string_view method, int nodes) {
  for (std::uint64_t index = 0; index < 20; ++index) {
    const auto [system, start] =
        testing::numbered_system<System>(Kind::Lit, System::TopologyType::full(nodes), index);
    typename System::Points x = start;
    const Summary summary = solve_global(system, x);
    ASSERT_TRUE(summary.usable()) << summary;
    EXPECT_EQ(summary.solver, method);
    EXPECT_LE(summary.final_energy, lowest_energy(system, start, 40, index) * (1 + 1e-3)) << index;
  }
}

TEST(SolveGlobal, TakesTheMethodThatGoesFurthest) {
  expect_solves_globally<Four>("branch and bound", 4);
  expect_solves_globally<testing::Line>("staircase", 3);
  // Anisotropic anchors, whose nodes have to pass each other.
  using Anisotropic = testing::Ellipses::System;
  Anisotropic system(Anisotropic::TopologyType::full(2));
  system.anchors << 0, 1, 0, 0;
  for (const int i : {0, 1}) system.set_anchor_information(i, Eigen::Matrix2d{{1, 0}, {0, 100}});
  system.rest_length << 1;
  system.link_stiffness << 50;
  Anisotropic::Points x{{1, 0}, {0, 0}};
  EXPECT_LT(solve_global(system, x).final_energy, 1e-12);
}

// No time at all: nothing is iterated, whatever the method is.
template <typename System>
void expect_keeps_to_its_time(const System& system, const typename System::Points& start) {
  BranchAndBoundOptions options;
  options.max_seconds = 0;
  int observed = 0;
  auto observe = [&](const Iteration&) { return ++observed > 0; };
  options.on_iteration = observe;
  typename System::Points x = start;
  const Summary summary = solve_global(system, x, options);
  EXPECT_EQ(summary.status, Status::MaxIterations) << summary;
  EXPECT_EQ(summary.message, "the limit of time was reached before the gap");
  EXPECT_LE(summary.final_energy, summary.initial_energy);  // x is aligned
  EXPECT_EQ(observed, 0);
  options.max_seconds = 100;
  auto stop = [](const Iteration&) { return false; };
  options.on_iteration = stop;
  EXPECT_EQ(solve_global(system, x, options).status, Status::Interrupted);
}

TEST(SolveGlobal, KeepsToItsTime) {
  for (const int nodes : {9, 65}) {  // a search, and the staircase alone
    SCOPED_TRACE(nodes);
    const auto [system, start] = testing::numbered_system<Plane>(Kind::Lit, Topology<>::full(nodes), 0);
    expect_keeps_to_its_time(system, start);
  }
  const auto [line, start_of_line] =
      testing::numbered_system<testing::Line>(Kind::Lit, testing::Line::TopologyType::full(5), 0);
  expect_keeps_to_its_time(line, start_of_line);
  auto [loaded, start] = testing::numbered_system<Plane>(Kind::Lit, Topology<>::full(5), 0);
  loaded.loads.setOnes(2, 5);
  expect_keeps_to_its_time(loaded, start);
}

TEST(SolverRegistry, HasBranchAndBoundWhereItIs) {
  const auto has = [](const auto& registry) {
    const auto names = registry.names();
    return std::find(names.begin(), names.end(), "branch-and-bound") != names.end();
  };
  EXPECT_TRUE(has(solver_registry<Plane>()));
  EXPECT_TRUE(has(solver_registry<Space>()));
  static_assert(!detail::is_searchable<testing::Line>());
  static_assert(!detail::is_searchable<SpringSystem<double, 2, 4, 4, Model<Hooke, GemanMcClure>>>());
  const auto [system, start] = testing::numbered_system<Four>(Kind::Lit, Topology<4>::full(), 3);
  auto solver = make_solver<Four>("branch-and-bound", {{"max_nodes", 50}, {"gap", 1e-6}});
  Four::Points x = start;
  EXPECT_EQ(solver.solve(system, x).solver, "branch and bound");
}

TEST(BranchAndBound, KeepsToItsLimits) {
  int limited = 0;
  for (std::uint64_t index = 0; index < 20; ++index) {
    const auto [system, start] = testing::numbered_system<Plane>(Kind::Lit, Topology<>::full(9), index);
    BranchAndBound<Plane> solver;
    solver.options.gap = 1e-9;
    solver.options.max_nodes = 20;
    Plane::Points x = start;
    const Summary by_nodes = solver.solve(system, x);
    EXPECT_LE(by_nodes.lower_bound, by_nodes.final_energy);
    if (by_nodes.status != Status::MaxIterations) continue;
    ++limited;
    EXPECT_EQ(by_nodes.message, "the limit of nodes was reached before the gap");
    EXPECT_LE(by_nodes.iterations, 20 + 4);
    solver.options.max_seconds = 0;
    const Summary by_time = solver.solve(system, x = start);
    EXPECT_EQ(by_time.status, Status::MaxIterations);
    EXPECT_EQ(by_time.iterations, 0);
    EXPECT_EQ(by_time.message, "the limit of time was reached before the gap");
    EXPECT_LE(by_time.lower_bound, by_nodes.lower_bound);
    // The bound improves with time.
    solver.options.max_nodes = 2000;
    solver.options.max_seconds = 10;
    EXPECT_GE(solver.solve(system, x = start).lower_bound, by_nodes.lower_bound);
  }
  EXPECT_GT(limited, 5);
}

// Points whose distances are known with errors: where the search finds a minimum that the certificate proves,
// the interval has the certificate's lower end.
TEST(BranchAndBound, ConvergesToAnIntervalWithinTheGap) {
  int searched = 0;
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    Rng rng(seed);
    Plane system(Topology<>::full(3 + static_cast<int>(seed % 4)));
    const auto random_points = [&] {
      return Plane::Points::NullaryExpr(2, system.nodes(), [&] { return rng.uniform(-10, 10); }).eval();
    };
    system.set_rest_lengths(random_points());
    for (double& length : system.rest_length) length *= rng.uniform(0.7, 1.3);
    system.anchors.setZero();
    system.anchor_stiffness.setZero();
    system.link_stiffness.setOnes();
    Plane::Points x = random_points();
    BranchAndBound<Plane> solver;
    solver.options.gap = 1e-6;
    solver.options.hold_floating = true;
    solver.options.max_seconds = 0.2;
    const Summary summary = solver.solve(system, x);
    ASSERT_TRUE(summary.usable()) << summary;
    if (summary.status != Status::Converged || summary.final_energy < 1e-6) continue;
    EXPECT_TRUE(summary.is_within(solver.options.gap))
        << seed << " " << summary.lower_bound << " " << summary;
    searched += summary.iterations > 0 && certify(system, x).certified() ? 1 : 0;
  }
  EXPECT_GT(searched, 20);
}

TEST(BranchAndBound, RefusesBadOptionsAndPassesOnStatuses) {
  auto [system, start] = testing::numbered_system<Four>(Kind::Lit, Topology<4>::full(), 1);
  BranchAndBound<Four> solver;
  Four::Points x = start;
  solver.options.gap = 0;
  EXPECT_EQ(solver.solve(system, x).message, "option gap is not positive");
  solver.options = {};
  solver.options.max_seconds = -1;
  EXPECT_EQ(solver.solve(system, x).status, Status::InvalidInput);
  solver.options = {};
  std::atomic<bool> stop = true;
  solver.options.stop = &stop;
  EXPECT_EQ(solver.solve(system, x).status, Status::Interrupted);
  solver.options = {};
  system.anchor_stiffness.setZero();
  EXPECT_EQ(solver.solve(system, x).status, Status::InvalidInput);
  EXPECT_EQ(x, start);
  system.anchor_stiffness.setOnes();
  const Four::Points anchors = system.anchors;
  const Summary overlapping = solver.solve(system, system.anchors);
  EXPECT_EQ(overlapping.status, Status::InvalidInput);
  EXPECT_EQ(overlapping.message, "x shares memory with the system, such as its anchors: pass a copy");
  EXPECT_EQ(system.anchors, anchors);
}

// A placement far from the minimum is not proven, and without links there are no directions to divide.
TEST(BranchAndBound, EndsWithoutLinks) {
  Plane system(Topology<>::from_links(3, {}));
  system.anchors << 0, 1, 2, 0, 0, 1;
  system.anchor_stiffness << 1, 2, 3;
  BranchAndBound<Plane> solver;
  solver.options.max_iterations = 0;
  Plane::Points x = Plane::Points::Constant(2, 3, 1e6);
  const Summary summary = solver.solve(system, x);
  EXPECT_EQ(summary.status, Status::MaxIterations) << summary;
  EXPECT_LE(summary.lower_bound, 1e-3);
  solver.options.max_iterations = 100;
  EXPECT_EQ(solver.solve(system, x).status, Status::Converged);
  EXPECT_TRUE(x.isApprox(system.anchors, 1e-12)) << x;
}

// If contradictory springs can rotate freely, the search mostly ends at a limit, as all directions are
// equivalent.
TEST(BranchAndBound, TakesComponentsThatNothingHolds) {
  for (std::uint64_t index = 0; index < 30; ++index) {
    auto [system, start] = testing::numbered_system<Plane>(Kind::Lit, Topology<>::full(4), index);
    system.anchor_stiffness.setZero();
    if (index % 2 == 0) system.rest_length[0] *= 3;  // otherwise the lengths are consistent
    BranchAndBound<Plane> solver;
    solver.options.gap = 1e-2;
    solver.options.hold_floating = true;
    solver.options.max_nodes = 200;
    Plane::Points x = start;
    const Summary summary = solver.solve(system, x);
    ASSERT_TRUE(summary.usable()) << summary;
    if (index % 2 == 1) {
      EXPECT_EQ(summary.status, Status::Converged);
    }
    system.fix(0);
    const double lowest = lowest_energy(system, start, 60, index);
    EXPECT_LE(summary.lower_bound, lowest * (1 + 1e-9) + 1e-9);
    if (summary.status == Status::Converged) {
      EXPECT_LE(summary.final_energy, lowest * 1.01 + 1e-9);
    }
  }
}

template <int kDim>
void expect_cells() {
  using Cell = detail::DirectionCell<kDim>;
  Rng rng(3);
  const auto holds = [](const Cell& cell, const Eigen::Matrix<double, kDim, 1>& d) {
    if (!(d[cell.axis] * cell.side > 0)) return false;
    const Eigen::Matrix<double, kDim, 1> on_face = d / std::abs(d[cell.axis]);
    for (int c = 0; c < kDim; ++c) {
      if (c != cell.axis && (on_face[c] < cell.low[c] || on_face[c] > cell.high[c])) return false;
    }
    return true;
  };
  for (int trial = 0; trial < 300; ++trial) {
    Eigen::Matrix<double, kDim, 1> d;
    for (double& coordinate : d) coordinate = rng.uniform(-1, 1);
    std::vector<Cell> cells = Cell::faces();
    for (int depth = 0; depth < 12; ++depth) {
      ASSERT_EQ(std::count_if(cells.begin(), cells.end(), [&](const Cell& cell) { return holds(cell, d); }),
                1);
      const Cell cell = *std::find_if(cells.begin(), cells.end(), [&](const Cell& c) { return holds(c, d); });
      EXPECT_LE(d.norm(), d.dot(cell.reach()));
      const auto halves = cell.halves();
      cells.assign(halves.begin(), halves.end());
    }
    EXPECT_LT(cells[0].reach().norm(), 1.1);
  }
}

TEST(DirectionCells, HoldEachDirectionOnceAndBoundItsLength) {
  expect_cells<2>();
  expect_cells<3>();
}

// The minoriser is below the energy at every placement whose link directions are in their cells.
TEST(ConeMinoriser, IsBelowTheEnergy) {
  Rng rng(4);
  using Cones = detail::ConeSystem<2>;
  using Cell = detail::DirectionCell<2>;
  for (std::uint64_t index = 0; index < 200; ++index) {
    const auto [system, y] = testing::numbered_system<Plane>(Kind::Lit, Topology<>::full(4), index);
    Cones cones;
    cones.system = &system;
    cones.shares.assign(6, 1);
    cones.reaches.assign(6, Cones::Point::Zero());
    for (std::size_t l = 0; l < 6; l += 2) {  // cells that contain the directions of y
      const Link& link = system.links()[l];
      const Eigen::Vector2d d = y.col(link.i) - y.col(link.j);
      for (Cell cell : Cell::faces()) {
        if (!(d[cell.axis] * cell.side > 0) || std::abs(d[1 - cell.axis]) > std::abs(d[cell.axis])) continue;
        for (int depth = 0; depth < 3; ++depth) {
          const auto halves = cell.halves();
          cell = d[1 - cell.axis] / std::abs(d[cell.axis]) <= halves[0].high[1 - cell.axis] ? halves[0]
                                                                                            : halves[1];
        }
        cones.reaches[l].head<2>() = cell.reach();
      }
      cones.shares[l] = rng.uniform(0, 1);
    }
    Cones::Points x(4, 4);
    for (double& coordinate : x.reshaped()) coordinate = rng.uniform(-60, 60);
    detail::Minoriser<Cones> quadratic;
    ASSERT_TRUE(quadratic.set(cones, x, 1 + 0.5 * rng.uniform(0, 1)));
    // q(y) = q(x) + g . (y - x) + 1/2 (y - x) W (y - x)
    Cones::Points step = -x;
    step.topRows<2>() += y;
    double value = quadratic.energy + quadratic.gradient.cwiseProduct(step).sum();
    quadratic.for_each_entry(
        cones, [&](int i, int, int, double w) { value += w / 2 * step.col(i).squaredNorm(); },
        [&](int, const Link& link, double w) { value -= w * step.col(link.i).dot(step.col(link.j)); });
    EXPECT_LE(value, energy(system, y) * (1 + 1e-9)) << index;
  }
}

}  // namespace
}  // namespace asterism
