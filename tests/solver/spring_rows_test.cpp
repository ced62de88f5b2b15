// The energy of full topologies, whose springs are computed several at a time, compared with the same links
// one by one.
#include <gtest/gtest.h>

#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/testing/random_system.hpp>
#include <cstdint>
#include <limits>

#include "listed_links.hpp"

namespace asterism {
namespace {

template <typename System>
void expect_same(const System& full, const typename System::Points& x) {
  using Points = typename System::Points;
  using Scalar = typename System::Scalar;
  const System listed = testing::with_listed_links(full);
  ASSERT_FALSE(detail::SpringRows<System>::serve(listed));
  Points gradient;
  Points expected;
  const Scalar value = energy_and_gradient(full, x, gradient);
  const double expected_value = double(energy_and_gradient(listed, x, expected));
  const double rounding = 100 * double(std::numeric_limits<Scalar>::epsilon());
  EXPECT_NEAR(double(value), expected_value, rounding * expected_value);
  EXPECT_LE(double((gradient - expected).norm()), rounding * double(expected.norm()));
  EXPECT_EQ(energy(full, x), value);
  EXPECT_EQ(asterism::gradient(full, x), gradient);
}

template <typename System>
void expect_same_of_random(std::initializer_list<int> sizes) {
  for (const int n : sizes) {
    testing::Rng rng(static_cast<std::uint64_t>(n));
    auto [system, x] = testing::random_system<System>(rng, System::TopologyType::full(n));
    ASSERT_TRUE(detail::SpringRows<System>::serve(system)) << n;
    expect_same(system, x);
    auto parted = x;
    parted.col(3) = parted.col(n - 1);  // coincident: the anchors define the direction
    expect_same(system, parted);
    parted.col(2).array() = parted.col(n - 2).array() + 1e-30f;
    expect_same(system, parted);
    system.anchors.colwise() = system.anchors.col(0).eval();
    parted.colwise() = parted.col(0).eval();
    expect_same(system, parted);
    system.fix(1);
    system.fix(n - 1);
    expect_same(system, x);
    system.rest_length.setZero();
    system.link_stiffness[4] = 0;
    expect_same(system, x);
  }
}

TEST(SpringRows, AgreeWithSpringsOneByOne) {
  expect_same_of_random<SpringSystem<double, 2>>({9, 10, 11, 12, 13, 16, 17, 31, 64, 100});
  expect_same_of_random<SpringSystem<double, 3>>({9, 14, 33});
  expect_same_of_random<SpringSystem<float, 2>>({9, 12, 21, 40});
  expect_same_of_random<SpringSystem<double, 2, 12>>({12});
  expect_same_of_random<SpringSystem<float, 3, Eigen::Dynamic, 20>>({9, 15, 20});
}

TEST(SpringRows, ServeWhatTheyCan) {
  using Dynamic = SpringSystem<double, 2>;
  EXPECT_TRUE(detail::SpringRows<Dynamic>::serve(Dynamic(Topology<>::full(1024))));
  EXPECT_FALSE(detail::SpringRows<Dynamic>::serve(Dynamic(Topology<>::full(1025))));  // stack limit
  EXPECT_FALSE(detail::SpringRows<Dynamic>::serve(Dynamic(Topology<>::full(8))));
  EXPECT_FALSE(detail::SpringRows<Dynamic>::serve(Dynamic(Topology<>::star(20, 0))));
  using Soft =
      SpringSystem<double, 2, Eigen::Dynamic, Eigen::Dynamic, Model<Hooke, Huber>>;  // anchors may be any
  EXPECT_TRUE(detail::SpringRows<Soft>::serve(Soft(Topology<>::full(20))));
}

}  // namespace
}  // namespace asterism
