// The accelerated variants of IDA that the benchmarks compare with must be fair opponents: correct and no
// slower than IDA.
#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/solver/method/ida.hpp>
#include <asterism/solver/run/solver.hpp>
#include <cmath>
#include <cstdint>
#include <limits>

#include "../../bench/laboratory/comparison_solvers.hpp"
#include "test_systems.hpp"

namespace asterism {
namespace {

using System = SpringSystem<double, 2>;

template <typename Solver_>
class Comparison : public ::testing::Test {
 public:
  static_assert(asterism::Solver<Solver_, System>);

  static testing::RandomSystem<System> random(std::uint64_t seed, int n) {
    testing::Rng rng(seed);
    return testing::random_system<System>(rng, Topology<>::full(n));
  }
};
using Solvers = ::testing::Types<bench::AndersonIda<System>, bench::ChebyshevIda<System>>;
TYPED_TEST_SUITE(Comparison, Solvers);

TYPED_TEST(Comparison, ReachesIdasMinimum) {
  for (const int n : {4, 9, 25}) {
    int same = 0;
    constexpr int kSystems = 40;
    for (std::uint64_t seed = 1; seed <= kSystems; ++seed) {
      const auto [system, start] = this->random(seed, n);
      System::Points by_ida = start;
      const double expected = solve_ida(system, by_ida).final_energy;
      System::Points x = start;
      const Summary summary = TypeParam().solve(system, x);
      EXPECT_EQ(summary.status, Status::Converged) << "n = " << n << ", seed " << seed << ": " << summary;
      EXPECT_LE(stationarity(system, x), 1.0001e-8);
      same += std::abs(summary.final_energy - expected) <= 1e-7 * expected;

      // From nearby all end in the same minimum.
      System::Points near = by_ida;
      testing::Rng rng(seed);
      near += testing::random_points<System>(rng, n, -0.01, 0.01);
      EXPECT_NEAR(TypeParam().solve(system, near).final_energy, expected, 1e-9 * expected);
    }
    EXPECT_GE(same, kSystems * 9 / 10) << "n = " << n;
  }
}

TYPED_TEST(Comparison, EnergyNeverRises) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const auto [system, start] = this->random(seed, 9);
    double last = energy(system, start);
    for (int iterations = 1; iterations <= 80; ++iterations) {
      TypeParam solver;
      solver.options.max_iterations = iterations;
      System::Points x = start;
      const Summary summary = solver.solve(system, x);
      EXPECT_LE(summary.final_energy, last + detail::rounding_of_energy(system, x, last));
      last = summary.final_energy;
      if (summary.status == Status::Converged) break;
      EXPECT_EQ(summary.status, Status::MaxIterations);
      EXPECT_EQ(summary.iterations, iterations);
    }
  }
}

// The purpose of the acceleration.
TYPED_TEST(Comparison, TakesFewerIterationsThanIda) {
  double ratio = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const auto [system, start] = this->random(seed, 25);
    System::Points x = start;
    const Summary ida = solve_ida(system, x);
    x = start;
    const Summary summary = TypeParam().solve(system, x);
    ratio += summary.iterations / (20.0 * ida.iterations);
    EXPECT_EQ(summary.linear_solves, summary.iterations);
    EXPECT_EQ(summary.factorizations, 1);
    EXPECT_GT(summary.gradient_evaluations, summary.iterations);
    EXPECT_LE(summary.gradient_evaluations, 2 * summary.iterations + 1);
  }
  EXPECT_LT(ratio, 0.6);
}

TYPED_TEST(Comparison, CoincidentNodesPartAndBadInputIsRefused) {
  auto [system, x] = this->random(3, 6);
  x.colwise() = x.col(0).eval();
  EXPECT_EQ(TypeParam().solve(system, x).status, Status::Converged);
  system.anchors(0, 2) = std::numeric_limits<double>::quiet_NaN();
  const System::Points before = x;
  EXPECT_EQ(TypeParam().solve(system, x).status, Status::InvalidInput);
  EXPECT_EQ(x, before);
}

}  // namespace
}  // namespace asterism
