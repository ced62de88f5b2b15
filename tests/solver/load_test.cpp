// Loads, constant forces on nodes: against moved anchors, statics by hand, finite differences, and each
// other.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <asterism/solver.hpp>
#include <asterism/solver/batch/batch_newton.hpp>
#include <asterism/solver/energy/sensitivity.hpp>
#include <asterism/testing/random_system.hpp>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>
#ifdef ASTERISM_TEST_CERES
#include <asterism/solver/reference/ceres.hpp>
#endif

#include "by_terms.hpp"
#include "matrices.hpp"

namespace asterism {
namespace {

using testing::random_points;
using testing::Rng;

template <int Dim>
using System = SpringSystem<double, Dim>;

template <int Dim>
testing::RandomSystem<System<Dim>> random_loads(std::uint64_t seed, int nodes) {
  Rng rng(seed);
  System<Dim> system(Topology<>::full(nodes));
  system.anchors = random_points<System<Dim>>(rng, nodes, -10, 10);
  system.set_rest_lengths(system.anchors);
  for (int l = 0; l < system.link_count(); ++l) system.link_stiffness[l] = rng.uniform(0.2, 2);
  for (int i = 0; i < nodes; ++i) system.anchor_stiffness[i] = rng.uniform(0.5, 2);
  system.loads = random_points<System<Dim>>(rng, nodes, -3, 3);
  return {system, system.anchors};
}

// A chain of unit links between two fixed ends at distance `span`, every node of which weighs 1.
System<2> chain(int nodes, double span, double stiffness) {
  std::vector<Link> links;
  for (int i = 0; i + 1 < nodes; ++i) links.push_back({i, i + 1});
  System<2> system(Topology<>::from_links(nodes, links));
  system.anchors.setZero();
  for (int i = 0; i < nodes; ++i) system.anchors(0, i) = span * i / (nodes - 1);
  system.anchor_stiffness.setZero();
  system.rest_length.setOnes();
  system.link_stiffness.setConstant(stiffness);
  system.loads.setZero(2, nodes);
  system.loads.row(1).setConstant(1);
  system.fix(0);
  system.fix(nodes - 1);
  return system;
}

// A cloth of n x n nodes with diagonals, held by the fixed nodes of its first row.
System<3> cloth(int n) {
  std::vector<Link> links;
  const auto at = [n](int row, int column) { return row * n + column; };
  for (int r = 0; r < n; ++r) {
    for (int c = 0; c < n; ++c) {
      if (c + 1 < n) links.push_back({at(r, c), at(r, c + 1)});
      if (r + 1 < n) links.push_back({at(r, c), at(r + 1, c)});
      if (r + 1 < n && c + 1 < n) links.push_back({at(r, c), at(r + 1, c + 1)});
      if (r + 1 < n && c > 0) links.push_back({at(r, c), at(r + 1, c - 1)});
    }
  }
  System<3> system(Topology<>::from_links(n * n, links));
  for (int i = 0; i < n * n; ++i) system.anchors.col(i) << i % n, i / n, 0.1 * std::sin(i);
  system.set_rest_lengths(system.anchors);
  system.anchor_stiffness.setZero();
  system.link_stiffness.setConstant(500);
  system.loads.setZero(3, n * n);
  system.loads.row(2).setConstant(-1);
  for (int c = 0; c < n; ++c) system.fix(c);
  return system;
}

TEST(Loads, EnergyIsThatOfTheSpringsLessTheirWork) {
  const auto [system, start] = random_loads<3>(1, 6);
  System<3> springs = system;
  springs.loads.resize(3, 0);
  EXPECT_NEAR(energy(system, start), energy(springs, start) - system.loads.cwiseProduct(start).sum(), 1e-12);
  EXPECT_LT((gradient(springs, start) - gradient(system, start) - system.loads).norm(), 1e-12);
  EXPECT_EQ(hessian(system, start), hessian(springs, start));
}

// A loaded node with an anchor is a node whose anchor is f / k farther off.
template <int Dim>
void expect_every_solver_to_find_the_minimum_of_moved_anchors() {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const auto [system, start] = random_loads<Dim>(seed, 6);
    System<Dim> moved = system;
    moved.loads.resize(Dim, 0);
    for (int i = 0; i < system.nodes(); ++i)
      moved.anchors.col(i) += system.loads.col(i) / system.anchor_stiffness[i];
    auto expected = start;
    ASSERT_EQ(solve(moved, expected).status, Status::Converged);
    SolverRegistry<System<Dim>> registry = solver_registry<System<Dim>>();
    for (const auto& name : registry.names()) {
      auto x = start;
      const Summary summary = registry.make(name).solve(system, x);
      if (name == "staircase" || name == "branch-and-bound") {
        EXPECT_EQ(summary.status, Status::InvalidInput) << name;
        EXPECT_EQ(summary.message, name == "staircase" ? "loads: their energy has no lower bound"
                                                       : "the method does not support loads");
        EXPECT_EQ(x, start) << name;
        continue;
      }
      const bool by_differences = name == "ncg-forward" || name == "ncg-central";
      if (!by_differences) {
        EXPECT_EQ(summary.status, Status::Converged) << name << ": " << summary;
      }
      EXPECT_LT((x - expected).cwiseAbs().maxCoeff(), by_differences ? 1e-3 : 1e-5) << name << " " << seed;
    }
    auto x = start;
    const Summary global = solve_global(system, x);
    EXPECT_EQ(global.status, Status::Converged);
    EXPECT_LT((x - expected).cwiseAbs().maxCoeff(), 1e-5);
  }
}

TEST(Loads, OnAnchoredNodesMoveTheirAnchors) {
  expect_every_solver_to_find_the_minimum_of_moved_anchors<2>();
  expect_every_solver_to_find_the_minimum_of_moved_anchors<3>();
}

TEST(Loads, PullAPendulumStraightAndHoldItThere) {
  System<2> system(Topology<>::full(2));
  system.anchors << 3, 4, 5, 5;
  system.anchor_stiffness.setZero();
  system.rest_length << 2;
  system.link_stiffness << 10;
  system.fix(0);
  auto x = system.anchors;
  Newton<System<2>> newton;
  newton.solve(system, x);
  EXPECT_EQ(covariance(system, x).status, CovarianceStatus::NotPositiveDefinite);  // turns about node 0
  system.loads = Eigen::Matrix2d{{0, 3}, {0, 4}};
  const Summary summary = newton.solve(system, x);
  EXPECT_EQ(summary.status, Status::Converged) << summary;
  EXPECT_EQ(summary.positive_definite, true);
  const Eigen::Vector2d expected = Eigen::Vector2d(3, 5) + (2 + 5.0 / 10) * Eigen::Vector2d(0.6, 0.8);
  EXPECT_LT((x.col(1) - expected).norm(), 1e-7);
  EXPECT_EQ(certify(system, x).proof, Proof::UniqueGlobalMinimum);
  EXPECT_EQ(covariance(system, x).status, CovarianceStatus::Computed);
  // Upside down it is stationary too, and no minimum.
  x.col(1) = Eigen::Vector2d(3, 5) - (2 - 5.0 / 10) * Eigen::Vector2d(0.6, 0.8);
  EXPECT_LT(stationarity(system, x), 1e-12);
  EXPECT_EQ(certify(system, x).proof, Proof::NotCertified);
}

// In space, what hangs from one point by its weight still turns about the vertical.
TEST(Loads, LeaveFreeWhatTurnsAboutThem) {
  System<3> system(Topology<>::full(3));
  system.anchors << 0, 1, -1, 0, 0, 0, 0, -3, -3;
  system.anchor_stiffness.setZero();
  system.set_rest_lengths(system.anchors);
  system.link_stiffness.setConstant(10);
  system.fix(0);
  system.loads.setZero(3, 3);
  system.loads.row(2).setConstant(-1);
  auto x = system.anchors;
  ASSERT_EQ(Newton<System<3>>().solve(system, x).status, Status::Converged);
  EXPECT_EQ(covariance(system, x).status, CovarianceStatus::NotPositiveDefinite);
  system.loads.col(1) << 1, 0.5, -1;  // another direction: held
  ASSERT_EQ(Newton<System<3>>().solve(system, x).status, Status::Converged);
  EXPECT_EQ(covariance(system, x).status, CovarianceStatus::Computed);
}

// The forces at each node cancel, and the horizontal pull is the same in all links.
TEST(Loads, HangAChain) {
  for (const auto& name : solver_registry<System<2>>().names()) {
    if (name == "staircase" || name == "branch-and-bound") continue;
    const bool by_differences = name == "ncg-forward" || name == "ncg-central";
    const System<2> system = chain(12, 10, 50);
    auto x = system.anchors;
    AnySolver<System<2>> solver = make_solver<System<2>>(name);
    solver.options().max_iterations = 100000;
    const Summary summary = solver.solve(system, x);
    if (!by_differences) {
      EXPECT_EQ(summary.status, Status::Converged) << name << ": " << summary;
    }
    double horizontal = 0;
    for (int i = 1; i + 1 < system.nodes(); ++i) {
      const auto pull = [&](int j) -> Eigen::Vector2d {
        const Eigen::Vector2d d = x.col(j) - x.col(i);
        return 50 * (d.norm() - 1) * d.normalized();
      };
      EXPECT_LT((pull(i - 1) + pull(i + 1) + Eigen::Vector2d(0, 1)).norm(), by_differences ? 1e-2 : 1e-5)
          << name;
      if (i > 1) {
        EXPECT_NEAR(pull(i + 1).x(), horizontal, by_differences ? 1e-2 : 1e-5) << name;
      }
      horizontal = pull(i + 1).x();
    }
    // All links are taut, which proves the minimum.
    EXPECT_EQ(certify(system, x, {.gap = 1e-4}).proof, Proof::UniqueGlobalMinimum) << name;
  }
}

TEST(Loads, HangTheSameFarFromTheOrigin) {
  System<2> system = chain(9, 7, 50);
  auto x = system.anchors;
  ASSERT_EQ(solve(system, x).status, Status::Converged);
  auto far = system;
  const Eigen::Vector2d shift(1e4, -3e4);
  far.anchors.colwise() += shift;
  for (const char* name : {"ida", "newton", "newton-cg", "newton-sparse", "lbfgs", "ncg", "auto"}) {
    auto y = far.anchors;
    AnySolver<System<2>> solver = make_solver<System<2>>(name);
    solver.options().max_iterations = 100000;
    const Summary summary = solver.solve(far, y);
    EXPECT_TRUE(summary.usable()) << name;
    EXPECT_LT(((y.colwise() - shift) - x).cwiseAbs().maxCoeff(), 1e-3) << name << ": " << summary;
  }
}

TEST(Loads, HangAClothByEveryLargeMethod) {
  const System<3> system = cloth(14);
  auto expected = system.anchors;
  const Summary direct = testing::SparseNewton<System<3>>().solve(system, expected);
  ASSERT_EQ(direct.status, Status::Converged) << direct;
  for (const char* name : {"newton-cg", "lbfgs", "schwarz", "schwarz-direct", "auto"}) {
    auto x = system.anchors;
    AnySolver<System<3>> solver = make_solver<System<3>>(name);
    solver.options().max_iterations = 100000;
    const Summary summary = solver.solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << name << ": " << summary;
    EXPECT_NEAR(summary.final_energy, direct.final_energy, 1e-3 * std::abs(direct.final_energy)) << name;
  }
  // Float has the same minimum.
  const auto narrow = system.cast<float>();
  SpringSystem<float, 3>::Points x = system.anchors.cast<float>();
  const Summary summary = testing::SparseNewton<SpringSystem<float, 3>>().solve(narrow, x);
  EXPECT_TRUE(summary.usable()) << summary;
  EXPECT_NEAR(summary.final_energy, direct.final_energy, 1e-3 * std::abs(direct.final_energy));
}

// With offsets alone the energy is a quadratic.
TEST(Loads, AndOffsetsAreOneLinearSystem) {
  auto [system, start] = random_loads<2>(4, 8);
  Rng rng(9);
  system.set_rest_offsets(random_points<System<2>>(rng, 8, -10, 10));
  Eigen::MatrixXd K = Eigen::MatrixXd(system.anchor_stiffness.asDiagonal());
  Eigen::MatrixXd right = K * system.anchors.transpose() + system.loads.transpose();
  for (int l = 0; l < system.link_count(); ++l) {
    const Link link = system.links()[static_cast<std::size_t>(l)];
    Eigen::VectorXd row = Eigen::VectorXd::Zero(8);
    row[link.i] = 1, row[link.j] = -1;
    K += system.link_stiffness[l] * row * row.transpose();
    right += system.link_stiffness[l] * row * system.rest_offset.col(l).transpose();
  }
  const Eigen::MatrixXd expected = testing::solve_definite(K, right).transpose();
  auto x = start;
  EXPECT_EQ(Newton<System<2>>().solve(system, x).iterations, 1);
  EXPECT_LT((x - expected).norm(), 1e-9);
  x = start;
  EXPECT_EQ(Ida<System<2>>().solve(system, x).iterations, 1);
  EXPECT_LT((x - expected).norm(), 1e-9);
}

// No certificate's bound is above the lowest energy that many starts find.
TEST(Loads, BoundsHold) {
  int certified = 0, bounded = 0, several = 0;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    auto [system, start] = random_loads<2>(seed, 4);
    Rng rng(seed + 1000);
    system.anchor_stiffness *= 0.05;
    system.loads *= 2;
    double lowest = std::numeric_limits<double>::infinity(), highest = -lowest;
    std::vector<Certificate> certificates;
    for (int trial = 0; trial < 60; ++trial) {
      System<2>::Points x = start + random_points<System<2>>(rng, 4, -20, 20);
      const Summary summary = solve(system, x);
      if (!summary.usable()) continue;
      lowest = std::min(lowest, summary.final_energy);
      highest = std::max(highest, summary.final_energy);
      certificates.push_back(certify(system, x));
      certificates.push_back(certify(system, start + random_points<System<2>>(rng, 4, -20, 20)));
    }
    for (const Certificate& certificate : certificates) {
      certified += certificate.certified();
      bounded += std::isfinite(certificate.lower_bound);
      EXPECT_LE(certificate.lower_bound, certificate.energy);
      EXPECT_LE(certificate.lower_bound, lowest + 1e-9 * std::abs(lowest)) << seed;
      if (certificate.certified()) {
        EXPECT_LE(certificate.energy, lowest + 1e-5 * (highest - lowest + 100));
      }
    }
    several += highest > lowest + 1e-3 * std::abs(lowest);
  }
  EXPECT_GT(certified, 500);
  EXPECT_GT(bounded, certified);
  EXPECT_GT(several, 10);
}

