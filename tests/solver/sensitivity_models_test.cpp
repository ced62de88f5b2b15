// Derivatives of solutions by the values and parameters of other models than springs.
#include <gtest/gtest.h>

#include "sensitivity_cases.hpp"

namespace asterism::testing {
namespace {

template <int kDim, typename Model>
using Eight = SpringSystem<double, kDim, Eigen::Dynamic, 8, Model>;

TEST(SensitivityModels, OfYieldingLinks) {
  expect_true_derivatives<Eight<2, Model<YieldingSpring>>>("yielding links, plane", 6);
}

TEST(SensitivityModels, OfHubersLoss) {
  expect_true_derivatives<Eight<2, Model<Hooke, Huber>>>("Huber, plane", 6);
}

TEST(SensitivityModels, OnALine) { expect_true_derivatives<Eight<1, Springs>>("springs, line", 5); }

}  // namespace
}  // namespace asterism::testing
