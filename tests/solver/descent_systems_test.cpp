// L-BFGS and Newton-CG on larger and sparse systems.
#include <gtest/gtest.h>

#include <asterism/solver.hpp>
#include <cmath>
#include <cstdint>

#include "by_terms.hpp"
#include "descent_cases.hpp"

namespace asterism {
namespace {

template <typename System>
void expect_same_minimum_as_ida(int n, int systems) {
  int same[3] = {};
  for (int i = 0; i < systems; ++i) {
    testing::Rng rng(static_cast<std::uint64_t>(100 + i));
    const auto random = testing::random_system<System>(rng, System::TopologyType::full(n));
    typename System::Points by_ida = random.start;
    const double expected = solve_ida(random.system, by_ida).final_energy;
    int method = 0;
    const auto check = [&](auto solver) {
      auto x = random.start;
      const Summary summary = solver.solve(random.system, x);
      EXPECT_EQ(summary.status, Status::Converged) << summary;
      EXPECT_LT(stationarity(random.system, x), 1.0001e-8);
      EXPECT_LT(summary.final_energy, 1.1 * expected) << summary;
      if (std::abs(summary.final_energy - expected) < 1e-6 * expected) ++same[method];
      ++method;
    };
    check(Lbfgs<System>());
    check(Lbfgs<System, JacobiMetric<System>>());
    check(testing::NewtonCg<System>());
  }
  EXPECT_GE(same[0], systems * 90 / 100) << "n = " << n;
  // With the diagonal metric they end in other minima more often.
  EXPECT_GE(same[1], systems / 2) << "n = " << n;
  EXPECT_GE(same[2], systems / 2) << "n = " << n;
}

TEST(DescentOfLargerSystems, FindsIdasMinimum) {
  expect_same_minimum_as_ida<SpringSystem<double, 2>>(16, 60);
  expect_same_minimum_as_ida<SpringSystem<double, 2>>(64, 20);
  expect_same_minimum_as_ida<SpringSystem<double, 3>>(25, 20);
}

TEST(DescentOfLargerSystems, TakesFarFewerIterationsThanIda) {
  using System = SpringSystem<double, 2>;
  testing::Rng rng(5);
  const auto [system, start] = testing::random_system<System>(rng, Topology<>::full(64));
  System::Points x = start;
  const int ida = solve_ida(system, x).iterations;
  x = start;
  EXPECT_LT(Lbfgs<System>().solve(system, x).iterations, ida / 3);
  x = start;
  EXPECT_LT(testing::NewtonCg<System>().solve(system, x).iterations, ida / 6);
}

// The initial metric of L-BFGS is rounded to single precision.
TEST(LbfgsMetric, RoundingLeadsToTheSameMinima) {
  using System = SpringSystem<double, 2>;
  for (const int n : {3, 5, 6, 7, 9, 17, 40, 41, 64}) {
    int same = 0;
    for (int i = 0; i < 10; ++i) {
      testing::Rng rng(static_cast<std::uint64_t>(200 + i));
      const auto [system, start] = testing::random_system<System>(rng, Topology<>::full(n));
      System::Points rounded = start, exact = start;
      const Summary by_rounded = Lbfgs<System>().solve(system, rounded);
      const Summary by_exact = Lbfgs<System, DenseCholesky<System>>().solve(system, exact);
      EXPECT_EQ(by_rounded.status, Status::Converged) << by_rounded;
      if (std::abs(by_rounded.final_energy - by_exact.final_energy) < 1e-9 * by_exact.final_energy) ++same;
    }
    EXPECT_GE(same, 8) << "n = " << n;
  }
}

TEST(LbfgsMetric, UnitsOfStiffnessDoNotMatter) {
  using System = SpringSystem<double, 2>;
  for (const int n : {5, 30, 50}) {
    testing::Rng rng(7);
    auto [system, start] = testing::random_system<System>(rng, Topology<>::full(n));
    System::Points expected = start;
    const int iterations = Lbfgs<System>().solve(system, expected).iterations;
    for (const double unit : {0x1p-300, 0x1p+300}) {  // beyond the range of single precision
      auto scaled = system;
      scaled.anchor_stiffness *= unit;
      scaled.link_stiffness *= unit;
      System::Points x = start;
      const Summary summary = Lbfgs<System>().solve(scaled, x);
      EXPECT_EQ(summary.status, Status::Converged) << summary;
      EXPECT_NEAR(summary.iterations, iterations, 1);
      EXPECT_LT((x - expected).cwiseAbs().maxCoeff(), 1e-6);
    }
  }
}

TEST(LbfgsMetric, IsExactWhereAnchorsAreWeak) {
  using System = SpringSystem<double, 2>;
  for (const int n : {5, 30, 50}) {
    testing::Rng rng(8);
    auto [system, start] = testing::random_system<System>(rng, Topology<>::full(n));
    system.anchor_stiffness *= 1e-9;
    System::Points x = start, exact = start;
    const Summary summary = Lbfgs<System>().solve(system, x);
    const Summary by_exact = Lbfgs<System, DenseCholesky<System>>().solve(system, exact);
    EXPECT_EQ(summary.status, by_exact.status) << summary;
    EXPECT_EQ(x, exact);
  }
}

template <typename System>
void expect_sparse_agreement(int n) {
  auto [system, minimum] = testing::sparse_system<System>(1, n);
  ASSERT_EQ(Lbfgs<System>(system).solve(system, minimum).status, Status::Converged);
  const double expected = double(energy(system, minimum));
  testing::Rng rng(2);
  const typename System::Points start = minimum + testing::random_points<System>(rng, n, -0.003, 0.003);
  const auto check = [&, &system = system](auto solver) {
    auto x = start;
    const Summary summary = solver.solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_NEAR(summary.final_energy, expected, 1e-9 * expected) << summary;
  };
  check(SparseIda<System>());
  check(Lbfgs<System, JacobiMetric<System>>());
  check(Lbfgs<System, SparseCholesky<System>>());
  check(testing::NewtonCg<System>());
#if defined(ASTERISM_TEST_CHOLMOD) && defined(ASTERISM_TEST_ALL_CASES)
  check(Lbfgs<System, CholmodCholesky<System>>());
#endif
}

TEST(DescentOfSparseSystems, EveryPolicyFindsTheSameMinimum) {
  expect_sparse_agreement<SpringSystem<double, 2>>(300);
  expect_sparse_agreement<SpringSystem<double, 3>>(200);
}

TEST(DescentOfSparseSystems, TenThousandNodes) {
  using System = SpringSystem<double, 2>;
  const auto [system, start] = testing::sparse_system<System>(3, 10000);
  for (const bool newton : {false, true}) {
    System::Points x = start;
    const Summary summary = newton ? testing::NewtonCg<System>().solve(system, x)
                                   : Lbfgs<System, JacobiMetric<System>>().solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_LT(summary.final_energy, 0.2 * summary.initial_energy);
  }
}

TEST(DescentNames, SayThePolicy) {
  using System = SpringSystem<double, 2>;
  EXPECT_EQ(Lbfgs<System>::name(), "L-BFGS, dense Cholesky");
  EXPECT_EQ((Lbfgs<System, JacobiMetric<System>>::name()), "L-BFGS, Jacobi");
}

}  // namespace
}  // namespace asterism
