// Derivatives of solutions for a fixed or bounded number of nodes never touch the heap.
#include <gtest/gtest.h>

#include <asterism/solver/energy/sensitivity.hpp>
#include <asterism/testing/random_system.hpp>

#include "counting_allocator.hpp"

namespace asterism {
namespace {

using testing::allocations_in;

template <typename System>
void expect_no_heap(int n) {
  testing::Rng rng(5);
  auto [system, x] = testing::random_system<System>(rng, System::TopologyType::full(n));
  system.set_rest_lengths(x);
  system.anchors = x;
  const typename System::Points w = System::Points::Ones(System::kDim, n);
  bool computed = false;
  EXPECT_EQ(allocations_in([&, &system = system, &x = x] {
              computed = bool(sensitivity(system, x, w)) &&
                         bool(solution_tangent(system, x, SystemTangent<System>(system)));
            }),
            0)
      << "n = " << n;
  EXPECT_TRUE(computed);
  system.anchor_stiffness.setZero();
  EXPECT_EQ(allocations_in([&, &system = system, &x = x] { computed = bool(sensitivity(system, x, w)); }), 0);
  EXPECT_FALSE(computed);
}

TEST(Heap, SensitivityOfFixedAndBoundedSizesDoesNotUseIt) {
  expect_no_heap<SpringSystem<double, 2, 4>>(4);
  for (const int n : {1, 8}) expect_no_heap<SpringSystem<float, 3, Eigen::Dynamic, 8>>(n);
  using Ellipses = SpringSystem<double, 2, 4, 4, Model<Hooke, Huber, AnchorShape::Anisotropic>>;
  testing::Rng rng(5);
  auto [system, x] = testing::random_system<Ellipses>(rng, Ellipses::TopologyType::full(4));
  for (int i = 0; i < 4; ++i)
    system.set_anchor_information(i, Eigen::Vector2d(1, 2).asDiagonal().toDenseMatrix());
  system.set_rest_lengths(x);
  system.anchors = x;
  bool computed = false;
  EXPECT_EQ(allocations_in([&, &system = system, &x = x] {
              computed = bool(sensitivity(system, x, Ellipses::Points(Ellipses::Points::Ones())));
            }),
            0);
  EXPECT_TRUE(computed);
}

}  // namespace
}  // namespace asterism
