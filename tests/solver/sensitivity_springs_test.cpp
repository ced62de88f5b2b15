// Derivatives of the solutions of springs, dense and sparse.
#include <gtest/gtest.h>

#include <asterism/solver/energy/sensitivity.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/testing/random_system.hpp>
#include <asterism/testing/sparse_system.hpp>
#include <cstdint>
#include <vector>

#include "sensitivity_cases.hpp"

namespace asterism::testing {
namespace {

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

// Nodes 0 and 1 are in one place, where the energy of their link 0 is smooth: derivatives are the differences
// of solutions, and by the length and the stiffness of link 0, where it has them in no direction, 0.
template <typename System>
struct InOnePlace {
  const char* name;
  double rest_length;  ///< of link 0
  double stiffness;    ///< of link 0
  bool has_offsets;    ///< of all links, which are met
};

template <typename System>
void expect_true_derivatives_in_one_place(const InOnePlace<System>& kind, double apart) {
  constexpr double kStep = 1e-4;
  Rng rng(7);
  System system(System::TopologyType::full(4));
  auto x = random_points<System>(rng, 4, -1, 1);
  if (!kind.has_offsets) x.col(1) = x.col(0);
  system.anchors = x;
  system.anchor_stiffness << 1.5, 1.5, 0.7, 2;
  system.link_stiffness << kind.stiffness, 0.8, 1.2, 0.8, 1.2, 2.5;
  if (kind.has_offsets) {
    system.rest_length.setZero();
    system.rest_offset.resize(System::kDim, 6);
    for (int l = 0; l < 6; ++l) {
      const Link link = system.links()[static_cast<std::size_t>(l)];
      system.rest_offset.col(l) = x.col(link.i) - x.col(link.j);
    }
  } else {
    system.set_rest_lengths(x);
    system.rest_length *= 0.9;
    system.rest_length[0] = kind.rest_length;
    x = stationary_point(system, x);
    x.col(1) = x.col(0);
  }
  x(0, 1) += apart;
  const auto w = random_points<System>(rng, 4, -1, 1);
  const auto gradient = sensitivity(system, x, w);
  ASSERT_TRUE(gradient) << kind.name << ": " << gradient.message;
  EXPECT_EQ(gradient.rest_length[0], 0) << kind.name;
  EXPECT_EQ(gradient.link_stiffness[0], 0) << kind.name;
  const auto check = [&](auto&& values_of, int index, double found) {
    const auto at = [&](double step) {
      System moved = system;
      values_of(moved)[index] += step;
      return w.cwiseProduct(follow(moved, x)).sum();
    };
    EXPECT_NEAR(found, (at(kStep) - at(-kStep)) / (2 * kStep), 1e-6) << kind.name << " " << index;
  };
  for (int c = 0; c < 4 * System::kDim; ++c)
    check([](System& s) { return s.anchors.reshaped(); }, c, gradient.anchors.reshaped()[c]);
  for (int i = 0; i < 4; ++i)
    check(
        [](System & s) -> auto& { return s.anchor_stiffness; }, i, gradient.anchor_stiffness[i]);
  for (int l = kind.has_offsets ? 6 : 1; l < 6; ++l) {
    check(
        [](System & s) -> auto& { return s.rest_length; }, l, gradient.rest_length[l]);
    check(
        [](System & s) -> auto& { return s.link_stiffness; }, l, gradient.link_stiffness[l]);
  }
  for (int c = 0; c < gradient.rest_offset.size(); ++c)
    check([](System& s) { return s.rest_offset.reshaped(); }, c, gradient.rest_offset.reshaped()[c]);
  SystemTangent<System> tangent(system);
  for (auto& value : tangent.anchors.reshaped()) value = rng.uniform(-1, 1);
  for (auto& value : tangent.rest_length) value = rng.uniform(-1, 1);
  for (auto& value : tangent.link_stiffness) value = rng.uniform(-1, 1);
  const auto forward = solution_tangent(system, x, tangent);
  ASSERT_TRUE(forward) << forward.message;
  EXPECT_NEAR(w.cwiseProduct(forward.x).sum(), gradient.dot(tangent), 1e-10) << kind.name;
}

template <typename System>
void expect_true_derivatives_in_one_place(const std::vector<InOnePlace<System>>& kinds) {
  for (const auto& kind : kinds) {
    for (const double apart : {0.0, 1e-16}) expect_true_derivatives_in_one_place(kind, apart);
  }
}

TEST(Sensitivity, OfNodesInOnePlace) {
  expect_true_derivatives_in_one_place<Plane>({{"rest length 0", 0, 2, false},
                                               {"stiffness 0", 1, 0, false},
                                               {"rest length and stiffness 0", 0, 0, false},
                                               {"offsets that are met", 0, 2, true}});
  expect_true_derivatives_in_one_place<Space>({{"rest length 0, in space", 0, 2, false},
                                               {"stiffness 0, in space", 1, 0, false},
                                               {"offsets that are met, in space", 0, 2, true}});
  expect_true_derivatives_in_one_place<Ropes::System>({{"slack cable", 1, 2, false}});
}

// Springs that all want one point have no length; what the solver leaves there is rounding, however far off
// it started. All nodes follow the only anchor.
TEST(Sensitivity, OfSpringsThatWantOnePoint) {
  for (std::uint64_t seed = 1; seed <= 1000; ++seed) {
    Rng rng(seed);
    Plane system(Topology<>::from_links(3, std::vector<Link>{{0, 1}, {1, 2}}));
    auto x = random_points<Plane>(rng, 3, -3, 3);
    system.anchors = x;
    system.rest_length.setZero();
    for (auto& k : system.link_stiffness) k = std::pow(10, rng.uniform(-1, 1));
    system.anchor_stiffness << std::pow(10, rng.uniform(-1, 1)), 0, 0;
    ASSERT_EQ(Newton<Plane>().solve(system, x).status, Status::Converged);
    const auto w = random_points<Plane>(rng, 3, -1, 1);
    const auto gradient = sensitivity(system, x, w);
    ASSERT_TRUE(gradient) << seed << ": " << gradient.message;
    EXPECT_LT((gradient.anchors.col(0) - w.rowwise().sum()).norm(), 1e-12) << seed;
  }
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
