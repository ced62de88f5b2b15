#pragma once

// Models of springs, and the guarantees of every solver for them; shared by the tests of models.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <type_traits>

#include "test_systems.hpp"

namespace asterism::testing {

/// A user-defined potential: a spring that yields, phi = c^2 (sqrt(1 + (r - mu)^2 / c^2) - 1).
struct SoftSpring {
  double c = 0.2;

  template <typename Scalar>
  Derivatives<Scalar> operator()(Scalar r, Scalar mu) const {
    const auto scale = static_cast<Scalar>(c);
    const Scalar t = (r - mu) / scale;
    const Scalar root = std::sqrt(1 + t * t);
    return {scale * scale * (root - 1), scale * t / root, 1 / (root * root * root)};
  }
};

template <typename ModelType, int kDimension = 2>
struct Kit {
  static constexpr int kNodes = 6;
  // For springs, a type whose solvers are compiled already.
  static constexpr int kMaxNodes = std::is_same_v<ModelType, Springs> ? Eigen::Dynamic : 8;
  using System = SpringSystem<double, kDimension, Eigen::Dynamic, kMaxNodes, ModelType>;

  static RandomSystem<System> random(std::uint64_t seed) {
    Rng rng(seed);
    auto result = random_system<System>(rng, System::TopologyType::full(kNodes));
    if constexpr (System::kAnisotropic) {
      for (int i = 0; i < kNodes; ++i) {
        Eigen::Matrix<double, kDimension, kDimension> root;
        for (auto& entry : root.reshaped()) entry = rng.uniform(-1, 1);
        result.system.set_anchor_information(i, root * root.transpose() * result.system.anchor_stiffness[i]);
      }
    }
    if constexpr (requires { result.system.anchor_loss.scale; }) result.system.anchor_loss.scale = 0.1;
    return result;
  }
};

using Soft = Kit<Model<SoftSpring>>;
using Ropes = Kit<Model<Rope>>;
using Spacers = Kit<Model<Repulsion>>;
using Hubers = Kit<Model<Hooke, Huber>>;
using Gemans = Kit<Model<Hooke, GemanMcClure>, 3>;
using Ellipses = Kit<Model<Hooke, Quadratic, AnchorShape::Anisotropic>>;
using Everything = Kit<Model<SoftSpring, Huber, AnchorShape::Anisotropic>, 3>;
using Plain = Kit<Springs>;

/// From nearby, every solver finds the minimum.
template <typename Kit, template <typename> typename SolverOf>
void finds_minimum() {
  using System = typename Kit::System;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    auto [system, start] = Kit::random(seed);
    Newton<System> newton;
    ASSERT_EQ(newton.solve(system, start).status, Status::Converged);
    const double expected = energy(system, start);
    Rng rng(seed);
    auto x = start;
    x += random_points<System>(rng, Kit::kNodes, -1e-3, 1e-3);
    SolverOf<System> solver;
    solver.options.max_iterations = 100000;
    const Summary summary = solver.solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << solver.name() << " seed " << seed << ": " << summary;
    EXPECT_NEAR(summary.final_energy, expected, 1e-6 * expected + 1e-12) << solver.name() << " seed " << seed;
  }
}

// Fixed nodes stay at their start; for the others the gradient vanishes.
template <typename Kit, typename Solver>
void expect_fixed_nodes_to_stay() {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    auto [system, x] = Kit::random(seed);
    const auto start = x;
    system.fix(1);
    system.fix(4);
    const Summary summary = Solver().solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_EQ(x.col(1), start.col(1));
    EXPECT_EQ(x.col(4), start.col(4));
    // In the free system the gradient vanishes only for the others.
    system.release(1);
    system.release(4);
    const auto g = gradient(system, x);
    const auto scale = node_stiffness(system);
    for (int i : {0, 2, 3, 5}) EXPECT_LT(g.col(i).norm(), 1e-5 * scale[i]) << i;
    EXPECT_GT(g.col(1).norm(), 1e-3 * scale[1]);
  }
}

}  // namespace asterism::testing

// Instantiated in model_kits.cpp.
namespace asterism {
inline namespace ASTERISM_ABI {

#define ASTERISM_TEST_KIT(Extern, Kit)                                                             \
  ASTERISM_TEST_ENERGY(Extern, testing::Kit::System)                                               \
  Extern template DenseHessian<testing::Kit::System> hessian(const testing::Kit::System&,          \
                                                             const testing::Kit::System::Points&); \
  ASTERISM_TEST_SOLVER(Extern, testing::Kit::System, Newton<testing::Kit::System>)
#define ASTERISM_TEST_KITS(Extern)    \
  ASTERISM_TEST_KIT(Extern, Soft)     \
  ASTERISM_TEST_KIT(Extern, Ropes)    \
  ASTERISM_TEST_KIT(Extern, Spacers)  \
  ASTERISM_TEST_KIT(Extern, Hubers)   \
  ASTERISM_TEST_KIT(Extern, Gemans)   \
  ASTERISM_TEST_KIT(Extern, Ellipses) \
  ASTERISM_TEST_KIT(Extern, Everything)

ASTERISM_TEST_KITS(extern)

}  // namespace ASTERISM_ABI
}  // namespace asterism
