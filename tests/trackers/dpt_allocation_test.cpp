// Counts the heap allocations of Dpt once it runs.

#include <gtest/gtest.h>

#include <asterism/trackers/dpt/dpt.hpp>
#include <vector>
#ifdef __GLIBC__
#include <malloc.h>  // must precede the replacement of malloc
#endif

#include "../solver/counting_allocator.hpp"
#include "moving_square.hpp"

namespace asterism {
namespace {

// Plays a clip forwards and backwards without end.
class Clip {
 public:
  Clip() {
    for (int t = 0; t < kFrames; ++t) images_.push_back(draw_frame(t));
  }
  const cv::Mat& operator()(int t) const {
    const int phase = t % (2 * kFrames - 2);
    return images_[static_cast<std::size_t>(phase < kFrames ? phase : 2 * kFrames - 2 - phase)];
  }

 private:
  static constexpr int kFrames = 20;
  std::vector<cv::Mat> images_;
};

// The most allocations in one of 30 frames, after ten.
template <typename Input>
long allocations_a_frame(Dpt& tracker) {
  const Clip clip;
  tracker.init(clip(0), true_box(0));
  long most = 0;
  for (int t = 1; t <= 40; ++t) {
    const Input input(clip(t));
    const long count = testing::allocations_in([&] { tracker.update(input); });
    if (t > 10) most = std::max(most, count);
  }
  return most;
}

TEST(Dpt, TakesLittleFromTheHeapOnceItRuns) {
  DptOptions options;
  options.coarse.use_color = false;
  Dpt plain(options), full;
  // The parts, links and times of the result, which the caller owns.
  EXPECT_EQ(allocations_a_frame<Frame>(plain), 3);
  // Two by OpenCV for the gray image.
  EXPECT_LE(allocations_a_frame<cv::Mat>(plain), 3 + 2);
  EXPECT_EQ(allocations_a_frame<Frame>(full), 3);
}

#if defined(__GLIBC__) && !defined(ASTERISM_TEST_SANITIZED)
TEST(Dpt, HoldsAsMuchMemoryAfterTenThousandFramesAsAfterAFew) {
  const auto held = [] {
    const struct mallinfo2 info = mallinfo2();
    return info.uordblks + info.hblkhd;
  };
  const Clip clip;
  Dpt tracker;
  tracker.init(clip(0), true_box(0));
  std::size_t after_a_few = 0;
  for (int t = 1; t <= 10000; ++t) {
    const TrackResult result = tracker.update(clip(t));
    ASSERT_FALSE(result.lost) << t;
    if (t == 100) after_a_few = held();
    if (t > 100 && t % 100 == 0) {
      ASSERT_EQ(held(), after_a_few) << t;
    }
  }
}
#endif

}  // namespace
}  // namespace asterism
