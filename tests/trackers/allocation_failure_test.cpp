// Makes each allocation in init and update fail once: the exception must be for memory, and the tracker must
// restart as if nothing had happened.
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
  // Runs f, which may throw only exceptions for memory.
  template <typename F>
  static void attempt(F&& f) {
    try {
      f();
    } catch (const std::bad_alloc&) {
    } catch (const cv::Exception& error) {
      EXPECT_EQ(error.code, cv::Error::StsNoMem) << error.what();
    }
  }

  // A new start gives the same as a fresh tracker.
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
                                      tracker.update(second);  // continues from an unspecified state
                                      expect_new_start(tracker);
                                      tracker = make_tracker(GetParam());
                                      tracker.init(draw_frame(0), true_box(0));
                                    });
  EXPECT_GT(allocations, 3);
}

// A frame of another scene, at which the gate copies the tracker, is as if it had not been shown.
TEST_P(OutOfMemory, WhereTheSceneBreaksOff) {
  const cv::Mat next = draw_frame(1);
  cv::Mat other;
  cv::bitwise_not(next, other);
  AnyTracker tracker = make_tracker(GetParam());
  tracker.init(draw_frame(0), true_box(0));
  const AnyTracker started = tracker;
  const long allocations = testing::fail_each_allocation([&] { attempt([&] { tracker.update(other); }); },
                                                         [&](long k) {
                                                           SCOPED_TRACE(k);
                                                           expect_same(tracker.update(next), expected_);
                                                           tracker = started;
                                                         });
  EXPECT_GT(allocations, 50);
}

INSTANTIATE_TEST_SUITE_P(Trackers, OutOfMemory, ::testing::Values("dpt"));

}  // namespace
}  // namespace asterism
