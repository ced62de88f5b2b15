// L-BFGS on oddly shaped systems.
#include <gtest/gtest.h>

#include <asterism/solver/linear/jacobi_metric.hpp>
#include <asterism/solver/method/lbfgs.hpp>

#include "test_systems.hpp"

namespace asterism {
namespace {

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
}

TEST(DescentOfOddShapes, OneNodeOneDimensionAndMany) {
  expect_solved<testing::Line>(1);
  expect_solved<testing::Line>(7);
  expect_solved<SpringSystem<float, 4, Eigen::Dynamic, 5>>(5);
}

}  // namespace
}  // namespace asterism
