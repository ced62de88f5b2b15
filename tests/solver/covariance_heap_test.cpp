// Covariances for a fixed or bounded number of nodes never touch the heap.
#include <gtest/gtest.h>

#include <asterism/solver/energy/covariance.hpp>
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
  bool computed = false;
  EXPECT_EQ(allocations_in([&, &system = system, &x = x] {
              computed = bool(covariance(system, x)) && bool(node_covariances(system, x));
            }),
            0)
      << "n = " << n;
  EXPECT_TRUE(computed);
  system.anchor_stiffness.setZero();
  EXPECT_EQ(allocations_in([&, &system = system, &x = x] { computed = bool(covariance(system, x)); }), 0);
  EXPECT_FALSE(computed);
}

TEST(Heap, CovariancesOfFixedAndBoundedSizesDoNotUseIt) {
  expect_no_heap<SpringSystem<double, 2, 4>>(4);
  for (const int n : {1, 8}) expect_no_heap<SpringSystem<float, 3, Eigen::Dynamic, 8>>(n);
}

// Also shows that the counter works.
TEST(Heap, CovariancesOfDynamicSizesUseIt) {
  using System = SpringSystem<double, 2>;
  testing::Rng rng(6);
  auto [system, x] = testing::random_system<System>(rng, Topology<>::full(12));
  system.set_rest_lengths(x);
  system.anchors = x;
  EXPECT_GT(allocations_in([&, &system = system, &x = x] { (void)covariance(system, x); }), 0);
}

}  // namespace
}  // namespace asterism
