// The library's trackers behind OpenCV's interface, and OpenCV's trackers as the library's.
#include <gtest/gtest.h>

#include <asterism/trackers/tracker/multi_tracker.hpp>
#include <asterism/trackers/tracker/opencv_tracker.hpp>
#include <cmath>
#include <concepts>
#include <stdexcept>
#include <string>

#include "moving_square.hpp"

namespace asterism {
namespace {

static_assert(FrameTracker<CvTracker> && !std::copyable<CvTracker>);

constexpr int kFrames = 12;

TEST(OpenCvTracker, IsTheTrackerInWholePixels) {
  cv::Ptr<OpenCvTracker> tracker = OpenCvTracker::create("kcf");
  const cv::Ptr<cv::Tracker> by_interface = tracker;
  AnyTracker alone = make_tracker("kcf");
  by_interface->init(draw_frame(0), true_box(0));
  EXPECT_TRUE(tracker->result().box.empty());
  alone.init(draw_frame(0), true_box(0));
  for (int t = 1; t <= kFrames; ++t) {
    cv::Rect box;
    ASSERT_TRUE(by_interface->update(draw_frame(t), box));
    const cv::Rect2d expected = alone.update(draw_frame(t)).box;
    EXPECT_EQ(tracker->result().box, expected);
    EXPECT_LE(std::abs(box.x - expected.x), 0.5);
    EXPECT_LE(std::abs(box.y - expected.y), 0.5);
    EXPECT_LE(std::abs(box.br().x - (expected.x + expected.width)), 0.5);
    EXPECT_LE(std::abs(box.br().y - (expected.y + expected.height)), 0.5);
    EXPECT_GT((cv::Rect2d(box) & true_box(t)).area(), 0.7 * true_box(t).area());
  }
}

TEST(OpenCvTracker, TakesWhateverOpenCvPassesOn) {
  cv::UMat image;
  draw_frame(0).copyTo(image);
  const cv::Ptr<OpenCvTracker> tracker = OpenCvTracker::create("kcf");
  tracker->init(image, true_box(0));
  draw_frame(1).copyTo(image);
  cv::Rect box;
  EXPECT_TRUE(tracker->update(image, box));
}

// A tracker that reports given results.
struct Scripted {
  bool lost;
  cv::Rect2d box;
  void init(const cv::Mat&, const cv::Rect2d& start) { box = start; }
  TrackResult update(const cv::Mat&) {
    TrackResult result;
    result.box = box;
    result.lost = lost;
    return result;
  }
};

TEST(OpenCvTracker, LeavesTheBoxWhereTheObjectIsLost) {
  OpenCvTracker tracker(Scripted{true, {}});
  tracker.init(draw_frame(0), {1, 2, 30, 40});
  cv::Rect box(5, 6, 7, 8);
  EXPECT_FALSE(tracker.update(draw_frame(1), box));
  EXPECT_EQ(box, cv::Rect(5, 6, 7, 8));
  EXPECT_EQ(tracker.result().box, cv::Rect2d(1, 2, 30, 40));
}

TEST(OpenCvTracker, ReportsErrorsAsOpenCvDoes) {
  const auto text = [](auto&& work) -> std::string {
    try {
      work();
    } catch (const cv::Exception& error) {
      return error.err;
    }
    return "nothing was thrown";
  };
  const cv::Ptr<OpenCvTracker> tracker = OpenCvTracker::create("kcf");
  cv::Rect box;
  EXPECT_EQ(text([&] { tracker->update(draw_frame(0), box); }), "CoarseTracker: update before init");
  EXPECT_EQ(text([&] {
              tracker->init(draw_frame(0), {1000, 0, 30, 30});
            }),
            "the start box, 30 x 30 px at (1000, 0), lies outside the image of 320 x 240 px");
  EXPECT_NE(text([&] { tracker->init(cv::Mat(), {0, 0, 30, 30}); }), "nothing was thrown");
  EXPECT_THROW(OpenCvTracker::create("no-such-tracker"), std::invalid_argument);
}

// A cv::Tracker that moves by (3, 1) pixels per frame until its steps are used up.
class Steps : public cv::Tracker {
 public:
  explicit Steps(int steps) : steps_(steps) {}
  void init(cv::InputArray image, const cv::Rect& box) override {
    EXPECT_EQ(image.type(), CV_8UC3);
    box_ = box;
  }
  bool update(cv::InputArray image, cv::Rect& box) override {
    EXPECT_EQ(image.type(), CV_8UC3);
    if (steps_-- <= 0) return false;
    box = box_ += cv::Point(3, 1);
    return true;
  }

 private:
  int steps_;
  cv::Rect box_;
};

TEST(CvTracker, IsOpenCvsTrackerBehindOurInterface) {
  AnyTracker tracker = CvTracker([] { return cv::makePtr<Steps>(kFrames); });
  for (const bool gray : {false, true}) {  // a new start resets its steps
    const auto frame = [gray](int t) {
      cv::Mat image = draw_frame(t);
      if (gray) cv::cvtColor(image, image, cv::COLOR_BGR2GRAY);
      return image;
    };
    tracker.init(frame(0), cv::Rect2d(60.4, 49.7, 47.9, 40.1));
    for (int t = 1; t <= kFrames; ++t) {
      const TrackResult result = tracker.update(frame(t));
      EXPECT_EQ(result.box, true_box(t));
      EXPECT_EQ(result.confidence, 1);
      EXPECT_FALSE(result.lost);
    }
    const TrackResult lost = tracker.update(frame(0));
    EXPECT_TRUE(lost.lost);
    EXPECT_EQ(lost.confidence, 0);
    EXPECT_EQ(lost.box, true_box(kFrames));
  }
}

TEST(CvTracker, StandsBesideOursInMultiTracker) {
  MultiTracker multi(2);
  multi.add(1, CvTracker([] { return cv::makePtr<Steps>(kFrames); }), draw_frame(0), true_box(0));
  multi.add(2, make_tracker("kcf"), draw_frame(0), true_box(0));
  for (int t = 1; t <= kFrames; ++t)
    for (const MultiTracker::Object& object : multi.update(draw_frame(t)))
      EXPECT_GT((object.result.box & true_box(t)).area(), 0.7 * true_box(t).area()) << object.id;
}

TEST(CvTracker, RefusesWhatItCannotUse) {
  EXPECT_THROW(CvTracker(nullptr), std::invalid_argument);
  CvTracker none([] { return cv::Ptr<cv::Tracker>(); });
  EXPECT_THROW(none.init(draw_frame(0), true_box(0)), std::runtime_error);
  EXPECT_THROW(none.update(draw_frame(0)), std::logic_error);
  AnyTracker tracker = CvTracker([] { return cv::makePtr<Steps>(1); });
  EXPECT_THROW(AnyTracker{tracker}, std::invalid_argument);  // it cannot be copied
  tracker.init(draw_frame(0), true_box(0));
  EXPECT_THROW(tracker.save(), std::invalid_argument);
}

}  // namespace
}  // namespace asterism
