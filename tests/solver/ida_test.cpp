#include <asterism/solver/energy/hessian.hpp>
#include <asterism/solver/method/ida.hpp>
#include <asterism/solver/method/sparse_ida.hpp>

#ifdef ASTERISM_TEST_CHOLMOD
#include <asterism/solver/method/cholmod.hpp>
#endif

#include <gtest/gtest.h>

#include <cmath>
#include <utility>

#include "matrices.hpp"
#include "test_systems.hpp"

// Options for AddressSanitizer, which would otherwise abort when an allocation fails.
extern "C" __attribute__((visibility("default"), used)) const char* __asan_default_options() {
  return "allocator_may_return_null=1";
}

namespace asterism {
namespace {

/// Algorithm 1 literally, with B, K, C and K_hat as the dense matrices of Eqs. 13-19. Springs are the
/// anchors, then the links; nodes are the dynamic ones, then the static ones.
class LiteralIda {
 public:
  using System = SpringSystem<double, 2>;

  explicit LiteralIda(const System& system) : system_(system), n_(system.nodes()) {
    const int springs = n_ + system.link_count();
    Eigen::MatrixXd B = Eigen::MatrixXd::Zero(springs, 2 * n_);  // Eq. 14
    Eigen::VectorXd k(springs);
    for (int i = 0; i < n_; ++i) {
      B(i, i) = 1;
      B(i, n_ + i) = -1;
      k[i] = system.anchor_stiffness[i];
    }
    int spring = n_;
    for (const Link& link : system.links()) {
      B(spring, link.i) = 1;
      B(spring, link.j) = -1;
      k[spring] = system.link_stiffness[spring - n_];
      ++spring;
    }
    const Eigen::MatrixXd K = k.asDiagonal();
    const Eigen::MatrixXd K_hat = B.transpose() * K * B;  // Eq. 16
    const Eigen::MatrixXd C = B.transpose() * K;
    K_dyn_ = K_hat.topLeftCorner(n_, n_);  // Eq. 17
    K_stat_ = K_hat.topRightCorner(n_, n_);
    C_dyn_ = C.topRows(n_);  // Eq. 18
  }

  void iterate(Eigen::Matrix2Xd& x) const {
    Eigen::Matrix2Xd next(2, n_);
    for (int dimension = 0; dimension < 2; ++dimension) {
      Eigen::VectorXd L = Eigen::VectorXd::Zero(C_dyn_.cols());  // anchors have no length
      int l = 0;
      for (const Link& link : system_.links()) {
        const Eigen::Vector2d d = x.col(link.i) - x.col(link.j);
        L[n_ + l] = system_.rest_length[l] * d[dimension] / d.norm();
        ++l;
      }
      const Eigen::VectorXd x_stat = system_.anchors.row(dimension).transpose();
      next.row(dimension) =
          (testing::inverse(K_dyn_) * (C_dyn_ * L - K_stat_ * x_stat)).transpose();  // Eq. 19
    }
    x = next;
  }

