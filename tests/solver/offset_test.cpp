// Links with an offset, m_ij: against a linear system, finite differences, and each other.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <asterism/solver.hpp>
#include <asterism/solver/batch/batch_newton.hpp>
#include <asterism/solver/terms/from_springs.hpp>
#include <asterism/testing/random_system.hpp>
#include <asterism/testing/sparse_system.hpp>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
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

/// All links want the offsets of a random shape, or, of a share of them, a length from the end of half the
/// offset.
template <int Dim>
testing::RandomSystem<System<Dim>> random_offsets(std::uint64_t seed, int nodes,
                                                  double share_of_lengths = 0) {
  Rng rng(seed);
  System<Dim> system(Topology<>::full(nodes));
  const auto shape = random_points<System<Dim>>(rng, nodes, -10, 10);
  system.set_rest_offsets(shape);
  for (int l = 0; l < system.link_count(); ++l) {
    system.link_stiffness[l] = rng.uniform(0.2, 2);
    if (rng.uniform(0, 1) >= share_of_lengths) continue;
    system.rest_offset.col(l) *= l % 2 == 0 ? 0.5 : 0.0;
    system.rest_length[l] = rng.uniform(2, 15);
  }
  for (int i = 0; i < nodes; ++i) system.anchor_stiffness[i] = i == 1 ? 0 : rng.uniform(0.1, 1);
  system.anchors = shape + random_points<System<Dim>>(rng, nodes, -4, 4);
  return {system, system.anchors};
}

// The normal equations of sum k_i |x_i - a_i|^2 + sum k_ij |x_i - x_j - m_ij|^2.
template <int Dim>
Eigen::MatrixXd least_squares(const System<Dim>& system) {
  const int n = system.nodes();
  Eigen::MatrixXd K = Eigen::MatrixXd(system.anchor_stiffness.asDiagonal());
  Eigen::MatrixXd right = K * system.anchors.transpose();
  for (int l = 0; l < system.link_count(); ++l) {
    const Link link = system.links()[static_cast<std::size_t>(l)];
    Eigen::VectorXd row = Eigen::VectorXd::Zero(n);
    row[link.i] = 1;
    row[link.j] = -1;
    K += system.link_stiffness[l] * row * row.transpose();
    right += system.link_stiffness[l] * row * system.rest_offset.col(l).transpose();
  }
  return testing::solve_definite(K, right).transpose();
}

template <int Dim>
void expect_every_solver_to_solve_least_squares() {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const auto [system, start] = random_offsets<Dim>(seed, 7);
    const Eigen::MatrixXd expected = least_squares(system);
    SolverRegistry<System<Dim>> registry = solver_registry<System<Dim>>();
#ifdef ASTERISM_TEST_CERES
    reference::add_ceres(registry);
#endif
    for (const auto& name : registry.names()) {
      auto x = start;
      AnySolver<System<Dim>> solver = registry.make(name);
      const Summary summary = solver.solve(system, x);
      const bool by_differences = name == "ncg-forward" || name == "ncg-central";
      if (!by_differences) {
        EXPECT_EQ(summary.status, Status::Converged) << name << ": " << summary;
      }
      EXPECT_LT((x - expected).cwiseAbs().maxCoeff(), by_differences ? 1e-4 : 1e-5) << name;
    }
    auto x = start;
    solve(system, x);
    EXPECT_EQ(certify(system, x).proof, Proof::UniqueGlobalMinimum);
  }
}

TEST(Offsets, AloneAreLeastSquaresForEverySolver) {
  expect_every_solver_to_solve_least_squares<2>();
  expect_every_solver_to_solve_least_squares<3>();
}

TEST(Offsets, AloneTakeNewtonAndIdaOneStep) {
  const auto [system, start] = random_offsets<2>(3, 6);
  auto x = start;
  EXPECT_EQ(Newton<System<2>>().solve(system, x).iterations, 1);
  x = start;
  EXPECT_EQ(Ida<System<2>>().solve(system, x).iterations, 1);
}

