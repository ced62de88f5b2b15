// Counts what Kcf takes from the heap, also by malloc, where cv::Mat and FFT libraries get theirs.

#include <gtest/gtest.h>

#include <asterism/parts/kcf.hpp>
#include <atomic>
#include <cstdlib>
#include <new>

#include "../solver/sanitizer.hpp"
#include "part_axioms.hpp"

#if defined(__GLIBC__) && !defined(ASTERISM_TEST_SANITIZED)
namespace {
std::atomic<long> allocations{0};
}

extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_memalign(std::size_t, std::size_t);
void* __libc_calloc(std::size_t, std::size_t);

void* malloc(std::size_t size) {
  ++allocations;
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  ++allocations;
  return __libc_calloc(count, size);
}
int posix_memalign(void** result, std::size_t alignment, std::size_t size) {
  ++allocations;
  *result = __libc_memalign(alignment, size);
  return *result == nullptr ? 12 : 0;  // ENOMEM
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  ++allocations;
  return __libc_memalign(alignment, size);
}
}

namespace asterism {
namespace {

TEST(Kcf, DoesNotAllocateOnceItHasBeenInitialised) {
  const cv::Mat image = testing::texture(480, 640);
  const Frame frame(image);
  for (const Kernel::Type type : {Kernel::Type::Gaussian, Kernel::Type::Polynomial, Kernel::Type::Linear})
    for (const Size2& size : {Size2(80, 80), Size2(40, 40), Size2(23, 61), Size2(210, 190), Size2(9, 7)}) {
      KcfOptions options;
      options.kernel.type = type;
      Kcf kcf(options);
      long before = allocations;
      kcf.init(frame, {320, 240}, size);
      ASSERT_GT(allocations, before);  // they are counted
      kcf.localize(frame, {320, 240});
      before = allocations;
      for (const Point2& at : {Point2(320, 240), Point2(317.3, 241.9), Point2(20, 470), Point2(700, -50)}) {
        const Evidence evidence = kcf.localize(frame, at);
        kcf.adapt(frame, evidence.position);
        kcf.resize(1.01 * kcf.size());
      }
      EXPECT_EQ(allocations, before) << size.transpose();
    }
}

}  // namespace
}  // namespace asterism
#endif
