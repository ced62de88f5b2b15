// Derivatives of the solutions of springs, dense and sparse.
#include <gtest/gtest.h>

#include <asterism/solver/energy/sensitivity.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/testing/random_system.hpp>
#include <asterism/testing/sparse_system.hpp>
#include <cstdint>

#include "sensitivity_cases.hpp"

namespace asterism::testing {
namespace {

using Plane = SpringSystem<double, 2>;
using Space = SpringSystem<double, 3>;

TEST(Sensitivity, InThePlane) { expect_true_derivatives<Plane>("springs, plane", 9); }
TEST(Sensitivity, InSpace) { expect_true_derivatives<Space>("springs, space", 6); }

// Links with offsets, alone and with a length around their ends.
TEST(Sensitivity, OfOffsets) {
  expect_true_derivatives<Plane>("offsets, plane", [](int seed) {
    auto random = sensitivity_system<Plane>(seed, Topology<>::full(6));
    Plane& system = random.system;
    const Plane::Points shape = random.start;
    system.rest_offset.resize(2, system.link_count());
    for (int l = 0; l < system.link_count(); ++l) {
      const Link link = system.links()[static_cast<std::size_t>(l)];
      system.rest_offset.col(l) = (l % 3 == 0 ? 0.4 : 0.9) * (shape.col(link.i) - shape.col(link.j));
      system.rest_length[l] *= l % 3 == 0 ? 0.6 : 0.05;
    }
    return random;
  });
}

TEST(Sensitivity, OfLoads) {
  expect_true_derivatives<Space>("springs and loads, space", [](int seed) {
    auto random = sensitivity_system<Space>(seed, Topology<>::full(6));
    Space& system = random.system;
    system.loads = 0.1 * characteristic_length(system, random.start) * Space::Points::Random(3, 6);
    for (int i = 0; i < 6; ++i) system.loads.col(i) *= system.anchor_stiffness[i];
    return random;
  });
}

// A fixed node moves with nothing, and its anchor does not matter.
TEST(Sensitivity, WithFixedNodes) {
  expect_true_derivatives<Plane>("springs, two nodes fixed", [](int seed) {
    auto random = sensitivity_system<Plane>(seed, Topology<>::full(6));
    random.system.fix(1);
    random.system.fix(4);
    return random;
  });
  auto [system, x] = sensitivity_system<Plane>(1, Topology<>::full(5));
  system.fix(0);
  system.fix(1);
  ASSERT_EQ(Newton<Plane>().solve(system, x).status, Status::Converged);
  const auto gradient = sensitivity(system, x, Plane::Points::Ones(2, 5));
  ASSERT_TRUE(gradient) << gradient.message;
  EXPECT_TRUE(gradient.anchors.leftCols<2>().isZero(0));
  EXPECT_EQ(gradient.anchor_stiffness[0], 0);
  EXPECT_EQ(gradient.link_stiffness[0], 0);  // joins both
  EXPECT_NE(gradient.link_stiffness[1], 0);
}

// The sum of the anchors' derivatives is that of a translation: dL/dx summed.
TEST(Sensitivity, OfATranslationIsThatOfThePoints) {
  for (const int nodes : {4, 20, 80}) {
    auto [system, x] = sensitivity_system<Plane>(7, Topology<>::full(nodes));
    ASSERT_EQ(Newton<Plane>().solve(system, x).status, Status::Converged);
    Rng rng(1);
    const auto w = random_points<Plane>(rng, nodes, -1, 1);
    const auto gradient = sensitivity(system, x, w);
    ASSERT_TRUE(gradient) << gradient.message;
    EXPECT_LT((gradient.anchors.rowwise().sum() - w.rowwise().sum()).norm(), 1e-10 * w.norm()) << nodes;
  }
}

// Of a system of many nodes, by a sparse factorisation: forward and reverse mode against the same with the
// dense Hessian, and the workspace used again.
TEST(Sensitivity, OfASparseSystemIsThatOfTheDenseOne) {
  Sensitivity<Plane> sensitivity;
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    auto [system, x] = sparse_system<Plane>(seed, 300);
    ASSERT_TRUE(asterism::detail::is_large_and_sparse(system));
    system.anchor_stiffness *= 10;
    ASSERT_EQ(Newton<Plane>().solve(system, x).status, Status::Converged);
    Rng rng(seed);
    const auto w = random_points<Plane>(rng, 300, -1, 1);
    const auto gradient = sensitivity.backward(system, x, w);
    ASSERT_TRUE(gradient) << gradient.message;
    const Eigen::VectorXd lambda = inverse(hessian(system, x)) * w.reshaped();
    const Plane::Points anchors = lambda.reshaped(2, 300) * system.anchor_stiffness.asDiagonal();
    EXPECT_LT((gradient.anchors - anchors).norm(), 1e-9 * anchors.norm());
    for (const auto& tangent : unit_tangents(system, x, rng)) {
      const auto forward = sensitivity.forward(system, x, tangent);
      ASSERT_TRUE(forward) << forward.message;
      EXPECT_NEAR(w.cwiseProduct(forward.x).sum(), gradient.dot(tangent), 1e-9 * w.norm() * forward.x.norm());
    }
  }
}

// Single precision, and a bounded number of nodes.
TEST(Sensitivity, InSinglePrecision) {
  using Single = SpringSystem<float, 2, Eigen::Dynamic, 8>;
  for (int seed = 1; seed <= 20; ++seed) {
    auto [system, x] = sensitivity_system<Plane>(seed, Topology<>::full(6));
    ASSERT_EQ(Newton<Plane>().solve(system, x).status, Status::Converged);
    Single single(Single::TopologyType::full(6));
    single.anchors = system.anchors.cast<float>();
    single.anchor_stiffness = system.anchor_stiffness.cast<float>();
    single.rest_length = system.rest_length.cast<float>();
    single.link_stiffness = system.link_stiffness.cast<float>();
    const Plane::Points w = Plane::Points::Ones(2, 6);
    const auto expected = sensitivity(system, x, w);
    const auto got = sensitivity(single, Single::Points(x.cast<float>()), Single::Points(w.cast<float>()));
    ASSERT_EQ(got.status, expected.status) << got.message;
    EXPECT_LT((got.anchors.cast<double>() - expected.anchors).norm(), 1e-3 * expected.anchors.norm());
    EXPECT_LT((got.rest_length.cast<double>() - expected.rest_length).norm(),
              1e-3 * expected.rest_length.norm() + 1e-5);
  }
}

}  // namespace
}  // namespace asterism::testing
