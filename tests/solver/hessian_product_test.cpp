// The Hessian product against the assembled Hessian.
#include <gtest/gtest.h>

#include <asterism/solver/energy/hessian.hpp>
#include <asterism/solver/energy/hessian_operator.hpp>
#include <cstdint>
#include <limits>

#include "test_systems.hpp"

namespace asterism {
namespace {

template <typename System>
void expect_product_of_hessian(const System& system, const typename System::Points& x) {
  using Points = typename System::Points;
  using Vector = Eigen::Matrix<typename System::Scalar, Eigen::Dynamic, 1>;
  detail::HessianOperator<System> product;
  product.set(system, x);
  const auto dense = hessian(system, x);
  testing::Rng rng(1);
  for (int i = 0; i < 5; ++i) {
    const Points v = testing::random_points<System>(rng, system.nodes(), -1, 1);
    Points result;
    product.apply(system, v, result);
    const Vector expected = dense * Eigen::Map<const Vector>(v.data(), v.size());
    const double rounding = 100 * double(std::numeric_limits<typename System::Scalar>::epsilon());
    EXPECT_LE(double((Eigen::Map<const Vector>(result.data(), result.size()) - expected).norm()),
              rounding * double(dense.norm()));
  }
}

template <typename System>
void expect_products_of_hessian(int n) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    testing::Rng rng(seed);
    auto [system, x] = testing::random_system<System>(rng, System::TopologyType::full(n));
    expect_product_of_hessian(system, x);
    if (n > 1) x.col(1) = x.col(0);
    expect_product_of_hessian(system, x);
    system.rest_length.setZero();
    expect_product_of_hessian(system, x);
  }
}

TEST(HessianProduct, IsTheHessians) {
  expect_products_of_hessian<testing::Line>(5);
  expect_products_of_hessian<testing::Plane>(1);
  expect_products_of_hessian<testing::Fixed2>(4);
  expect_products_of_hessian<testing::Bounded3f>(8);
  expect_products_of_hessian<SpringSystem<double, 5>>(4);
}

}  // namespace
}  // namespace asterism
