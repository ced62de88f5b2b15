// L-BFGS and Newton-CG on oddly shaped systems, and the Hessian product against the assembled Hessian.
#include <gtest/gtest.h>

#include <asterism/solver/energy/hessian.hpp>
#include <asterism/solver/linear/jacobi_metric.hpp>
#include <asterism/solver/method/lbfgs.hpp>
#include <asterism/solver/method/newton_cg.hpp>
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

template <typename System>
void expect_solved(int n) {
  testing::Rng rng(4);
  const auto [system, start] = testing::random_system<System>(rng, System::TopologyType::full(n));
  const auto check = [&, &system = system, &start = start](auto solver) {
    typename System::Points x = start;
    EXPECT_EQ(solver.solve(system, x).status, Status::Converged) << solver.name();
  };
  check(Lbfgs<System>());
  check(Lbfgs<System, JacobiMetric<System>>());
  check(NewtonCg<System>());
  check(NewtonCg<System, DenseCholesky<System>>());
}

TEST(DescentOfOddShapes, OneNodeOneDimensionAndMany) {
  expect_solved<testing::Line>(1);
  expect_solved<testing::Line>(7);
  expect_solved<SpringSystem<float, 4, Eigen::Dynamic, 5>>(5);
}

}  // namespace
}  // namespace asterism
