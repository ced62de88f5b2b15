// L-BFGS and Newton-CG with every policy: the same minima as IDA, energy that never rises, robustness.
#include <gtest/gtest.h>

#include <asterism/solver.hpp>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <string>
#include <string_view>

#include "descent_cases.hpp"
#include "solver_fixture.hpp"

namespace asterism {
namespace {

template <typename C>
class Descent : public SolverFixture<C> {
 public:
  using SystemType = typename C::System;
  using SolverType = typename C::Solver;
  using SolverFixture<C>::kDouble;
  static constexpr bool kJacobi = SolverType::name().ends_with("Jacobi");
  static constexpr int kSize = SystemType::kNodes == Eigen::Dynamic ? 6 : SystemType::kNodes;

  static testing::RandomSystem<SystemType> random(std::uint64_t seed, int n = kSize) {
    testing::Rng rng(seed);
    return testing::random_system<SystemType>(rng, SystemType::TopologyType::full(n));
  }

  // A minimum, and a start in its basin.
  static testing::RandomSystem<SystemType> near_minimum(std::uint64_t seed) {
    auto result = random(seed);
    EXPECT_EQ(solve_ida(result.system, result.start).status, Status::Converged);
    testing::Rng rng(seed);
    result.start += testing::random_points<SystemType>(rng, kSize, -0.02, 0.02);
    return result;
  }

  static void expect_rounding(double a, double b) {
    EXPECT_NEAR(a, b, (kDouble ? 1e-9 : 1e-4) * std::abs(b));
  }
};
TYPED_TEST_SUITE(Descent, descent::Cases);

TYPED_TEST(Descent, FindsIdasMinimumFromItsBasin) {
  ASTERISM_USE_FIXTURE;
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    const auto [system, start] = this->near_minimum(seed);
    Points by_ida = start;
    Points x = start;
    const Summary ida = solve_ida(system, by_ida);
    const Summary summary = Solver().solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << "seed " << seed << ": " << summary;
    this->expect_rounding(summary.final_energy, ida.final_energy);
    EXPECT_LT((x - by_ida).norm(), TestFixture::kDouble ? 1e-5 : 5e-3) << "seed " << seed;
  }
}

// From far away the methods may choose different minima; in IDA's metric they hardly ever do.
TYPED_TEST(Descent, FindsIdasMinimumFromFarMostly) {
  ASTERISM_USE_FIXTURE;
  constexpr int kSystems = 100;
  int same = 0;
  for (std::uint64_t seed = 1; seed <= kSystems; ++seed) {
    const auto [system, start] = this->random(seed);
    Points by_ida = start;
    Points x = start;
    const double expected = solve_ida(system, by_ida).final_energy;
    const Summary summary = Solver().solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << "seed " << seed << ": " << summary;
    EXPECT_LT(stationarity(system, x), TestFixture::kDouble ? 1.0001e-8 : 1e-5);
    EXPECT_LT(summary.final_energy, summary.initial_energy);
    if (std::abs(summary.final_energy - expected) < 1e-4 * expected) ++same;
  }
  EXPECT_GE(same, TestFixture::kJacobi ? 85 : 95);
}

TYPED_TEST(Descent, EnergyNeverRises) {
  ASTERISM_USE_FIXTURE;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const auto [system, start] = this->random(seed);
    Solver solver;
    double last = double(energy(system, start));
    for (int iterations = 1; iterations <= 60; ++iterations) {
      solver.options.max_iterations = iterations;
      Points x = start;
      const Summary summary = solver.solve(system, x);
      EXPECT_LE(summary.iterations, iterations);
      EXPECT_LE(summary.final_energy, last + double(detail::rounding_of_energy(system, x, Scalar(last))));
      last = std::min(last, summary.final_energy);
      if (summary.status == Status::Converged) break;
      EXPECT_EQ(summary.status, Status::MaxIterations);
    }
  }
}

