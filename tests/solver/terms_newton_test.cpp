// Newton's method for large systems of terms: weak anchors, floppy systems, its options; and what "auto"
// chooses.
#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/solver/terms/from_springs.hpp>
#include <asterism/solver/terms/registry.hpp>
#include <asterism/system.hpp>
#include <asterism/testing/sparse_system.hpp>
#include <cmath>
#include <complex>
#include <cstdint>
#include <ostream>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "matrices.hpp"

namespace asterism {
namespace {

using Eigen::MatrixXd;

struct Problem {
  System system;
  MatrixXd start;
};

// Nodes that are linked to their six nearest.
Problem linked_to_nearest(std::uint64_t seed, int n, double weakness) {
  const auto [springs, start] = testing::sparse_system<SpringSystem<double, 2>>(seed, n);
  Problem problem{to_system(springs), start};
  problem.system.term(0).values("stiffness") *= weakness;
  return problem;
}

// A sheet of side x side nodes in space, linked to their four neighbours at distance 1, on anchors of `share`
// of the links' stiffness that lie on the sheet scaled by `extent`.
Problem cloth(int side, double share, double extent) {
  const int n = side * side;
  MatrixXd grid = MatrixXd::Zero(3, n);
  Eigen::Matrix2Xi pairs(2, 2 * side * (side - 1));
  for (int i = 0, l = 0; i < n; ++i) {
    grid.col(i) << i % side, i / side, 0;
    if (i % side > 0) pairs.col(l++) << i - 1, i;
    if (i >= side) pairs.col(l++) << i - side, i;
  }
  testing::Rng rng(1);
  const auto displaced = [&](double scale) {
    MatrixXd x = scale * grid;
    for (double& value : x.reshaped()) value += rng.uniform(-0.3, 0.3);
    return x;
  };
  System system(n, 3);
  system.add_anchors(displaced(extent), System::all(share));
  system.add_links(pairs, System::all(1), System::all(1));
  return {std::move(system), displaced(1)};
}

// The same, but only the corners are held.
Problem held_at_corners(int side) {
  Problem problem = cloth(side, 0, 1);
  MatrixXd& stiffness = problem.system.term(0).values("stiffness");
  stiffness = MatrixXd::Zero(1, side * side);
  for (const int corner : {0, side - 1, side * (side - 1), side * side - 1}) stiffness(0, corner) = 10;
  return problem;
}

// A path of steps of length 1 whose odometry drifts, with ranges to three fixed nodes, of which some are
// wrong; the start is what the odometry says.
Problem path_from_ranges(std::uint64_t seed, int steps) {
  using Complex = std::complex<double>;
  testing::Rng rng(seed);
  std::vector<Complex> truth{0}, start{0}, turns;
  Complex heading = 1, believed = 1;
  for (int k = 1; k < steps; ++k) {
    truth.push_back(truth.back() + heading);
    start.push_back(start.back() + believed);
    const double turn = 0.3 * rng.uniform(-1, 1) + 0.02;
    turns.push_back(std::polar(1.0, turn + 0.01 * rng.uniform(-1, 1) + 0.004));
    heading *= std::polar(1.0, turn);
    believed *= turns.back();
  }
  const std::vector<Complex> beacons{{20, 0}, {-10, 30}, {5, -25}};
  Problem problem{System(steps + 3, 2), MatrixXd(2, steps + 3)};
  const auto place = [&](int node, Complex z) { problem.start.col(node) << z.real(), z.imag(); };
  for (int k = 0; k < steps; ++k) place(k, start[static_cast<std::size_t>(k)]);
  for (int b = 0; b < 3; ++b) {
    place(steps + b, beacons[static_cast<std::size_t>(b)]);
    problem.system.fix(steps + b);
  }
  // p_(k+2) - p_(k+1) = q (p_(k+1) - p_k), q the turn.
  Eigen::Matrix3Xi triples(3, steps - 2);
  MatrixXd a(4, steps - 2), b(4, steps - 2), c(4, steps - 2);
  const auto matrix = [](Complex z) { return Eigen::Vector4d(z.real(), z.imag(), -z.imag(), z.real()); };
  for (int k = 0; k < steps - 2; ++k) {
    const Complex q = turns[static_cast<std::size_t>(k)];
    triples.col(k) << k, k + 1, k + 2;
    a.col(k) = matrix(q);
    b.col(k) = matrix(-1.0 - q);
    c.col(k) = matrix(1.0);
  }
  Term& differences = problem.system.add_differences(triples, System::all(1e4));
  differences.values("a") = a;
  differences.values("b") = b;
  differences.values("c") = c;
  Eigen::Matrix2Xi ranges(2, steps);
  Eigen::VectorXd lengths(steps);
  for (int k = 0; k < steps; ++k) {
    const int beacon = k % 3;
    const double wrong = k % 10 == 0 ? 5 * rng.uniform(0, 1) : 0.1 * rng.uniform(-1, 1);
    ranges.col(k) << k, steps + beacon;
    lengths[k] =
        std::abs(truth[static_cast<std::size_t>(k)] - beacons[static_cast<std::size_t>(beacon)]) + wrong;
  }
  problem.system.add_links(ranges, lengths, System::all(100)).set_loss(Loss::GemanMcClure, 0.5);
  return problem;
}

Summary solve_by(std::string_view method, const Problem& problem, MatrixXd& x,
                 const std::vector<NamedOption>& options = {}) {
  x = problem.start;
  return system_solvers().make(method, options).solve(problem.system, x);
}

// By the definition, with the Hessian of all terms. Negative curvature of less than 1e-9 of the stiffness may
// be rounding's, and of less than ten times the tolerance that of a minimum nearby.
void expect_minimum(const Problem& problem, const MatrixXd& x, const Summary& summary, double tolerance) {
  EXPECT_EQ(summary.status, Status::Converged) << summary;
  EXPECT_LE(stationarity(problem.system, x), 1.0001 * tolerance);
  const double least = testing::eigenvalues(hessian(problem.system, x, Curvature::True))[0];
  EXPECT_GT(least, -std::max(1e-9, 10 * tolerance) * node_stiffness(problem.system, x).maxCoeff());
  if (summary.positive_definite.has_value()) {
    EXPECT_EQ(summary.positive_definite, least > 0);
  }
}

struct Cloth {
  double share, extent;
};
std::ostream& operator<<(std::ostream& out, const Cloth& of) { return out << of.share << ' ' << of.extent; }
class Cloths : public ::testing::TestWithParam<Cloth> {};
INSTANTIATE_TEST_SUITE_P(Shapes, Cloths,
                         ::testing::Values(Cloth{1e-4, 0.8}, Cloth{1e-4, 1}, Cloth{1e-4, 1.2},
                                           Cloth{1e-8, 0.8}, Cloth{1e-8, 1}, Cloth{1e-8, 1.2}));

TEST_P(Cloths, OnWeakAnchorsTakeFewSteps) {
  Problem problem = cloth(16, GetParam().share, GetParam().extent);
  const auto takes_few_steps = [&problem] {
    MatrixXd x;
    const Summary summary = solve_by("newton", problem, x, {{"tolerance", 1e-12}, {"max_iterations", 120}});
    if (summary.status != Status::Converged) return false;
    expect_minimum(problem, x, summary, 1e-12);
    EXPECT_LE(summary.factorizations, 120);
    return true;
  };
  // Where weak anchors crumple a cloth, rounding decides which folds it takes, and how long that takes: some
  // of twelve starts next to each other are to take few steps, and elsewhere the first one.
  const int starts = GetParam().extent < 1 ? 12 : 1;
  testing::Rng rng(2);
  bool any = false;
  for (int start = 0; start < starts && !any; ++start) {
    any = takes_few_steps();
    for (double& value : problem.start.reshaped()) value += rng.uniform(-1e-13, 1e-13);
  }
  EXPECT_TRUE(any);
}

TEST(TermsNewton, WeakAnchorsTakeFewSteps) {
  for (const double weakness : {1e-2, 1e-4, 1e-6}) {
    const Problem problem = linked_to_nearest(2, 200, weakness);
    MatrixXd x;
    const Summary summary = solve_by("newton", problem, x);
    expect_minimum(problem, x, summary, 1e-8);
    EXPECT_LT(summary.iterations, 60) << weakness;
  }
}

TEST(TermsNewton, EnergyNeverRisesWithoutContinuation) {
  const Problem problem = linked_to_nearest(1, 300, 1e-3);
  double last = energy(problem.system, problem.start);
  for (int iterations = 0; iterations <= 60; ++iterations) {
    MatrixXd x;
    const Summary summary =
        solve_by("newton", problem, x, {{"max_iterations", iterations}, {"continuation", false}});
    EXPECT_LE(summary.iterations, iterations);
    EXPECT_LE(summary.final_energy, last * (1 + 1e-12));
    last = summary.final_energy;
    const Summary continued = solve_by("newton", problem, x, {{"max_iterations", iterations}});
    EXPECT_LE(continued.iterations, iterations);
    EXPECT_LE(continued.final_energy, continued.initial_energy);
    if (summary.status == Status::Converged) return;
  }
  ADD_FAILURE() << "not converged";
}

// Nodes in a row between two fixed ones, with links that are too long for it: the row is a saddle.
TEST(TermsNewton, LeavesSaddlesIfAsked) {
  for (const int n : {3, 60}) {
    Problem row{System(n, 2), MatrixXd::Zero(2, n)};
    row.start.row(0).setLinSpaced(0, n - 1);
    Eigen::Matrix2Xi pairs(2, n - 1);
    for (int i = 1; i < n; ++i) pairs.col(i - 1) << i - 1, i;
    row.system.add_links(pairs, System::all(1.5), System::all(1));
    row.system.fix(0);
    row.system.fix(n - 1);
    MatrixXd x;
    const Summary stays = solve_by("newton", row, x, {{"escape_saddles", false}});
    EXPECT_EQ(stays.status, Status::Converged);
    EXPECT_EQ(stays.positive_definite, false);
    EXPECT_EQ(x, row.start);
    const Summary leaves = solve_by("newton", row, x);
    EXPECT_LT(leaves.final_energy, 0.5 * stays.final_energy) << leaves;
  }
}

// A factorisation is cheaper there than an evaluation or two, and turns of L-BFGS would take thousands of
// them.
TEST(TermsNewton, FactorsAPathRatherThanCreepsAlongIt) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    const Problem problem = path_from_ranges(seed, 400);
    MatrixXd x;
    const Summary summary = solve_by("newton", problem, x);
    expect_minimum(problem, x, summary, 1e-8);
    EXPECT_LT(summary.gradient_evaluations, 500) << summary;
  }
}

