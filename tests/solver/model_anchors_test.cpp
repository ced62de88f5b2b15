// Fixed nodes, and robust and anisotropic anchors by example.
#include <gtest/gtest.h>

#include <asterism/solver.hpp>
#include <cmath>
#include <limits>
#include <string>
#include <string_view>

#include "by_terms.hpp"
#include "matrices.hpp"
#include "model_kits.hpp"
#include "test_systems.hpp"

namespace asterism {
namespace {

using testing::Ellipses;
using testing::Hubers;

TEST(FixedNodes, AreTheSameAsNodesOfInfiniteStiffness) {
  using System = SpringSystem<double, 2>;
  testing::Rng rng(3);
  const auto random = testing::random_system<System>(rng, Topology<>::full(6));
  System system = random.system;
  const System::Points start = random.start;
  System penalised = system;
  penalised.anchors.col(2) = start.col(2);
  penalised.anchor_stiffness[2] = 1e12 * system.anchor_stiffness[2];
  system.fix(2);
  auto expected = start;
  Newton<System>().solve(penalised, expected);
  const auto check = [&](auto&& solver) {
    auto x = start;
    const Summary summary = solver.solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_LT((x - expected).cwiseAbs().maxCoeff(), 1e-5) << summary;
  };
  check(Newton<System>());
  check(Ida<System>());
  check(SparseIda<System>());
  check(Lbfgs<System>());
  check(testing::NewtonCg<System>());
  check(testing::SparseNewton<System>());
  check(NonlinearCg<System>());
  check(Auto<System>());
}

TEST(FixedNodes, AllOfThem) {
  using System = SpringSystem<double, 2, 4>;
  testing::Rng rng(3);
  auto [system, start] = testing::random_system<System>(rng, Topology<4>::full());
  for (int i = 0; i < 4; ++i) system.fix(i);
  auto x = start;
  const Summary summary = Newton<System>().solve(system, x);
  EXPECT_EQ(summary.status, Status::Converged);
  EXPECT_EQ(x, start);
}

TEST(FixedNodes, ThatDoNotExistAreRefused) {
  SpringSystem<double, 2, 4> system(Topology<4>::full());
  system.anchors.setRandom();
  system.anchor_stiffness.setOnes();
  system.set_rest_lengths(system.anchors);
  system.link_stiffness.setOnes();
  system.fix(7);
  auto x = system.anchors;
  const Summary summary = Newton<decltype(system)>().solve(system, x);
  EXPECT_EQ(summary.status, Status::InvalidInput);
  EXPECT_EQ(summary.message, "fixed node 7 is out of range");
}

TEST(FixedNodes, HoldAComponentWithoutAnchors) {
  using System = SpringSystem<double, 2>;
  System system(Topology<>::full(3));
  system.anchors.setZero();
  system.anchor_stiffness.setZero();
  system.rest_length.setConstant(2);
  system.link_stiffness.setOnes();
  System::Points x(2, 3);
  x << 0, 1, 0, 0, 0, 1;
  EXPECT_EQ(validate(system, x).index, 0);
  system.fix(0);
  EXPECT_FALSE(validate(system, x));
  const Summary summary = Auto<System>().solve(system, x);
  EXPECT_EQ(summary.status, Status::Converged) << summary;
  EXPECT_NEAR(summary.final_energy, 0, 1e-12);
  EXPECT_EQ(x.col(0), Eigen::Vector2d::Zero());
}

TEST(RobustAnchors, IgnoreAnOutlierThatDragsASpring) {
  const auto displaced = [](auto system) {
    using System = decltype(system);
    typename System::Points truth(2, 4);
    truth << 0, 40, 0, 40, 0, 0, 40, 40;
    system.anchors = truth;
    system.anchors.col(3) += Eigen::Vector2d(60, 30);
    system.anchor_stiffness.setOnes();
    system.set_rest_lengths(truth);
    system.link_stiffness.setOnes();
    if constexpr (requires { system.anchor_loss.scale; }) system.anchor_loss.scale = 5;
    typename System::Points x = truth;
    EXPECT_EQ(Newton<System>().solve(system, x).status, Status::Converged);
    return (x - truth).colwise().norm().maxCoeff();
  };
  const double spring = displaced(SpringSystem<double, 2, 4>(Topology<4>::full()));
  const double huber = displaced(Hubers::System(Hubers::System::TopologyType::full(4)));
  const double geman =
      displaced(SpringSystem<double, 2, 4, 4, Model<Hooke, GemanMcClure>>(Topology<4>::full()));
  EXPECT_GT(spring, 10);
  EXPECT_LT(huber, 5);
  EXPECT_LT(geman, 1);
  EXPECT_LT(geman, huber);
}

TEST(RobustAnchors, AreSpringsWithinTheirScale) {
  testing::Rng rng(5);
  const auto [system, start] = testing::random_system<SpringSystem<double, 2, 4>>(rng, Topology<4>::full());
  SpringSystem<double, 2, 4, 4, Model<Hooke, Huber>> robust(Topology<4>::full());
  robust.anchors = system.anchors;
  robust.anchor_stiffness = system.anchor_stiffness;
  robust.rest_length = system.rest_length;
  robust.link_stiffness = system.link_stiffness;
  robust.anchor_loss.scale = 100;
  EXPECT_EQ(energy(robust, start), energy(system, start));
  EXPECT_EQ(gradient(robust, start), gradient(system, start));
  EXPECT_EQ(hessian(robust, start), hessian(system, start));
}

using Elliptic = Ellipses::System;

TEST(AnisotropicAnchors, HaveTheEnergyOfTheirInformationMatrix) {
  Elliptic system(Elliptic::TopologyType::full(1));
  system.anchors << 1, 2;
  Eigen::Matrix2d information;
  information << 5, 2, 2, 3;
  system.set_anchor_information(0, information);
  const Eigen::Vector2d d(0.3, -0.7);
  EXPECT_NEAR(energy(system, system.anchors + d), 0.5 * d.dot(information * d), 1e-14);
  EXPECT_LT((hessian(system, system.anchors + d) - information).norm(), 1e-13);
  EXPECT_NEAR(system.anchor_stiffness[0], 4 + std::sqrt(5.0), 1e-12);
}

TEST(AnisotropicAnchors, RefuseWhatIsNoInformationMatrix) {
  const auto refused = [](const Eigen::Matrix2d& information) {
    Elliptic system(Elliptic::TopologyType::full(2));
    system.anchors << 1, 5, 2, 2;
    system.set_rest_lengths(system.anchors);
    system.link_stiffness.setOnes();
    system.set_anchor_information(0, information);
    system.set_anchor_information(1, Eigen::Matrix2d::Identity());
    Elliptic::Points x = system.anchors;
    const Summary summary = Newton<Elliptic>().solve(system, x);
    EXPECT_EQ(summary.status, Status::InvalidInput);
    return std::string(std::string_view(summary.message));
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(refused(Eigen::Vector2d(1, -1).asDiagonal()),
            "information matrix of anchor 0 is not symmetric and positive semi-definite");
  EXPECT_EQ(refused(Eigen::Matrix2d{{1, 0.5}, {0, 1}}),
            "information matrix of anchor 0 is not symmetric and positive semi-definite");
  EXPECT_EQ(refused(Eigen::Vector2d(nan, 1).asDiagonal()), "anchor stiffness 0 is negative or not finite");
  Elliptic unset(Elliptic::TopologyType::full(1));
  unset.anchors << 1, 2;
  unset.anchor_stiffness << 1;
  Elliptic::Points x = unset.anchors;
  EXPECT_EQ(Newton<Elliptic>().solve(unset, x).status, Status::InvalidInput);
}

TEST(RobustAnchors, RefuseAScaleThatIsNone) {
  Hubers::System system(Hubers::System::TopologyType::full(1));
  system.anchors << 1, 2;
  system.anchor_stiffness << 1;
  system.anchor_loss.scale = 0;
  auto x = system.anchors;
  const Summary summary = Newton<decltype(system)>().solve(system, x);
  EXPECT_EQ(summary.status, Status::InvalidInput);
  EXPECT_EQ(summary.message, "anchor loss is not a positive, finite scale");
}

}  // namespace
}  // namespace asterism
