// Derivatives of the solutions of four nodes, what is refused, and values that are learned by them.
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <asterism/solver/energy/sensitivity.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/testing/random_system.hpp>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string_view>
#include <vector>

#include "sensitivity_cases.hpp"

namespace asterism::testing {
namespace {

using Four = SpringSystem<double, 2, 4>;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

TEST(Sensitivity, OfFourNodes) { expect_true_derivatives<Four>("springs, four nodes", 4); }

class Refused : public ::testing::Test {
 protected:
  Refused() : system(Four::TopologyType::full(4)), x(2, 4), w(Four::Points::Ones(2, 4)) {
    x << 0, 30, 0, 30, 0, 0, 30, 30;
    system.anchors = x;
    system.anchor_stiffness.setConstant(1);
    system.set_rest_lengths(x);
    system.link_stiffness.setConstant(1);
  }

  void expect(SensitivityStatus status, std::string_view message, const SensitivityOptions& options = {}) {
    const auto gradient = sensitivity(system, x, w, options);
    EXPECT_EQ(gradient.status, status);
    EXPECT_EQ(gradient.message, message);
    EXPECT_FALSE(gradient);
    EXPECT_TRUE(gradient.anchors.array().isNaN().all());
    EXPECT_TRUE(gradient.anchor_stiffness.array().isNaN().all());
    EXPECT_EQ(gradient.link_stiffness.size(), 0);
    const auto forward = solution_tangent(system, x, SystemTangent<Four>(system), options);
    if (message.starts_with("grad_x")) return;
    EXPECT_EQ(forward.status, status);
    EXPECT_EQ(forward.message, message);
    EXPECT_TRUE(forward.x.array().isNaN().all());
  }