TYPED_TEST(Descent, WeakAnchors) {
  ASTERISM_USE_FIXTURE;
  for (const double ratio : {1e-2, 1e-3, 1e-4, 1e-6}) {
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
      auto [system, start] = this->random(seed);
      system.anchor_stiffness *= static_cast<Scalar>(ratio);
      Points x = start;
      Solver solver;
      solver.options.max_iterations = 100000;  // the diagonal's metric needs thousands
      const Summary summary = solver.solve(system, x);
      if (TestFixture::kDouble) {
        EXPECT_EQ(summary.status, Status::Converged)
            << "ratio " << ratio << ", seed " << seed << ": " << summary;
      } else if (ratio > 1e-5) {
        EXPECT_TRUE(summary.usable()) << summary;
      }
      EXPECT_LE(summary.final_energy, summary.initial_energy);
      EXPECT_TRUE(x.allFinite());
    }
  }
}

TYPED_TEST(Descent, StrongAnchors) {
  ASTERISM_USE_FIXTURE;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    auto [system, start] = this->random(seed);
    system.anchor_stiffness *= static_cast<Scalar>(1e6);
    const Summary summary = Solver().solve(system, start);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_LT((start - system.anchors).norm(), 1e-3);
  }
}

TYPED_TEST(Descent, CoincidentNodesPart) {
  ASTERISM_USE_FIXTURE;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    auto [system, start] = this->random(seed);
    for (const bool anchors_too : {false, true}) {
      if (anchors_too) system.anchors.colwise() = system.anchors.col(0).eval();
      Points x = start;
      x.colwise() = start.col(0).eval();
      const Summary summary = Solver().solve(system, x);
      EXPECT_EQ(summary.status, Status::Converged) << summary;
      EXPECT_LT(summary.final_energy, summary.initial_energy);
      EXPECT_GT((x.col(0) - x.col(1)).norm(), 1e-3);
    }
  }
}

TYPED_TEST(Descent, NearlyCoincidentNodes) {
  ASTERISM_USE_FIXTURE;
  for (const double distance : {1e-3, 1e-6, 1e-12, 1e-30}) {
    auto [system, start] = this->random(3);
    start.setZero();
    start.row(0).setLinSpaced(0, static_cast<Scalar>(distance));
    const Summary summary = Solver().solve(system, start);
    EXPECT_EQ(summary.status, Status::Converged) << "distance " << distance << ": " << summary;
  }
}

// Without rest lengths the energy is a convex quadratic with matrix K_dyn.
TYPED_TEST(Descent, ZeroRestLengths) {
  ASTERISM_USE_FIXTURE;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    auto [system, start] = this->random(seed);
    system.rest_length.setZero();
    Points by_ida = start;
    Points x = start;
    solve_ida(system, by_ida);
    const Summary summary = Solver().solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_LT((x - by_ida).norm(), TestFixture::kDouble ? 1e-6 : 1e-3);
    if (!TestFixture::kJacobi && TestFixture::kDouble) {
      EXPECT_LE(summary.iterations, 4);
    }
  }
}

TYPED_TEST(Descent, MovesTurnsAndScalesWithTheSystem) {
  ASTERISM_USE_FIXTURE;
  for (std::uint64_t seed = 21; seed <= 25; ++seed) {
    const auto [system, start] = this->near_minimum(seed);
    Points x = start;
    ASSERT_EQ(Solver().solve(system, x).status, Status::Converged);
    for (const double scale : {1e-4, 1.0, 1e5}) {
      for (const double stiffness : {1e-6, 1e5}) {
        Eigen::Matrix<Scalar, System::kDim, System::kDim> rotation;
        rotation.setIdentity();
        rotation(0, 0) = rotation(1, 1) = Scalar(0.28);
        rotation(0, 1) = Scalar(-0.96);
        rotation(1, 0) = Scalar(0.96);
        const auto change = [&](const Points& p) -> Points {
          return static_cast<Scalar>(scale) * ((rotation * p).array() + Scalar(2)).matrix();
        };
        auto changed = system;
        changed.anchors = change(system.anchors);
        changed.rest_length *= static_cast<Scalar>(scale);
        changed.anchor_stiffness *= static_cast<Scalar>(stiffness);
        changed.link_stiffness *= static_cast<Scalar>(stiffness);
        Points changed_x = change(start);
        const Summary summary = Solver().solve(changed, changed_x);
        EXPECT_EQ(summary.status, Status::Converged) << summary;
        EXPECT_LT((changed_x - change(x)).norm(), (TestFixture::kDouble ? 1e-5 : 5e-3) * scale);
      }
    }
  }
}

