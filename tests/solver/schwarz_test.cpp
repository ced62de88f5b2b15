// Alternating minimisation over subdomains of systems of terms: the partition of the nodes, and the minima it
// finds.
#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/solver/terms/from_springs.hpp>
#include <asterism/solver/terms/registry.hpp>
#include <asterism/system.hpp>
#include <asterism/testing/sparse_system.hpp>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <limits>
#include <ostream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "terms/partition.hpp"

namespace asterism {
namespace {

using Eigen::MatrixXd;
using testing::Rng;

struct Problem {
  System system;
  MatrixXd start;
};

// Nodes that are linked to their six nearest, on anchors.
template <int kDim = 2>
Problem linked_to_nearest(std::uint64_t seed, int n) {
  const auto [springs, start] = testing::sparse_system<SpringSystem<double, kDim>>(seed, n);
  return {to_system(springs), start};
}

MatrixXd random_points(Rng& rng, Eigen::Index dim, Eigen::Index n, double size) {
  MatrixXd x(dim, n);
  for (double& value : x.reshaped()) value = rng.uniform(-size, size);
  return x;
}

// A sheet of side x side nodes with all kinds of terms that are divided. The function of one's own is a
// spring to the place where its numbers say.
Problem mixture(std::uint64_t seed, int side) {
  Rng rng(seed);
  const int n = side * side;
  MatrixXd grid(2, n);
  for (int i = 0; i < n; ++i) grid.col(i) << i % side, i / side;
  Eigen::Matrix2Xi pairs(2, 0), diagonals(2, 0);
  Eigen::Matrix3Xi rows(3, 0), corners(3, 0);
  const auto add = [](auto& to, const auto& nodes) {
    to.conservativeResize(Eigen::NoChange, to.cols() + 1);
    to.col(to.cols() - 1) = nodes;
  };
  for (int i = 0; i < n; ++i) {
    const bool has_right = i % side + 1 < side, has_below = i + side < n;
    if (has_right) add(pairs, Eigen::Vector2i(i, i + 1));
    if (has_below) add(pairs, Eigen::Vector2i(i + side, i));
    if (has_right && has_below) add(diagonals, Eigen::Vector2i(i, i + side + 1));
    if (has_right && has_below) add(corners, Eigen::Vector3i(i, i + 1, i + side));
    if (i % side + 2 < side) add(rows, Eigen::Vector3i(i, i + 1, i + 2));
  }
  const auto all = [](double value) { return System::all(value); };
  System system(n, 2);
  system.add_anchors(grid + random_points(rng, 2, n, 0.2), all(0.05)).set_loss(Loss::Huber, 0.1);
  system.add_anchors(Eigen::RowVectorXi::LinSpaced(n / 9, 0, n - 9), MatrixXd::Zero(2, n / 9), all(0))
      .values("stiffness") = MatrixXd::Zero(1, n / 9);
  Eigen::VectorXd lengths(pairs.cols());
  for (double& length : lengths) length = rng.uniform(0.9, 1.1);
  system.add_links(pairs, lengths, all(1)).set_loss(Loss::GemanMcClure, 3);
  Links& ropes = system.add_links(diagonals, all(1.3), all(0.5));
  ropes.set_law(LinkLaw::Rope);
  system.add_offsets(pairs.leftCols(n / 2), offsets_at(grid, pairs.leftCols(n / 2)), all(0.3));
  system.add_differences(rows, all(0.2));
  system.add_angles(corners.leftCols(n / 3), all(1.5), all(0.1));
  system.add_areas(corners, all(0.5), all(0.1));
  system.add_loads(Eigen::RowVectorXi::LinSpaced(n, 0, n - 1), random_points(rng, 2, n, 0.02));
  Elements own(
      2, 1, 2,
      [](const MatrixXd& points, const MatrixXd& numbers, bool second, ElementValues& values) {
        values.gradient = 0.02 * (points - numbers);
        values.energy = 0.01 * (points - numbers).colwise().squaredNorm().transpose();
        if (second) values.second = Eigen::Vector4d(0.02, 0, 0, 0.02).replicate(1, points.cols());
      },
      true);
  own.set_nodes(Eigen::RowVectorXi::LinSpaced(n, 0, n - 1));
  own.values("numbers") = grid;
  system.add(std::move(own));
  for (int i = 0; i < n; i += 300) system.fix(i);
  return {std::move(system), grid + random_points(rng, 2, n, 0.3)};
}

Summary solve_by(std::string_view method, const Problem& problem, MatrixXd& x,
                 const std::vector<NamedOption>& options = {}) {
  x = problem.start;
  return system_solvers().make(method, options).solve(problem.system, x);
}

TEST(Partition, ConnectedSubdomainsOfTheSizeWanted) {
  constexpr int kNodes = 2025;
  const Problem problems[] = {linked_to_nearest(1, kNodes), mixture(1, 45)};
  for (const auto& [system, start] : problems) {
    // Which nodes are in an element together, from the terms themselves.
    std::vector<std::vector<int>> beside(kNodes);
    for (int t = 0; t < system.term_count(); ++t) {
      for (const auto element : system.term(t).nodes().colwise()) {
        for (const int i : element)
          beside[static_cast<std::size_t>(i)].insert(beside[static_cast<std::size_t>(i)].end(),
                                                     element.begin(), element.end());
      }
    }
    for (const int size : {1, 20, 100, 5000}) {
      const detail::Partition partition(detail::Incidence(system), size);
      detail::Indexed<int> sorted = partition.order;
      std::sort(sorted.begin(), sorted.end());
      for (int i = 0; i < kNodes; ++i) ASSERT_EQ(sorted[i], i);  // each node once
      EXPECT_EQ(partition.first.back(), kNodes);
      EXPECT_LE(partition.count(), 4 * kNodes / size + 1);
      detail::Indexed<int> owner(kNodes);
      for (int s = 0; s < partition.count(); ++s) {
        EXPECT_LT(partition.first[s], partition.first[s + 1]);
        for (int k = partition.first[s]; k < partition.first[s + 1]; ++k) owner[partition.order[k]] = s;
      }
      for (int s = 0; s < partition.count(); ++s) {
        detail::Indexed<int> reached = {partition.order[partition.first[s]]};
        detail::Indexed<char> seen(kNodes, false);
        seen[reached[0]] = true;
        for (std::size_t next = 0; next < reached.size(); ++next) {
          for (const int node : beside[static_cast<std::size_t>(reached[next])]) {
            if (owner[node] == s && !seen[node]) seen[node] = true, reached.push_back(node);
          }
        }
        EXPECT_EQ(static_cast<int>(reached.size()), partition.first[s + 1] - partition.first[s]);
      }
    }
  }
}

struct Case {
  const char* name;
  Problem (*make)(std::uint64_t seed, int nodes);
  const char* method;
};
std::ostream& operator<<(std::ostream& out, const Case& of) { return out << of.name << ' ' << of.method; }

Problem weakly_anchored(std::uint64_t seed, int n) {
  Problem problem = linked_to_nearest(seed, n);
  problem.system.term(0).values("stiffness") *= 1e-3;
  return problem;
}
Problem sheet(std::uint64_t seed, int n) { return mixture(seed, static_cast<int>(std::sqrt(n))); }

class Schwarz : public ::testing::TestWithParam<Case> {
 protected:
  Problem problem(std::uint64_t seed, int nodes) const { return GetParam().make(seed, nodes); }
  Summary solve(const Problem& problem, MatrixXd& x, const std::vector<NamedOption>& options = {}) const {
    return solve_by(GetParam().method, problem, x, options);
  }
};

const Case kCases[] = {{"plane", linked_to_nearest<2>, "schwarz"},
                       {"plane", linked_to_nearest<2>, "schwarz-direct"},
                       {"space", linked_to_nearest<3>, "schwarz"},
                       {"sheet", sheet, "schwarz"},
                       {"sheet", sheet, "schwarz-direct"},
                       {"weak anchors", weakly_anchored, "schwarz"},
                       {"weak anchors", weakly_anchored, "schwarz-direct"}};
INSTANTIATE_TEST_SUITE_P(Cases, Schwarz, ::testing::ValuesIn(kCases));

TEST_P(Schwarz, FindsNewtonsMinimumFromItsBasin) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    Problem near = problem(seed, 1600);
    MatrixXd minimum, x;
    const Summary newton = solve_by("newton", near, minimum);
    ASSERT_EQ(newton.status, Status::Converged) << newton;
    Rng rng(seed);
    near.start = minimum + random_points(rng, minimum.rows(), minimum.cols(), 0.003);
    for (int i = 0; i < near.system.nodes(); ++i) {
      if (near.system.is_fixed(i)) near.start.col(i) = minimum.col(i);
    }
    const Summary summary = solve(near, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_NEAR(summary.final_energy, newton.final_energy, 1e-8 * newton.final_energy);
    EXPECT_NEAR(summary.final_energy, energy(near.system, x), 1e-12 * summary.final_energy);
  }
}

TEST_P(Schwarz, ConvergesFromFarInFewSteps) {
  const Problem far = problem(4, 3000);
  MatrixXd x, all_at_once;
  const Summary summary = solve(far, x);
  EXPECT_EQ(summary.status, Status::Converged) << summary;
  EXPECT_LT(stationarity(far.system, x), 1.0001e-8);
  const Summary newton = solve_by("newton-cg", far, all_at_once);
  if (GetParam().make != sheet) {  // which Newton-CG solves in seven steps
    EXPECT_LT(summary.energy_evaluations, newton.energy_evaluations);
  }
  EXPECT_NEAR(summary.final_energy, newton.final_energy, 0.05 * newton.final_energy);
  for (int i = 0; i < far.system.nodes(); ++i) {
    if (far.system.is_fixed(i)) {
      EXPECT_EQ(x.col(i), far.start.col(i));
    }
  }
}

TEST_P(Schwarz, EnergyNeverRises) {
  const Problem far = problem(5, 1200);
  double last = std::numeric_limits<double>::max();
  for (int iterations = 0; iterations <= 20; ++iterations) {
    MatrixXd x;
    const Summary summary = solve(far, x, {{"max_iterations", iterations}});
    EXPECT_LE(summary.iterations, iterations);
    EXPECT_LE(summary.final_energy, last + 1e-12 * std::abs(last));
    last = std::min(last, summary.final_energy);
    if (summary.status == Status::Converged) break;
  }
}

TEST_P(Schwarz, AnyNumberOfThreadsGivesTheSameBits) {
  const Problem far = problem(8, 4000);
  MatrixXd alone, x;
  const Summary expected = solve(far, alone);
  for (const int threads : {2, 3, 0, 64}) {
    const Summary summary = solve(far, x, {{"threads", threads}});
    EXPECT_EQ(x, alone) << threads << " threads";
    EXPECT_EQ(summary.iterations, expected.iterations);
    EXPECT_EQ(summary.final_energy, expected.final_energy);
  }
}

TEST_P(Schwarz, IsObservedAtPointsOfTheSystem) {
  const Problem far = problem(2, 1200);
  AnySolver<System> solver = system_solvers().make(GetParam().method);
  int calls = 0, last = -1;
  auto observe = [&](const Iteration& at) {
    const MatrixXd x = at.x;
    EXPECT_NEAR(at.energy, energy(far.system, x), 1e-9 * std::abs(at.energy));
    EXPECT_GE(at.number, last);
    if (calls++ == 0) {
      EXPECT_EQ(at.number, 0);
      EXPECT_EQ(x, far.start);
    }
    last = at.number;
    return calls < 2;
  };
  solver.options().on_iteration = observe;
  static_cast<AlignedOptions&>(solver.options()).align = false;
  MatrixXd x = far.start;
  const Summary summary = solver.solve(far.system, x);
  EXPECT_EQ(summary.status, Status::Interrupted) << summary;
  EXPECT_EQ(calls, 2);
  EXPECT_LT(summary.final_energy, summary.initial_energy);
  EXPECT_NEAR(summary.final_energy, energy(far.system, x), 1e-9 * summary.final_energy);
}

const char* const kMethods[] = {"schwarz", "schwarz-direct"};

// Two separate constellations, nodes without links, fixed nodes, and one node that is linked to all others.
TEST(SchwarzTopologies, AreAnswered) {
  const auto solved = [](int n, const std::vector<Link>& links, bool fix) {
    for (const char* method : kMethods) {
      Rng rng(7);
      auto [springs, start] =
          testing::random_system<SpringSystem<double, 2>>(rng, Topology<>::from_links(n, links));
      springs.link_stiffness = springs.link_stiffness.cwiseMin(1e5);
      springs.anchor_stiffness.setConstant(1e3);
      if (fix) springs.fix(0), springs.fix(n - 1);
      const Problem problem{to_system(springs), start};
      MatrixXd x;
      const Summary summary = solve_by(method, problem, x);
      EXPECT_EQ(summary.status, Status::Converged) << summary;
      if (fix) {
        EXPECT_EQ(x.col(0), start.col(0));
        EXPECT_EQ(x.col(n - 1), start.col(n - 1));
      }
    }
  };
  solved(1, {}, false);
  solved(700, {}, true);
  std::vector<Link> chains;
  for (int i = 1; i < 900; ++i) {
    if (i != 400 && i != 401) chains.push_back({i, i - 1});
  }
  solved(900, chains, false);
  solved(900, chains, true);
  std::vector<Link> star;
  for (int i = 0; i < 800; ++i) {
    if (i != 500) star.push_back({i, 500});
  }
  solved(800, star, false);
  solved(800, star, true);
}

// A node that is linked to all others borders on every subdomain, but its neighbours must not be included in
// them: four times the nodes take about four times the work, not sixteen.
TEST(SchwarzTopologies, HubsCostNoMoreThanTheirLinks) {
  const auto work = [](int n) {
    System system(n, 2);
    MatrixXd grid(2, n);
    Eigen::Matrix2Xi pairs(2, 3 * n - 6);
    int l = 0;
    for (int i = 0; i < n; ++i) {
      grid.col(i) << i % 317, i / 317;
      if (i > 0) pairs.col(l++) << 0, i;
      if (i > 0 && i + 1 < n) pairs.col(l++) << i, i + 1;
      if (i > 0 && i + 2 < n) pairs.col(l++) << i, i + 2;
    }
    system.add_anchors(grid, System::all(0.1));
    system.add_links(pairs, 0.97 * lengths_at(grid, pairs), System::all(1));
    double evaluated = 0;  // links
    system.add_elements(
        pairs,
        [&evaluated](const MatrixXd& points, const MatrixXd&, bool second, ElementValues& values) {
          evaluated += static_cast<double>(points.cols());
          values.energy.setZero(points.cols());
          values.gradient.setZero(4, points.cols());
          if (second) values.second.setZero(16, points.cols());
        },
        true);
    MatrixXd x = grid;
    EXPECT_EQ(system_solvers().make("schwarz", {{"tolerance", 1e-6}}).solve(system, x).status,
              Status::Converged);
    return evaluated;
  };
  EXPECT_LT(work(20000), 8 * work(5000));
}

TEST(SchwarzMethods, TakeManyNodes) {
  const Problem problem = linked_to_nearest(1, 100000);
  MatrixXd x;
  const Summary summary = solve_by("schwarz", problem, x, {{"max_iterations", 2}});
  EXPECT_EQ(summary.status, Status::MaxIterations) << summary;
  EXPECT_LT(summary.final_energy, 0.1 * summary.initial_energy);
}

// A common length depends on all elements of its term.
TEST(SchwarzMethods, DoNotDivideACommonLength) {
  Problem problem = linked_to_nearest(3, 900);
  const Eigen::MatrixXi pairs = problem.system.term(1).nodes().leftCols(700);
  problem.system.add_common_length(pairs, System::all(2));
  for (const char* method : kMethods) {
    MatrixXd x, whole;
    const Summary summary = solve_by(method, problem, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_EQ(summary.solver, system_solvers().make(method).name());
    solve_by(method == kMethods[0] ? "newton-cg" : "newton", problem, whole);
    EXPECT_EQ(x, whole);
  }
}

TEST(SchwarzMethods, RefuseBadInput) {
  for (const char* method : kMethods) {
    Problem problem = linked_to_nearest(3, 20);
    EXPECT_THROW(system_solvers().make(method, {{"threads", -1}}), std::invalid_argument);
    Problem without_second = problem;
    without_second.system.add_elements(
        Eigen::RowVectorXi::Zero(1),
        [](const MatrixXd& points, const MatrixXd&, bool, ElementValues& values) {
          values.energy.setZero(points.cols());
          values.gradient.setZero(2, points.cols());
        },
        false);
    MatrixXd x;
    Summary summary = solve_by(method, without_second, x);
    EXPECT_EQ(summary.status, Status::InvalidInput);
    EXPECT_NE(std::string(summary.message).find("elements"), std::string::npos) << summary;
    EXPECT_EQ(x, problem.start);
    problem.system.term(1).values("stiffness")(0, 3) = -1;
    summary = solve_by(method, problem, x);
    EXPECT_EQ(summary.status, Status::InvalidInput);
    EXPECT_EQ(x, problem.start);
  }
}

// From whatever thread and subdomain.
TEST(SchwarzMethods, PassOnWhatAUsersFunctionThrowsAndStopWhenAsked) {
  for (const bool throws : {true, false}) {
    Problem problem = linked_to_nearest(3, 3000);
    std::atomic<bool> stop{false};
    std::atomic<int> calls{0};
    problem.system.add_elements(
        Eigen::RowVectorXi::LinSpaced(3000, 0, 2999),
        [&](const MatrixXd& points, const MatrixXd&, bool second, ElementValues& values) {
          if (++calls == 40) {
            if (throws) throw std::runtime_error("forty");
            stop = true;
          }
          values.energy.setZero(points.cols());
          values.gradient.setZero(2, points.cols());
          if (second) values.second.setZero(4, points.cols());
        },
        true);
    AnySolver<System> solver = system_solvers().make("schwarz", {{"threads", 2}});
    solver.options().stop = &stop;
    MatrixXd x = problem.start;
    if (throws) {
      EXPECT_THROW(solver.solve(problem.system, x), std::runtime_error);
      EXPECT_EQ(x, problem.start);
    } else {
      const Summary summary = solver.solve(problem.system, x);
      EXPECT_EQ(summary.status, Status::Interrupted) << summary;
      EXPECT_LT(calls, 1000);
      EXPECT_LE(summary.final_energy, summary.initial_energy);
    }
  }
}

}  // namespace
}  // namespace asterism
