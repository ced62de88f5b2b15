// Derivatives of solutions by the values and parameters of other models than springs.
#include <gtest/gtest.h>

#include "sensitivity_cases.hpp"

namespace asterism::testing {
namespace {

TEST(SensitivityModels, OfYieldingLinks) {
  using System = SpringSystem<double, 2, Eigen::Dynamic, 8, Model<YieldingSpring>>;
  expect_true_derivatives<System>("yielding links, plane", 6);
}

TEST(SensitivityModels, OfHubersLoss) { expect_true_derivatives<Hubers::System>("Huber, plane", 6); }

TEST(SensitivityModels, OnALine) { expect_true_derivatives<Line>("springs, line", 5); }

}  // namespace
}  // namespace asterism::testing