TYPED_TEST(Descent, SummaryTellsTheTruth) {
  ASTERISM_USE_FIXTURE;
  const auto [system, start] = this->random(3);
  Points x = start;
  const Summary summary = Solver().solve(system, x);
  EXPECT_EQ(summary.solver, Solver::name());
  EXPECT_EQ(summary.initial_energy, double(energy(system, start)));
  EXPECT_EQ(summary.final_energy, double(energy(system, x)));
  EXPECT_EQ(summary.gradient_norm, gradient(system, x).template cast<double>().norm());
  EXPECT_GT(summary.iterations, 0);
  EXPECT_GT(summary.gradient_evaluations, summary.iterations);
  EXPECT_GT(summary.linear_solves, 0);
  EXPECT_GE(summary.factorizations, 0);

  Solver none;
  none.options.max_iterations = 0;
  x = start;
  EXPECT_EQ(none.solve(system, x).status, Status::MaxIterations);
  EXPECT_EQ(x, start);
}

TYPED_TEST(Descent, StaysAtAStationaryPoint) {
  ASTERISM_USE_FIXTURE;
  auto system = this->random(6).system;
  system.set_rest_lengths(system.anchors);
  Points x = system.anchors;
  const Summary summary = Solver().solve(system, x);
  EXPECT_EQ(summary.status, Status::Converged) << summary;
  EXPECT_EQ(summary.iterations, 0);
  EXPECT_EQ(x, system.anchors);
}

TYPED_TEST(Descent, SameBitsFromAUsedObject) {
  ASTERISM_USE_FIXTURE;
  const auto [system, start] = this->random(12);
  auto [other, other_x] = this->random(13);
  Points first = start;
  Points second = start;
  Solver solver;
  solver.solve(system, first);
  solver.solve(other, other_x);
  solver.solve(system, second);
  EXPECT_EQ(first, second);
}

TYPED_TEST(Descent, RefusesBadInputAndLeavesXAlone) {
  ASTERISM_USE_FIXTURE;
  constexpr Scalar kNan = std::numeric_limits<Scalar>::quiet_NaN();
  constexpr Scalar kHuge = std::numeric_limits<Scalar>::max() / 2;
  Solver solver;  // reused: bad input must not spoil it
  for (int what = 0; what < 9; ++what) {
    auto [system, x] = this->random(9);
    if (what == 0) system.anchors(0, 1) = kNan;
    if (what == 1) system.link_stiffness[2] = -1;
    if (what == 2) system.rest_length[1] = kNan;
    if (what == 3) system.anchor_stiffness.setZero();
    if (what == 4) x(1, 3) = kNan;
    if (what == 5) system.anchors.setConstant(kHuge);
    if (what == 6) system.rest_length.setConstant(kHuge);
    if (what == 7) system.link_stiffness.setConstant(kHuge);
    if (what == 8) x *= kHuge;
    const Points before = x;
    const Summary summary = solver.solve(system, x);
    EXPECT_EQ(summary.status, what < 5 ? Status::InvalidInput : Status::NumericalFailure) << summary;
    EXPECT_EQ(std::memcmp(x.data(), before.data(), sizeof(Scalar) * static_cast<std::size_t>(x.size())), 0);
  }
  auto [system, x] = this->random(9);
  EXPECT_EQ(solver.solve(system, x).status, Status::Converged);
}

TYPED_TEST(Descent, ToleranceOfZeroStopsAtRounding) {
  ASTERISM_USE_FIXTURE;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const auto [system, start] = this->random(seed);
    Points x = start;
    Solver solver;
    solver.options.tolerance = 0;
    solver.options.max_iterations = 2000;
    const Summary summary = solver.solve(system, x);
    EXPECT_TRUE(summary.usable()) << summary;
    EXPECT_LT(summary.iterations, 2000) << summary;
    EXPECT_LT(stationarity(system, x), TestFixture::kDouble ? 1e-12 : 1e-4) << summary;
  }
}

}  // namespace
}  // namespace asterism
