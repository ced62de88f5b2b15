// Measures what Dpt takes from the heap once it runs.

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

// The most bytes that are allocated in one of 30 frames, after ten.
template <typename Input>
std::size_t bytes_a_frame(Dpt& tracker) {
  const Clip clip;
  tracker.init(clip(0), true_box(0));
  std::size_t most = 0;
  for (int t = 1; t <= 40; ++t) {
    const Input input(clip(t));
    const std::size_t bytes = testing::bytes_in([&] { tracker.update(input); });
    if (t > 10) most = std::max(most, bytes);
  }
  return most;
}

TEST(Dpt, TakesLittleFromTheHeapOnceItRuns) {
  DptOptions options;
  options.coarse.use_color = false;
  Dpt plain(options), full;
  // The result's vectors, and matrices of four parts in the solver. One filter's spectrum alone has more.
  constexpr std::size_t kMost = 32 << 10;
  EXPECT_LT(bytes_a_frame<Frame>(plain), kMost);
  EXPECT_LT(bytes_a_frame<Frame>(full), kMost);
  const cv::Size image = draw_frame(0).size();  // which becomes gray
  EXPECT_LT(bytes_a_frame<cv::Mat>(plain), kMost + static_cast<std::size_t>(2 * image.area()));
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
