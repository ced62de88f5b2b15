// Fixed and bounded sizes never touch the heap in solve: every malloc of the program is counted.
#include <gtest/gtest.h>

#include <asterism/solver.hpp>
#include <asterism/testing/random_system.hpp>

#include "counting_allocator.hpp"

namespace asterism {
namespace {

using testing::allocations_in;

template <typename System, template <typename...> typename Solver>
void expect_no_heap(int n) {
  testing::Rng rng(5);
  const auto random = testing::random_system<System>(rng, System::TopologyType::full(n));
  const auto& system = random.system;
  const auto& start = random.start;
  Summary summary;
  typename System::Points x = start;
  EXPECT_EQ(allocations_in([&] { summary = Solver<System>().solve(system, x); }), 0) << "n = " << n;
  EXPECT_EQ(summary.status, Status::Converged) << summary;

  // Changing values and reporting faults does not use the heap either.
  auto refilled = system;
  EXPECT_EQ(allocations_in([&] {
              refilled.anchors += start;
              refilled.set_rest_lengths(start);
              refilled.anchor_stiffness[0] = n > 1 ? 0 : 1;
              summary = Solver<System>().solve(refilled, x);
            }),
            0);
  EXPECT_TRUE(summary.usable());
  EXPECT_EQ(allocations_in([&] {
              refilled.anchor_stiffness.setZero();
              summary = Solver<System>().solve(refilled, x);
            }),
            0);
  EXPECT_EQ(summary.status, Status::InvalidInput);
}

template <template <typename...> typename Solver>
void expect_no_heap_of_any_size() {
  expect_no_heap<SpringSystem<double, 2, 4>, Solver>(4);
  for (const int n : {1, 4, 64}) expect_no_heap<SpringSystem<double, 2, Eigen::Dynamic, 64>, Solver>(n);
}

TEST(Heap, IdaOfFixedAndBoundedSizesDoesNotUseIt) { expect_no_heap_of_any_size<Ida>(); }
TEST(Heap, NonlinearCgOfFixedAndBoundedSizesDoesNotUseIt) { expect_no_heap_of_any_size<NonlinearCg>(); }

// Also shows that the counter works.
TEST(Heap, DynamicSizesUseItOnce) {
  using System = SpringSystem<double, 2>;
  testing::Rng rng(6);
  for (const int n : {4, 30}) {
    const auto random = testing::random_system<System>(rng, Topology<>::full(n));
    const auto& system = random.system;
    const auto& start = random.start;
    Ida<System> ida;
    NonlinearCg<System> cg;
    System::Points x = start;
    System::Points y = start;
    EXPECT_GT(allocations_in([&] { ida.solve(system, x); }), 0);
    EXPECT_GT(allocations_in([&] { cg.solve(system, y); }), 0);
    x = start;
    y = start;
    EXPECT_EQ(allocations_in([&] { ida.solve(system, x); }), 0);
    EXPECT_EQ(allocations_in([&] { cg.solve(system, y); }), 0);
  }
}

}  // namespace
}  // namespace asterism