// What is proven of a placement does not depend on where the origin is: a placement that is far above the
// least energy, known from the solution near the origin, is certified nowhere, and the solution everywhere.
TEST(Loads, CertifyTheSameFarFromTheOrigin) {
  System<2> system(Topology<>::full(3));
  system.anchors.resize(2, 3);
  system.anchors << 0, 10, 5, 0, 0, 8.66;
  system.anchor_stiffness.setOnes();
  system.set_rest_lengths(system.anchors);
  system.link_stiffness.setOnes();
  system.loads = System<2>::Points{{0.5, 0, -1}, {-3, -2, -3}};
  System<2>::Points x = system.anchors;
  ASSERT_EQ((Newton<System<2>>().solve(system, x).status), Status::Converged);
  System<2>::Points above = x;
  above.row(0).array() += 3;
  above(1, 2) -= 2;
  ASSERT_GT(energy(system, above), energy(system, x) + 10);
  for (const double distance : {0., 1e4, 1e6, 1e8}) {
    System<2> moved = system;
    moved.anchors.array() += distance;
    EXPECT_TRUE(certify(moved, System<2>::Points(x.array() + distance)).certified()) << distance;
    EXPECT_EQ(certify(moved, System<2>::Points(above.array() + distance)).proof, Proof::NotCertified)
        << distance;
  }
}

