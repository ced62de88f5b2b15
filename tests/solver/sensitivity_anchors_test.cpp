// Derivatives of solutions by anisotropic and robust anchors.
#include <gtest/gtest.h>

#include "sensitivity_cases.hpp"

namespace asterism::testing {
namespace {

TEST(SensitivityAnchors, OfGemanAndMcCluresLoss) {
  expect_true_derivatives<Gemans::System>("Geman-McClure, space", 6);
}

TEST(SensitivityAnchors, WithInformationMatrices) {
  expect_true_derivatives<Ellipses::System>("information, plane", 6);
}

TEST(SensitivityAnchors, WithEverything) {
  using System =
      SpringSystem<double, 3, Eigen::Dynamic, 8, Model<YieldingSpring, Huber, AnchorShape::Anisotropic>>;
  expect_true_derivatives<System>("yielding links, Huber, information, space", 6);
}

// The energy is that of Lambda alone: by k_i at constant shape is by Lambda along itself.
TEST(SensitivityAnchors, InformationIsTheChainOfStiffnessAndShape) {
  using System = Ellipses::System;
  auto [system, start] = sensitivity_system<System>(3, System::TopologyType::full(4));
  const auto x = stationary_point(system, start);
  Rng rng(1);
  const auto gradient = sensitivity(system, x, random_points<System>(rng, 4, -1, 1));
  ASSERT_TRUE(gradient) << gradient.message;
  for (int i = 0; i < 4; ++i) {
    const Eigen::Matrix2d shape = system.anchor_shape.block<2, 2>(0, 2 * i);
    const Eigen::Matrix2d by_information = gradient.anchor_information(system, i);
    EXPECT_NEAR(by_information.cwiseProduct(shape).sum(), gradient.anchor_stiffness[i],
                1e-12 * by_information.norm());
  }
}

}  // namespace
}  // namespace asterism::testing
