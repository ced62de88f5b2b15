// Fixed and bounded sizes never touch the heap in solve: every malloc of the program is counted.
#include <gtest/gtest.h>

#include <asterism/solver.hpp>
#include <atomic>
#include <cstddef>

#include "random_system.hpp"

#if defined(__SANITIZE_ADDRESS__)
#define ASTERISM_TEST_ASAN
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
#define ASTERISM_TEST_ASAN
#endif
#endif

namespace {
std::atomic<long> allocations{0};
}

#ifdef ASTERISM_TEST_ASAN
extern "C" int __sanitizer_install_malloc_and_free_hooks(void (*on_malloc)(const volatile void*, std::size_t),
                                                         void (*on_free)(const volatile void*));
namespace {
[[maybe_unused]] const int kHook = __sanitizer_install_malloc_and_free_hooks(
    [](const volatile void*, std::size_t) { ++allocations; }, [](const volatile void*) {});
}
#else
// glibc lets a program replace malloc; operator new and Eigen come through it.
extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);

void* malloc(std::size_t size) {
  ++allocations;
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  ++allocations;
  return __libc_calloc(count, size);
}
void* realloc(void* memory, std::size_t size) {
  ++allocations;
  return __libc_realloc(memory, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  ++allocations;
  return __libc_memalign(alignment, size);
}
}
#endif

namespace asterism {
namespace {

template <typename Solve>
long allocations_in(Solve&& solve) {
  const long before = allocations;
  solve();
  return allocations - before;
}

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

  // Values are refilled, and faults reported, without it too.
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
  expect_no_heap<SpringSystem<double, 2, 1>, Solver>(1);
  expect_no_heap<SpringSystem<double, 2, 4>, Solver>(4);
  expect_no_heap<SpringSystem<float, 3, 9>, Solver>(9);
  expect_no_heap<SpringSystem<double, 2, 25>, Solver>(25);
  expect_no_heap<SpringSystem<double, 2, Eigen::Dynamic, 9>, Solver>(4);
  expect_no_heap<SpringSystem<double, 3, Eigen::Dynamic, 16>, Solver>(16);
  expect_no_heap<SpringSystem<float, 2, Eigen::Dynamic, 36>, Solver>(30);
  expect_no_heap<SpringSystem<double, 2, Eigen::Dynamic, 64>, Solver>(64);
}

TEST(Heap, IdaOfFixedAndBoundedSizesDoesNotUseIt) { expect_no_heap_of_any_size<Ida>(); }
TEST(Heap, NonlinearCgOfFixedAndBoundedSizesDoesNotUseIt) { expect_no_heap_of_any_size<NonlinearCg>(); }

// Also shows that the counter counts.
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
