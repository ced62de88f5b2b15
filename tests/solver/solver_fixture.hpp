#pragma once

#include <gtest/gtest.h>

#include <asterism/solver.hpp>
#include <type_traits>

namespace asterism {

/// Fixture for typed tests of a solver C::Solver on systems of type C::System.
template <typename C>
class SolverFixture : public ::testing::Test {
 public:
  using SystemType = typename C::System;
  using SolverType = typename C::Solver;
  using PointsType = typename SystemType::Points;
  using ScalarType = typename SystemType::Scalar;

  static_assert(asterism::Solver<SolverType, SystemType>);
  static constexpr bool kDouble = std::is_same_v<ScalarType, double>;

  /// Required only in double; float may stop short of the tolerance.
  static void expect_converged(const Summary& summary) {
    if (kDouble) {
      EXPECT_EQ(summary.status, Status::Converged) << summary;
    } else {
      EXPECT_TRUE(summary.usable()) << summary;
    }
    EXPECT_LE(summary.final_energy, summary.initial_energy * (1 + 1e-6));
  }
};

}  // namespace asterism

/// Short names for the types of a SolverFixture, which names from a dependent base class would need.
#define ASTERISM_USE_FIXTURE                                        \
  using System [[maybe_unused]] = typename TestFixture::SystemType; \
  using Points [[maybe_unused]] = typename TestFixture::PointsType; \
  using Scalar [[maybe_unused]] = typename TestFixture::ScalarType; \
  using Solver [[maybe_unused]] = typename TestFixture::SolverType
