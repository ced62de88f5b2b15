// L-BFGS of fixed and bounded sizes never touch the heap in solve: every malloc is counted.
#include <gtest/gtest.h>

#include <asterism/solver.hpp>
#include <asterism/testing/random_system.hpp>

#include "counting_allocator.hpp"

namespace asterism {
namespace {

template <typename Solver, typename System>
long allocations_in_solve(Solver& solver, const System& system, typename System::Points& x) {
  Summary summary;
  const long count = testing::allocations_in([&] { summary = solver.solve(system, x); });
  EXPECT_EQ(summary.status, Status::Converged) << summary;
  return count;
}

template <typename Solver, typename System>
void expect_no_heap(const System& system, const typename System::Points& start) {
  auto x = start;
  Solver solver;
  EXPECT_EQ(allocations_in_solve(solver, system, x), 0) << Solver::name() << ", n = " << system.nodes();
}

template <typename System>
void expect_no_heap(int n) {
  testing::Rng rng(5);
  const auto [system, start] = testing::random_system<System>(rng, System::TopologyType::full(n));
  expect_no_heap<Lbfgs<System>>(system, start);
  expect_no_heap<Lbfgs<System, JacobiMetric<System>>>(system, start);
}

TEST(DescentHeap, FixedAndBoundedSizesDoNotUseIt) {
  expect_no_heap<SpringSystem<double, 2, 4>>(4);
  for (const int n : {1, 4, 64}) expect_no_heap<SpringSystem<double, 2, Eigen::Dynamic, 64>>(n);
}

// Also shows that the counter works.
TEST(DescentHeap, DynamicSizesUseItOnce) {
  using System = SpringSystem<double, 2>;
  testing::Rng rng(6);
  const auto [system, start] = testing::random_system<System>(rng, Topology<>::full(30));
  const auto check = [&, &system = system, &start = start](auto solver) {
    System::Points x = start;
    EXPECT_GT(allocations_in_solve(solver, system, x), 0);
    x = start;
    EXPECT_EQ(allocations_in_solve(solver, system, x), 0);
  };
  check(Lbfgs<System>());
  check(Lbfgs<System, JacobiMetric<System>>());
}

}  // namespace
}  // namespace asterism
