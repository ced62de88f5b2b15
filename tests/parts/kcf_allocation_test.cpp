// Counts the heap allocations of Kcf, including those by malloc, which cv::Mat uses.

#include <gtest/gtest.h>

#include <asterism/parts/models/kcf.hpp>
#include <asterism/testing/part_axioms.hpp>

#include "../solver/counting_allocator.hpp"

#if defined(__GLIBC__) && !defined(ASTERISM_TEST_SANITIZED)
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
      ASSERT_GT(allocations, before);  // the counter works
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
