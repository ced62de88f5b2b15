#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/trackers/around/kalman.hpp>
#include <asterism/trackers/dpt/dpt.hpp>
#include <asterism/trackers/tracker/multi_tracker.hpp>
#include <stdexcept>

#include "moving_square.hpp"
#include "same_results.hpp"

namespace asterism {
namespace {

const std::vector<cv::Rect2d> kBoxes{
    true_box(0), {150, 120, 60, 50}, {20, 150, 40, 40}, {200, 20, 50, 70}, {100, 60, 40, 60}};

// A tracker that takes only images, and throws on request.
struct Fussy {
  bool* throws;
  cv::Rect2d box;
  int type = -1;
  void init(const cv::Mat&, const cv::Rect2d& start) { box = start; }
  TrackResult update(const cv::Mat& image) {
    if (*throws) throw std::runtime_error("fussy");
    box.width = image.type();
    TrackResult result;
    result.box = box;
    return result;
  }
};
static_assert(FrameTracker<Dpt> && FrameTracker<KalmanTracker> && FrameTracker<AnyTracker> &&
              Tracker<Fussy> && !FrameTracker<Fussy>);

TEST(MultiTracker, IsAsManySingleTrackersForAnyNumberOfThreads) {
  const std::vector<std::string> trackers{"dpt", "coarse", "lgt", "kcf", "kalman"};
  std::vector<AnyTracker> alone;
  std::vector<MultiTracker> together;
  for (const int threads : {1, 2, 3, 0}) together.emplace_back(threads);
  for (std::size_t i = 0; i < kBoxes.size(); ++i) {
    alone.push_back(make_tracker(trackers[i]));
    alone.back().init(draw_frame(0), kBoxes[i]);
    // Ids are chosen by the user and define the order.
    const int id = 10 - static_cast<int>(i);
    for (MultiTracker& multi : together) multi.add(id, make_tracker(trackers[i]), draw_frame(0), kBoxes[i]);
  }
  for (int t = 1; t <= 8; ++t) {
    std::vector<TrackResult> expected;
    for (AnyTracker& tracker : alone) expected.push_back(tracker.update(draw_frame(t)));
    for (MultiTracker& multi : together) {
      const std::vector<MultiTracker::Object> found = multi.update(draw_frame(t));
      ASSERT_EQ(found.size(), expected.size());
      for (std::size_t i = 0; i < found.size(); ++i) {
        EXPECT_EQ(found[found.size() - 1 - i].id, 10 - static_cast<int>(i));
        EXPECT_EQ(found[i].error, nullptr);
        expect_same(found[found.size() - 1 - i].result, expected[i]);
      }
    }
  }
}

TEST(MultiTracker, ObjectsComeAndGoWithoutAnEffectOnOthers) {
  AnyTracker alone = make_tracker("dpt");
  MultiTracker multi(2);
  EXPECT_TRUE(multi.update(draw_frame(0)).empty());
  alone.init(draw_frame(0), kBoxes[0]);
  multi.add(1, make_tracker("dpt"), draw_frame(0), kBoxes[0]);
  for (int t = 1; t <= 9; ++t) {
    const cv::Mat image = draw_frame(t);
    const Frame frame(image);  // shared with trackers that start on it
    const std::vector<MultiTracker::Object> found = multi.update(frame);
    ASSERT_EQ(found.size(), t > 3 && t <= 6 ? 2u : 1u);
    expect_same(found[0].result, alone.update(image));
    if (t == 3) multi.add(7, make_tracker("coarse"), frame, kBoxes[1]);
    if (t == 6) {
      EXPECT_TRUE(multi.remove(7));
    }
  }
  EXPECT_FALSE(multi.remove(7));
  EXPECT_EQ(multi.size(), 1u);
}

TEST(MultiTracker, ATrackerThatThrowsHarmsNoOther) {
  bool throws = false;
  AnyTracker alone = make_tracker("dpt");
  alone.init(draw_frame(0), kBoxes[0]);
  MultiTracker multi(2);
  multi.add(1, Fussy{&throws, {}}, draw_frame(0), kBoxes[1]);
  multi.add(2, make_tracker("dpt"), draw_frame(0), kBoxes[0]);
  for (int t = 1; t <= 4; ++t) {
    throws = t == 2;
    const std::vector<MultiTracker::Object> found = multi.update(draw_frame(t));
    ASSERT_EQ(found.size(), 2u);
    expect_same(found[1].result, alone.update(draw_frame(t)));
    EXPECT_EQ(found[1].error, nullptr);
    if (throws) {
      EXPECT_THROW(std::rethrow_exception(found[0].error), std::runtime_error);
    } else {
      EXPECT_EQ(found[0].error, nullptr);
      EXPECT_EQ(found[0].result.box.x, kBoxes[1].x);
    }
  }
}

TEST(MultiTracker, RefusesBadInputAndStaysAsItWas) {
  EXPECT_THROW(MultiTracker(-1), std::invalid_argument);
  MultiTracker multi;
  multi.add(1, make_tracker("kcf"), draw_frame(0), kBoxes[0]);
  EXPECT_THROW(multi.add(1, make_tracker("kcf"), draw_frame(0), kBoxes[0]), std::invalid_argument);
  EXPECT_THROW(multi.add(2, make_tracker("kcf"), draw_frame(0), {0, 0, 0, 0}), std::invalid_argument);
  EXPECT_THROW(multi.add(2, make_tracker("kcf"), cv::Mat(), kBoxes[0]), std::invalid_argument);
  EXPECT_THROW(multi.update(cv::Mat()), std::invalid_argument);
  EXPECT_EQ(multi.size(), 1u);
  EXPECT_NEAR(multi.update(draw_frame(1))[0].result.box.x, true_box(1).x, 2);
}

TEST(KalmanTracker, SharesAFrameThatIsConvertedAlready) {
  KalmanTracker of_images(make_tracker("dpt")), of_frames(make_tracker("dpt"));
  const auto conversions = [](const TrackResult& result) {
    return std::count_if(result.times.begin(), result.times.end(),
                         [](const StageTime& time) { return time.stage == "frame"; });
  };
  of_images.init(draw_frame(0), true_box(0));
  of_frames.init(Frame(draw_frame(0)), true_box(0));
  for (int t = 1; t <= 5; ++t) {
    const TrackResult a = of_images.update(draw_frame(t)), b = of_frames.update(Frame(draw_frame(t)));
    expect_same(a, b);
    EXPECT_EQ(conversions(a), 1);
    EXPECT_EQ(conversions(b), 0);
  }
  EXPECT_THROW(of_frames.init(Frame(draw_frame(0)), {0, 0, 0, 0}), std::invalid_argument);
}

// A tracker that takes only images gets the frame's 8-bit pixels.
TEST(AnyTracker, GivesImagesToATrackerThatKnowsNoFrames) {
  bool throws = false;
  AnyTracker tracker = Fussy{&throws, {}};
  cv::Mat gray, deep;
  cv::cvtColor(draw_frame(0), gray, cv::COLOR_BGR2GRAY);
  draw_frame(0).convertTo(deep, CV_16U, 257);
  tracker.init(Frame(deep), kBoxes[0]);
  EXPECT_EQ(tracker.update(Frame(deep)).box.width, CV_8UC3);
  EXPECT_EQ(tracker.update(Frame(gray)).box.width, CV_8UC1);
  EXPECT_EQ(tracker.update(deep).box.width, CV_16UC3);
}

}  // namespace
}  // namespace asterism