TEST(Offsets, OfKnownSizesAndFloatAreTheSame) {
  using Four = SpringSystem<double, 2, 4>;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const auto [system, start] = random_offsets<2>(seed, 4, 0.5);
    Four four(Topology<4>::full());
    four.anchors = system.anchors;
    four.anchor_stiffness = system.anchor_stiffness;
    four.rest_length = system.rest_length;
    four.rest_offset = system.rest_offset;
    four.link_stiffness = system.link_stiffness;
    auto x = start;
    Four::Points y = start;
    Newton<System<2>>().solve(system, x);
    Newton<Four>().solve(four, y);
    EXPECT_LT((x - y).cwiseAbs().maxCoeff(), 1e-6) << seed;
    const auto single = system.cast<float>();
    SpringSystem<float, 2>::Points z = start.cast<float>();
    EXPECT_NEAR(energy(single, z), energy(system, start), 1e-4 * energy(system, start));
  }
}

TEST(Offsets, GradientAndHessianAreTheEnergys) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const auto [system, x] = random_offsets<2>(seed, 12, 0.6);
    const auto energy_at = [&system = system](const Eigen::MatrixXd& at) -> Eigen::MatrixXd {
      return Eigen::MatrixXd::Constant(1, 1, energy(system, System<2>::Points(at)));
    };
    const auto gradient_at = [&system = system](const Eigen::MatrixXd& at) -> Eigen::MatrixXd {
      return gradient(system, System<2>::Points(at));
    };
    const Eigen::MatrixXd g = gradient(system, x), H = hessian(system, x);
    const Eigen::MatrixXd slope = testing::differences(energy_at, x, 1e-5);
    EXPECT_LT((slope.transpose() - g.reshaped()).cwiseAbs().maxCoeff(), 1e-5 * g.cwiseAbs().maxCoeff());
    EXPECT_LT((testing::differences(gradient_at, x, 1e-5) - H).cwiseAbs().maxCoeff(),
              1e-5 * H.cwiseAbs().maxCoeff());
  }
}

TEST(Offsets, IdaNeverRaisesTheEnergyAndSolversAgree) {
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    const auto [system, start] = random_offsets<2>(seed, 6, 0.5);
    Ida<System<2>> ida;
    ida.options.max_iterations = 1;
    auto x = start;
    double before = energy(system, x);
    for (int i = 0; i < 40; ++i) {
      ASSERT_TRUE(ida.solve(system, x).usable());
      const double after = energy(system, x);
      ASSERT_LE(after, before * (1 + 1e-14));
      before = after;
    }
    ASSERT_EQ(Newton<System<2>>().solve(system, x).status, Status::Converged);
    auto y = x;
    ida.options.max_iterations = 100000;
    Rng rng(seed);
    y += random_points<System<2>>(rng, 6, -1e-3, 1e-3);
    ASSERT_EQ(ida.solve(system, y).status, Status::Converged);
    EXPECT_LT((x - y).cwiseAbs().maxCoeff(), 1e-4) << seed;
#ifdef ASTERISM_TEST_CERES
    y = x + random_points<System<2>>(rng, 6, -1e-3, 1e-3);
    ASSERT_TRUE(reference::Ceres<System<2>>().solve(system, y).usable());
    EXPECT_LT((x - y).cwiseAbs().maxCoeff(), 1e-4) << seed;
#endif
  }
}

// No bound is above the lowest energy that many starts find, and what is certified is that.
TEST(Offsets, BoundsHoldAndGlobalSolversFindTheLowest) {
  int certified = 0, several = 0;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    auto [system, start] = random_offsets<2>(seed, 4, 0.9);
    Rng rng(seed + 1000);
    system.anchor_stiffness *= 0.05;
    double lowest = std::numeric_limits<double>::infinity(), highest = 0;
    for (int trial = 0; trial < 100; ++trial) {
      System<2>::Points x = start + random_points<System<2>>(rng, 4, -20, 20);
      const Summary summary = solve(system, x);
      if (!summary.usable()) continue;
      lowest = std::min(lowest, summary.final_energy);
      highest = std::max(highest, summary.final_energy);
      const Certificate certificate = certify(system, x);
      if (!certificate.certified()) continue;
      ++certified;
      EXPECT_LE(certificate.lower_bound, certificate.energy);
      EXPECT_LE(certificate.lower_bound, lowest * (1 + 1e-9)) << seed;
    }
    several += highest > lowest * (1 + 1e-3);
    auto x = start;
    const Summary staircase = make_solver<System<2>>("staircase").solve(system, x);
    EXPECT_LE(staircase.lower_bound, lowest * (1 + 1e-9)) << seed;
    x = start;
    const Summary search = solve_global(system, x);
    EXPECT_LE(search.lower_bound, lowest * (1 + 1e-9)) << seed;
    EXPECT_LE(search.final_energy, lowest * (1 + 1e-2)) << seed << ": " << search;
  }
  EXPECT_GT(certified, 500);
  EXPECT_GT(several, 10);
}