  Four system;
  Four::Points x;
  Four::Points w;
};

TEST_F(Refused, IsNoGoodInput) {
  ASSERT_TRUE(sensitivity(system, x, w));
  w(1, 2) = kNaN;
  expect(SensitivityStatus::InvalidInput, "grad_x of node 2 is not finite");
  w.setOnes();
  expect(SensitivityStatus::InvalidInput, "option stationarity is negative or not finite", {kNaN});
  x(0, 3) = kNaN;
  expect(SensitivityStatus::InvalidInput, "x of node 3 is not finite");
  x(0, 3) = 30;
  system.rest_length[1] = -1;
  expect(SensitivityStatus::InvalidInput, "rest length 1 is negative or not finite");
  system.rest_length[1] = 30;
  system.anchor_stiffness.setZero();
  expect(SensitivityStatus::InvalidInput, "node 0 is in a connected component without anchor stiffness");
}

TEST_F(Refused, IsATangentOfAnotherSize) {
  SystemTangent<Four> tangent(system);
  tangent.rest_length.resize(5);
  EXPECT_EQ(solution_tangent(system, x, tangent).message,
            "tangent of rest length has not one finite number for each value of the system");
  Plane plane(Topology<>::full(3));
  plane.anchors = x.leftCols<3>();
  plane.anchor_stiffness.setOnes(3);
  plane.set_rest_lengths(plane.anchors);
  plane.link_stiffness.setOnes(3);
  const auto gradient = sensitivity(plane, plane.anchors, Plane::Points::Ones(2, 4));
  EXPECT_EQ(gradient.message, "grad_x must have one column for each node");
  EXPECT_EQ(gradient.anchors.size(), 0);
  EXPECT_EQ(gradient.rest_length.size(), 0);
}

TEST_F(Refused, IsAPointThatIsNotStationary) {
  x(0, 0) += 1;
  expect(SensitivityStatus::NotStationary,
         "x is not a stationary point to the option stationarity: solve the system from it first");
  EXPECT_TRUE(sensitivity(system, x, w, {1}));
}

// Two nodes on their anchors' perpendicular bisector: stationary, but a saddle.
TEST_F(Refused, IsASaddle) {
  system.anchors.row(1).setZero();  // all on one line
  system.anchors.row(0) << 0, 1, 2, 3;
  system.anchor_stiffness.setConstant(1e-3);
  Newton<Four> newton;
  newton.options.escape_saddles = false;
  newton.options.align = false;
  x = system.anchors;
  x.row(0) *= 20;
  const Summary summary = newton.solve(system, x);
  ASSERT_EQ(summary.status, Status::Converged) << summary;
  ASSERT_EQ(summary.positive_definite, false) << summary;
  expect(SensitivityStatus::NotPositiveDefinite,
         "the Hessian is not positive definite to the digits of the scalar: x is not a strict local minimum");
}

// A constellation that hangs on one anchor turns about it.
TEST_F(Refused, IsARigidMotion) {
  system.anchor_stiffness << 1, 0, 0, 0;
  const auto gradient = sensitivity(system, x, w);
  EXPECT_EQ(gradient.status, SensitivityStatus::NotPositiveDefinite);
  EXPECT_TRUE(std::string_view(gradient.message).starts_with("the Hessian is not positive definite"))
      << gradient.message;
}

TEST_F(Refused, AreCoincidentNodes) {
  constexpr auto kMessage = "link 0 has ends that coincide: its force has no derivative there";
  system.anchors.col(1) = system.anchors.col(0);
  x = system.anchors;
  system.set_rest_lengths(x);
  EXPECT_TRUE(sensitivity(system, x, w));  // a rest length of 0
  system.rest_length[0] = 1e-3;
  expect(SensitivityStatus::CoincidentNodes, kMessage);
  x(0, 1) += 1e-15;
  expect(SensitivityStatus::CoincidentNodes, kMessage);
  system.fix(0);
  system.fix(1);
  EXPECT_TRUE(sensitivity(system, x, w));
}

TEST_F(Refused, IsOverflow) {
  w.setConstant(1e308);
  const auto gradient = sensitivity(system, x, w);
  EXPECT_EQ(gradient.status, SensitivityStatus::NumericalFailure);
  EXPECT_EQ(gradient.message, "a derivative leaves the range of the scalar");
  EXPECT_TRUE(gradient.anchors.array().isNaN().all());
  x *= 1e200;
  system.anchors = x;
  system.rest_length *= 1e200;
  w.setOnes();
  expect(SensitivityStatus::NumericalFailure, "gradient or curvature leave the range of the scalar");
}

// The chain rule to parameters of a law: stiffness and rest lengths of a system are functions of two
// parameters, whose true values descent by the gradient of the squared error recovers.
TEST(Sensitivity, LearnsTheParametersOfALaw) {
  constexpr int kSystems = 20;
  struct Example {
    Four system;
    Four::Points x;
    Four::LinkVector strain;
    Eigen::Vector4d quality;
  };
  // k_i = exp(p0) quality, k_ij = exp(p1) strain^2, mu_ij = p2 times the anchors' distance.
  const auto apply = [](Example& example, const Eigen::Vector3d& p) {
    auto& system = example.system;
    system.anchor_stiffness = std::exp(p[0]) * example.quality;
    system.link_stiffness = std::exp(p[1]) * example.strain.cwiseAbs2();
    system.set_rest_lengths(system.anchors);
    system.rest_length *= p[2];
  };
  const Eigen::Vector3d truth(0.4, -0.3, 1.1);
  Newton<Four> newton;
  Sensitivity<Four> sensitivity;
  std::vector<Example> examples;
  std::vector<Four::Points> targets;
  for (int seed = 1; seed <= kSystems; ++seed) {
    auto [system, start] = sensitivity_system<Four>(seed, Four::TopologyType::full(4));
    Rng rng(static_cast<std::uint64_t>(seed));
    Example& example =
        examples.emplace_back(Example{system, start, system.rest_length, Eigen::Vector4d::Zero()});
    for (auto& s : example.strain) s = rng.uniform(0.5, 1.5);
    for (auto& q : example.quality) q = rng.uniform(0.5, 2);
    apply(example, truth);
    example.x = system.anchors;
    ASSERT_EQ(newton.solve(example.system, example.x).status, Status::Converged);
    targets.push_back(follow(example.system, example.x));
  }
  // Only the ratio of stiffness moves the solution: p0 stays. Gauss-Newton on the forward tangents.
  Eigen::Vector3d p(truth[0], 0.2, 1.05);
  double loss = 0;
  for (int step = 0; step < 12; ++step) {
    Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
    Eigen::Vector2d slope = Eigen::Vector2d::Zero();
    Eigen::Vector2d reverse = Eigen::Vector2d::Zero();
    loss = 0;
    for (std::size_t e = 0; e < examples.size(); ++e) {
      Example& example = examples[e];
      apply(example, p);
      const Summary summary = newton.solve(example.system, example.x);
      ASSERT_EQ(summary.status, Status::Converged) << summary << " at " << p.transpose();
      example.x = follow(example.system, example.x);
      SystemTangent<Four> by[2] = {SystemTangent<Four>(example.system), SystemTangent<Four>(example.system)};
      by[0].link_stiffness = example.system.link_stiffness;   // by p1
      by[1].rest_length = example.system.rest_length / p[2];  // by p2
      const Four::Points error = example.x - targets[e];
      loss += error.squaredNorm() / 2;
      const auto gradient = sensitivity.backward(example.system, example.x, error);
      ASSERT_TRUE(gradient) << gradient.message;
      Eigen::Matrix<double, 8, 2> jacobian;
      for (int c = 0; c < 2; ++c) {
        const auto moved = sensitivity.forward(example.system, example.x, by[c]);
        ASSERT_TRUE(moved) << moved.message;
        jacobian.col(c) = moved.x.reshaped();
        reverse[c] += gradient.dot(by[c]);
      }
      normal += jacobian.transpose() * jacobian;
      slope += jacobian.transpose() * error.reshaped();
    }
    EXPECT_LT((reverse - slope).norm(), 1e-9 * slope.norm() + 1e-18);
    p.tail<2>() -= normal.inverse() * reverse;
  }
  EXPECT_LT(loss, 1e-18);
  EXPECT_LT((p - truth).norm(), 1e-8);
}

}  // namespace
}  // namespace asterism::testing
