// Counts the heap allocations of further part models; Kcf has its own program.

#include <gtest/gtest.h>

#include <asterism/parts/models/scale_filter.hpp>
#include <asterism/parts/models/spatial_reliability.hpp>
#include <asterism/parts/models/strcf.hpp>
#include <asterism/testing/part_axioms.hpp>

#include "../solver/counting_allocator.hpp"

namespace asterism {
namespace {

// After initialisation.
void expect_no_allocation(auto& part, const Frame& frame, const Size2& size) {
  EXPECT_GT(testing::allocations_in([&] { part.init(frame, {160, 120}, size); }), 0);  // the counter works
  part.localize(frame, {160, 120});
  EXPECT_EQ(testing::allocations_in([&] {
              for (const Point2& at : {Point2(160, 120), Point2(157.3, 121.9), Point2(20, 230)}) {
                const Evidence evidence = part.localize(frame, at);
                part.adapt(frame, evidence.position);
                part.resize(1.01 * part.size());
              }
            }),
            0);
}

// The segmentation allocates.
TEST(SpatialReliability, DoesNotAllocateOnceItHasBeenInitialisedWithoutSegmentation) {
  const cv::Mat image = testing::texture(240, 320);
  const Frame frame(image);
  SpatialReliabilityOptions options;
  options.segmentation = false;
  SpatialReliability part(options);
  expect_no_allocation(part, frame, {48, 40});
}

// Color channels allocate.
TEST(Strcf, DoesNotAllocateOnceItHasBeenInitialisedWithoutColor) {
  const cv::Mat image = testing::texture(240, 320);
  const Frame frame(image);
  for (const int iterations : {1, 2, 5})
    for (const Size2& size : {Size2(48, 40), Size2(23, 61), Size2(9, 7)}) {
      StrcfOptions options;
      options.features.color = false;
      options.admm_iterations = iterations;
      Strcf part(options);
      expect_no_allocation(part, frame, size);
    }
}

TEST(ScaleFilter, DoesNotAllocateOnceItHasBeenInitialised) {
  const cv::Mat image = testing::texture(240, 320);
  const Frame frame(image);
  ScaleFilter filter;
  filter.init(frame, {160, 120}, {72, 60});
  filter.localize(frame, {160, 120});
  EXPECT_EQ(testing::allocations_in([&] {
              for (const double factor : {1.0, 1.02, 1.05}) {
                filter.localize(frame, {158, 121});
                filter.adapt(frame, {160, 120}, factor * Size2(72, 60));
              }
            }),
            0);
}

}  // namespace
}  // namespace asterism