TEST(Offsets, HoldWhatALengthLetsTurn) {
  System<2> system(Topology<>::full(2));
  system.anchors << 0, 7, 0, 0;
  system.anchor_stiffness << 1, 0;
  system.link_stiffness.setOnes();
  system.rest_length << 7;
  auto x = system.anchors;
  EXPECT_EQ(covariance(system, x).status, CovarianceStatus::NotPositiveDefinite);  // turns about node 0
  system.set_rest_offsets(system.anchors);
  const auto held = covariance(system, x);
  EXPECT_EQ(held.status, CovarianceStatus::Computed) << held.message;
  EXPECT_EQ(solve(system, x).positive_definite, true);
  // What hangs by a length turns about the link that does not.
  System<2> three(Topology<>::from_links(3, std::vector<Link>{{0, 1}, {1, 2}}));
  three.anchors << 0, 7, 12, 0, 0, 0;
  three.anchor_stiffness << 1, 0, 0;
  three.link_stiffness.setOnes();
  three.rest_length << 0, 5;
  three.rest_offset = Eigen::Matrix2d{{-7, 0}, {0, 0}};
  const auto free = covariance(three, three.anchors);
  EXPECT_EQ(free.status, CovarianceStatus::NotPositiveDefinite);
  // Fixed nodes hold as well; nothing holds what has neither.
  system.anchor_stiffness.setZero();
  EXPECT_EQ(covariance(system, system.anchors).status, CovarianceStatus::InvalidInput);
  system.fix(0);
  EXPECT_EQ(covariance(system, system.anchors).status, CovarianceStatus::Computed);
}

TEST(Offsets, AlignmentMovesAndDoesNotTurn) {
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    auto [system, start] = random_offsets<3>(seed, 6, 0.5);
    Rng rng(seed);
    const System<3>::Points x = start + random_points<System<3>>(rng, 6, -5, 20);
    const System<3>::Points aligned = rigid_alignment(system, x);
    EXPECT_LE(energy(system, aligned), energy(system, x) * (1 + 1e-14));
    const auto shift = (aligned - x).eval();
    EXPECT_LT((shift.colwise() - shift.col(0)).cwiseAbs().maxCoeff(), 1e-12);
  }
}

TEST(Offsets, OfManyNodesAreSolvedBySubdomains) {
  auto [system, start] = testing::sparse_system<System<2>>(5, 3000);
  const System<2>::Points shape = start;
  system.set_rest_offsets(shape);
  auto x = start, y = start;
  const Summary direct = testing::SparseNewton<System<2>>().solve(system, x);
  const Summary divided = system_solver<System<2>>("schwarz", {{"threads", 2}}).solve(system, y);
  EXPECT_EQ(direct.status, Status::Converged);
  EXPECT_EQ(divided.status, Status::Converged) << divided;
  EXPECT_NEAR(divided.final_energy, direct.final_energy, 1e-5 * direct.final_energy);
}

TEST(Offsets, AreRefusedByWhatCannotTakeThem) {
  auto [system, start] = random_offsets<2>(1, 4);
  SpringBatch<double, 2> batch(Topology<>::full(4), 2);
  batch.set(0, system, start);
  system.rest_offset.resize(2, 0);
  system.set_rest_lengths(system.anchors);
  batch.set(1, system, start);
  BatchNewton<SpringBatch<double, 2>>().solve(batch);
  EXPECT_EQ(batch.status(0), Status::InvalidInput);
  EXPECT_EQ(batch.status(1), Status::Converged);
}

TEST(Offsets, AreValidated) {
  auto [system, start] = random_offsets<2>(1, 4);
  const auto says = [&system = system, &start = start](const char* expected) {
    auto x = start;
    const Summary summary = solve(system, x);
    EXPECT_EQ(summary.status, Status::InvalidInput);
    EXPECT_EQ(std::string_view(summary.message), expected);
    EXPECT_EQ(x, start);
  };
  system.rest_offset(1, 3) = std::numeric_limits<double>::quiet_NaN();
  says("rest offset 3 is not finite");
  system.rest_offset.resize(2, 5);
  says("rest offset must have one column for each link, or none");
}

}  // namespace
}  // namespace asterism