TEST(Loads, HaveDerivatives) {
  auto [system, start] = random_loads<2>(7, 5);
  auto x = start;
  Newton<System<2>> newton;
  newton.options.tolerance = 1e-13;
  ASSERT_EQ(newton.solve(system, x).status, Status::Converged);
  Rng rng(3);
  const System<2>::Points grad_x = random_points<System<2>>(rng, 5, -1, 1);
  const auto gradient = sensitivity(system, x, grad_x);
  ASSERT_EQ(gradient.status, SensitivityStatus::Computed) << gradient.message;
  for (int i = 0; i < 5; ++i) {
    for (int d = 0; d < 2; ++d) {
      const double h = 1e-5;
      const auto at = [&, &given = system, &from = x](double t) {
        System<2> changed = given;
        changed.loads(d, i) += t;
        auto y = from;
        newton.solve(changed, y);
        return grad_x.cwiseProduct(y).sum();
      };
      EXPECT_NEAR(gradient.loads(d, i), (at(h) - at(-h)) / (2 * h), 1e-7);
    }
  }
  SystemTangent<System<2>> tangent(system);
  tangent.loads = random_points<System<2>>(rng, 5, -1, 1);
  const auto moved = solution_tangent(system, x, tangent);
  ASSERT_EQ(moved.status, SensitivityStatus::Computed);
  EXPECT_NEAR(grad_x.cwiseProduct(moved.x).sum(), gradient.dot(tangent), 1e-10);
  tangent.loads.resize(2, 0);
  EXPECT_EQ(solution_tangent(system, x, tangent).status, SensitivityStatus::InvalidInput);
}

