// Every allocation of init and update fails once: an exception of memory, and a tracker that can be begun
// anew as if nothing had been.
#include <gtest/gtest.h>

#include <asterism/trackers/tracker/tracker.hpp>
#include <new>
#include <opencv2/core.hpp>

#include "../solver/failing_allocator.hpp"
#include "moving_square.hpp"
#include "same_results.hpp"

namespace asterism {
namespace {

class OutOfMemory : public ::testing::TestWithParam<const char*> {
 protected:
  // What f throws, if anything, is of memory.
  template <typename F>
  static void attempt(F&& f) {
    try {
      f();
    } catch (const std::bad_alloc&) {
    } catch (const cv::Exception& error) {
      EXPECT_EQ(error.code, cv::Error::StsNoMem) << error.what();
    }
  }

  // As a fresh one.
  void expect_new_start(AnyTracker& tracker) const {
    tracker.init(draw_frame(0), true_box(0));
    expect_same(tracker.update(draw_frame(1)), expected_);
  }

  void SetUp() override {
    AnyTracker fresh = make_tracker(GetParam());
    fresh.init(draw_frame(0), true_box(0));
    expected_ = fresh.update(draw_frame(1));
  }

  TrackResult expected_;
};

TEST_P(OutOfMemory, InInit) {
  const cv::Mat image = draw_frame(0);
  AnyTracker tracker = make_tracker(GetParam());
  const long allocations =
      testing::fail_each_allocation([&] { attempt([&] { tracker.init(image, true_box(0)); }); },
                                    [&](long k) {
                                      SCOPED_TRACE(k);
                                      expect_new_start(tracker);
                                      tracker = make_tracker(GetParam());
                                    });
  EXPECT_GT(allocations, 10);
}

TEST_P(OutOfMemory, InUpdate) {
  const cv::Mat first = draw_frame(1), second = draw_frame(2);
  AnyTracker tracker = make_tracker(GetParam());
  tracker.init(draw_frame(0), true_box(0));
  const long allocations =
      testing::fail_each_allocation([&] { attempt([&] { tracker.update(first); }); },
                                    [&](long k) {
                                      SCOPED_TRACE(k);
                                      tracker.update(second);  // it goes on, from somewhere
                                      expect_new_start(tracker);
                                      tracker = make_tracker(GetParam());
                                      tracker.init(draw_frame(0), true_box(0));
                                    });
  EXPECT_GT(allocations, 3);
}

INSTANTIATE_TEST_SUITE_P(Trackers, OutOfMemory, ::testing::Values("dpt"));

}  // namespace
}  // namespace asterism