// Conjugate gradients take thousands of iterations for a sheet that is free to shear.
TEST(TermsAuto, SolvesASheetThatIsHeldAtItsCorners) {
  constexpr double kTolerance = 1e-8;
  for (const int side : {12, 20}) {
    const Problem problem = held_at_corners(side);
    MatrixXd x;
    expect_minimum(problem, x, solve_by("auto", problem, x, {{"max_iterations", 150}}), kTolerance);
  }
}

TEST(TermsAuto, TakesTheMethodForTheSizeAndTheAnchors) {
  const auto chosen = [](const Problem& problem) {
    MatrixXd x;
    return std::string(solve_by("auto", problem, x, {{"max_iterations", 0}}).solver);
  };
  const auto name_of = [](const char* method) { return std::string(system_solvers().make(method).name()); };
  EXPECT_EQ(chosen(linked_to_nearest(1, 30, 1)), name_of("newton"));
  EXPECT_EQ(chosen(linked_to_nearest(1, 900, 1)), name_of("newton-cg"));
  EXPECT_EQ(chosen(linked_to_nearest(1, 1100, 1)), name_of("schwarz"));
  EXPECT_EQ(chosen(linked_to_nearest(1, 1100, 1e-5)), name_of("newton-cg"));
  EXPECT_EQ(chosen(linked_to_nearest(1, 31000, 1)), name_of("schwarz"));
  EXPECT_EQ(chosen(linked_to_nearest(1, 31000, 1e-5)), name_of("schwarz-direct"));
  EXPECT_EQ(chosen(cloth(36, 1e-3, 1)), name_of("newton"));
  EXPECT_EQ(chosen(cloth(36, 1, 1)), name_of("schwarz"));
  EXPECT_EQ(chosen(held_at_corners(36)), name_of("newton"));
  EXPECT_EQ(chosen(held_at_corners(20)), name_of("newton"));
  EXPECT_EQ(chosen(path_from_ranges(1, 400)), name_of("newton"));
  Problem dense = linked_to_nearest(1, 1100, 1);
  dense.system.add_links(all_pairs(1100), System::all(1), System::all(1e-9));
  EXPECT_EQ(chosen(dense), name_of("lbfgs"));
}

}  // namespace
}  // namespace asterism