TEST(Loads, AreRefusedByWhatCannotTakeThem) {
  auto [system, start] = random_loads<2>(1, 4);
  SpringBatch<double, 2> batch(Topology<>::full(4), 2);
  batch.set(0, system, start);
  System<2> springs = system;
  springs.loads.resize(2, 0);
  batch.set(1, springs, start);
  BatchNewton<SpringBatch<double, 2>>().solve(batch);
  EXPECT_EQ(batch.status(0), Status::InvalidInput);
  EXPECT_EQ(batch.status(1), Status::Converged);
  auto x = start;
#ifdef ASTERISM_TEST_CERES
  EXPECT_EQ(reference::Ceres<System<2>>().solve(system, x).status, Status::InvalidInput);
#endif
  Newton<System<2>> newton;
  newton.options.gap = 1e-6;
  const Summary summary = newton.solve(system, x);
  EXPECT_EQ(summary.status, Status::InvalidInput);
  EXPECT_EQ(std::string_view(summary.message).substr(0, 10), "option gap");
  EXPECT_EQ(rigid_alignment(system, System<2>::Points(start.array() + 1)),
            System<2>::Points(start.array() + 1));
}

TEST(Loads, AreValidated) {
  auto [system, start] = random_loads<2>(1, 4);
  const auto says = [&system = system, &start = start](const char* expected) {
    auto x = start;
    Newton<System<2>> newton;
    newton.options.hold_floating = true;
    const Summary summary = newton.solve(system, x);
    EXPECT_EQ(summary.status, Status::InvalidInput);
    EXPECT_EQ(std::string_view(summary.message), expected);
    EXPECT_EQ(x, start);
  };
  system.loads(1, 3) = std::numeric_limits<double>::quiet_NaN();
  says("load 3 is not finite");
  system.loads.resize(2, 3);
  says("loads must have one column for each node, or none");
  system.loads.setZero(2, 4);
  system.loads(0, 2) = 1;
  system.anchor_stiffness.setZero();
  constexpr auto kFloats = "node 2 has a load and is in a connected component that nothing holds";
  says(kFloats);
  const Certificate certificate = certify(system, start);
  EXPECT_EQ(certificate.proof, Proof::NotApplicable);
  EXPECT_EQ(std::string_view(certificate.reason), kFloats);
  EXPECT_EQ(certificate.lower_bound, -std::numeric_limits<double>::infinity());
}