 private:
  const System& system_;
  int n_;
  Eigen::MatrixXd K_dyn_, K_stat_, C_dyn_;
};

template <typename Solver, typename System>
typename System::Points iterates(const System& system, typename System::Points x, int count) {
  Solver solver;
  solver.options.tolerance = 0;
  solver.options.max_iterations = count;
  const Summary summary = solver.solve(system, x);
  EXPECT_EQ(summary.iterations, count) << summary;
  return x;
}

TEST(Ida, IteratesAreThoseOfTheLiteralAlgorithm) {
  using Dynamic = SpringSystem<double, 2>;
  testing::Rng rng(11);
  for (const int n : {2, 4, 9, 25}) {
    const auto [system, start] = testing::random_system<Dynamic>(rng, Topology<>::full(n));
    const LiteralIda literal(system);
    Eigen::Matrix2Xd expected = start;
    for (int count = 1; count <= 5; ++count) {
      literal.iterate(expected);
      EXPECT_LT((iterates<Ida<Dynamic>>(system, start, count) - expected).norm(), 1e-11) << "n = " << n;
    }
    EXPECT_GT((expected - start).norm(), 1e-2);
  }
}

TEST(Ida, SparseAndDenseIteratesAgree) {
  using System = SpringSystem<double, 2>;
  testing::Rng rng(12);
  const auto points = testing::random_points<System>(rng, 120, 0, 1);
  const auto [system, start] = testing::random_system<System>(rng, Topology<>::k_nearest(points, 6));
  for (const int count : {1, 3, 10}) {
    const auto dense = iterates<Ida<System>>(system, start, count);
    EXPECT_LT((iterates<SparseIda<System>>(system, start, count) - dense).norm(), 1e-11);
#ifdef ASTERISM_TEST_CHOLMOD
    EXPECT_LT((iterates<CholmodIda<System>>(system, start, count) - dense).norm(), 1e-11);
#endif
  }
}

// A factorisation keeps its ordering as long as the topology stays the same, and detects a change.
template <typename Solver>
void expect_reuse_follows_values_and_topology() {
  using System = SpringSystem<double, 2>;
  testing::Rng rng(13);
  Solver reused;
  for (int round = 0; round < 3; ++round) {
    for (const int k : {2, 2, 4}) {
      const auto points = testing::random_points<System>(rng, 30, 0, 1);
      const auto [system, start] = testing::random_system<System>(rng, Topology<>::k_nearest(points, k));
      auto x = start;
      auto fresh = start;
      EXPECT_TRUE(reused.solve(system, x).usable());
      EXPECT_TRUE(Solver().solve(system, fresh).usable());
      EXPECT_EQ(x, fresh);
    }
    const auto [system, start] = testing::random_system<System>(rng, Topology<>::full(30));
    for (int values = 0; values < 2; ++values) {
      auto changed = system;
      changed.link_stiffness *= values + 1;
      auto x = start;
      auto fresh = start;
      reused.solve(changed, x);
      Solver().solve(changed, fresh);
      EXPECT_EQ(x, fresh);
    }
  }
}

TEST(Ida, ReusedWorkspaceFollowsValuesAndTopology) {
  using System = SpringSystem<double, 2>;
  expect_reuse_follows_values_and_topology<Ida<System>>();
  expect_reuse_follows_values_and_topology<SparseIda<System>>();
#ifdef ASTERISM_TEST_CHOLMOD
  expect_reuse_follows_values_and_topology<CholmodIda<System>>();
#endif
}

TEST(Ida, EnergyNeverRises) {
  using System = SpringSystem<double, 3>;
  testing::Rng rng(14);
  for (const int n : {2, 5, 16}) {
    for (int sample = 0; sample < 20; ++sample) {
      const auto [system, start] = testing::random_system<System>(rng, System::TopologyType::full(n));
      Ida<System> ida;
      ida.options.max_iterations = 1;
      auto x = start;
      double before = energy(system, x);
      for (int iteration = 0; iteration < 30; ++iteration) {
        const Summary summary = ida.solve(system, x);
        ASSERT_TRUE(summary.usable()) << summary;
        const double after = energy(system, x);
        ASSERT_LE(after, before * (1 + 1e-14));
        before = after;
      }
    }
  }
}

TEST(Ida, SizesAgree) {
  testing::Rng rng(15);
  const auto random = testing::random_system<SpringSystem<double, 2, 4>>(rng, Topology<4>::full());
  const auto& fixed = random.system;
  const auto& start = random.start;
  const auto solved = [&](auto system) {
    system.anchors = fixed.anchors;
    system.anchor_stiffness = fixed.anchor_stiffness;
    system.rest_length = fixed.rest_length;
    system.link_stiffness = fixed.link_stiffness;
    typename decltype(system)::Points x = start;
    EXPECT_EQ(solve_ida(system, x).status, Status::Converged);
    return Eigen::Matrix2Xd(x);
  };
  using Dynamic = SpringSystem<double, 2>;
  using Bounded = testing::Bounded2;
  using LargelyBounded = SpringSystem<double, 2, Eigen::Dynamic, 40>;
  const auto expected = solved(fixed);
  EXPECT_LT((solved(Dynamic(Topology<>::full(4))) - expected).norm(), 1e-9);
  EXPECT_LT((solved(Bounded(Bounded::TopologyType::full(4))) - expected).norm(), 1e-9);
  EXPECT_LT((solved(LargelyBounded(LargelyBounded::TopologyType::full(4))) - expected).norm(), 1e-9);
}

TEST(Ida, OneNodeGoesToItsAnchor) {
  testing::Space system(Topology<>::full(1));
  system.anchors << 1, 2, 3;
  system.anchor_stiffness << 7;
  Eigen::Matrix3Xd x = Eigen::Vector3d(4, 5, 6);
  const Summary summary = solve_ida(system, x);
  EXPECT_EQ(summary.status, Status::Converged) << summary;
  EXPECT_EQ(summary.iterations, 1);
  EXPECT_LT((x - system.anchors).norm(), 1e-14);
}

TEST(Ida, TwoMinimaOfThreeNodes) {
  SpringSystem<double, 2> system(Topology<>::full(3));
  system.anchors << 0, 1, 0.5, 0, 0, 0.2;
  system.anchor_stiffness << 1, 1, 0.05;
  system.rest_length.setOnes();
  system.link_stiffness.setOnes();
  for (const auto& [side, expected] : {std::pair(1.0, 0.01044740), std::pair(-1.0, 0.02675862)}) {
    Eigen::Matrix2Xd x = system.anchors;
    x(1, 2) = side;
    const Summary summary = solve_ida(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_NEAR(summary.final_energy, expected, 5e-9);
    EXPECT_GT(testing::eigenvalues(hessian(system, x))[0], 0.2);
  }
}

TEST(Ida, CoincidentNodesPart) {
  SpringSystem<double, 2> system(Topology<>::full(4));
  system.anchors << 0, 30, 30, 0, 0, 0, 30, 30;
  system.set_rest_lengths(system.anchors);
  system.anchor_stiffness.setConstant(0.1);
  system.link_stiffness.setOnes();
  Eigen::Matrix2Xd x = Eigen::Matrix2Xd::Constant(2, 4, 11);
  const Summary summary = solve_ida(system, x);
  EXPECT_EQ(summary.status, Status::Converged) << summary;
  EXPECT_LT((x - system.anchors).norm(), 1e-4);

  system.anchors.setConstant(5);  // only the node numbers distinguish them
  x = system.anchors;
  const Summary collapsed = solve_ida(system, x);
  EXPECT_TRUE(collapsed.usable()) << collapsed;
  EXPECT_LT(collapsed.final_energy, 0.1 * collapsed.initial_energy);
  auto again = Eigen::Matrix2Xd(system.anchors);
  solve_ida(system, again);
  EXPECT_EQ(again, x);
}

TEST(Ida, CountsWhatItDoes) {
  testing::Rng rng(16);
  using System = SpringSystem<double, 2, 4>;
  const auto [system, start] = testing::random_system<System>(rng, Topology<4>::full());
  auto x = start;
  const Summary summary = Ida(system).solve(system, x);
  EXPECT_EQ(summary.status, Status::Converged);
  EXPECT_GT(summary.iterations, 3);
  EXPECT_EQ(summary.linear_solves, summary.iterations);
  EXPECT_EQ(summary.gradient_evaluations, summary.iterations + 1);
  EXPECT_EQ(summary.energy_evaluations, 0);
  EXPECT_EQ(summary.factorizations, 1);
}

// Anchors too weak for the scalar's precision are refused, as the result would be rounding noise.
template <typename Solver, typename System>
void expect_refusal_of_hopeless_stiffness() {
  System system(System::TopologyType::full(4));
  system.anchors.setRandom();
  system.set_rest_lengths(system.anchors);
  system.anchor_stiffness.setConstant(typename System::Scalar(1e-25));
  system.link_stiffness.setOnes();
  const typename System::Points start = system.anchors * 2;
  auto x = start;
  const Summary summary = Solver().solve(system, x);
  EXPECT_EQ(summary.status, Status::NumericalFailure) << summary;
  EXPECT_EQ(x, start);
  EXPECT_FALSE(summary.usable());
}

TEST(Ida, RefusesAnchorsBeyondTheDigitsOfTheScalar) {
  using Fixed = SpringSystem<float, 2, 4>;
  using Dynamic = SpringSystem<double, 2>;
  expect_refusal_of_hopeless_stiffness<Ida<Fixed>, Fixed>();
  expect_refusal_of_hopeless_stiffness<Ida<Dynamic>, Dynamic>();
  expect_refusal_of_hopeless_stiffness<SparseIda<Dynamic>, Dynamic>();
}

TEST(Ida, SurvivesStiffnessRatiosOfTenDigits) {
  testing::Rng rng(17);
  using System = SpringSystem<double, 2>;
  auto [system, start] = testing::random_system<System>(rng, Topology<>::full(4));
  system.anchor_stiffness *= 1e-10;
  Ida<System> ida;
  ida.options.max_iterations = 1000;
  EXPECT_TRUE(ida.solve(system, start).usable());
  EXPECT_TRUE(start.allFinite());
  system.anchor_stiffness *= 1e20;
  const Summary stiff = ida.solve(system, start);
  EXPECT_EQ(stiff.status, Status::Converged) << stiff;
  EXPECT_LT((start - system.anchors).norm(), 1e-8);
}

TEST(Ida, LackOfMemoryIsAStatus) {
  using System = SpringSystem<double, 2>;
  const int n = 5'000'000;  // a dense matrix of 2e14 bytes, beyond the address space
  System system(Topology<>::from_links(n, {}));
  system.anchors.setZero();
  system.anchor_stiffness.setOnes();
  System::Points x = System::Points::Ones(2, n);
  const Summary summary = solve_ida(system, x);
  EXPECT_EQ(summary.status, Status::OutOfMemory) << summary;
  EXPECT_EQ(x, System::Points::Ones(2, n));
}

}  // namespace
}  // namespace asterism