// One node at the origin has no length but that to which its load pulls it.
TEST(Loads, MoveASingleNode) {
  System<2> system(Topology<>::full(1));
  system.anchors.setZero();
  system.anchor_stiffness.setConstant(4);
  system.loads.setZero(2, 1);
  system.loads(0, 0) = 2;
  auto x = system.anchors;
  EXPECT_EQ(solve(system, x).status, Status::Converged);
  EXPECT_NEAR(x(0), 0.5, 1e-9);
}

// An anchor that lets go leaves an energy without a minimum: no NaN, and no claim.
TEST(Loads, ThatAnAnchorCannotHoldEndInAStatus) {
  using Loose = SpringSystem<double, 2, Eigen::Dynamic, Eigen::Dynamic, Model<Hooke, GemanMcClure>>;
  Loose system(Topology<>::full(3));
  system.anchors << 0, 3, 0, 0, 0, 4;
  system.anchor_stiffness.setOnes();
  system.anchor_loss.scale = 1;
  system.set_rest_lengths(system.anchors);
  system.link_stiffness.setOnes();
  system.loads.setConstant(2, 3, 50);
  const auto expect_no_claim = [&system](auto solver) {
    auto x = system.anchors;
    const Summary summary = solver.solve(system, x);
    EXPECT_TRUE(x.allFinite()) << summary;
    EXPECT_NE(summary.status, Status::Converged) << summary;
  };
  expect_no_claim(Newton<Loose>());
  expect_no_claim(Ida<Loose>());
  expect_no_claim(Lbfgs<Loose>());
}

}  // namespace
}  // namespace asterism
