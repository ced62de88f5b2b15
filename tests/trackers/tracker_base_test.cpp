// Functions that trackers inherit from TrackerBase.

#include <gtest/gtest.h>

#include <asterism/trackers/tracker/tracker_base.hpp>
#include <limits>
#include <stdexcept>

namespace asterism {
namespace {

// Moves its box to the right, and counts the calls.
template <class Gate>
class Drifting : public TrackerBase<Drifting<Gate>, Gate> {
 public:
  int started() const { return started_; }
  int followed() const { return followed_; }

 private:
  friend TrackerBase<Drifting, Gate>;
  static constexpr std::string_view kName = "Drifting";
  void start(const Frame&, const cv::Rect2d& box) { box_ = box, ++started_; }
  TrackResult follow(const Frame&) {
    box_.x += 1, ++followed_;
    TrackResult result = standing();
    result.confidence = 1;
    return result;
  }
  TrackResult standing() const {
    TrackResult result;
    result.box = box_;
    return result;
  }
  void visit_learned(StateArchive& archive) {
    archive(box_.x), archive(box_.y), archive(box_.width), archive(box_.height);
  }

  cv::Rect2d box_;
  int started_ = 0, followed_ = 0;
};
using Gated = Drifting<InterruptionGate>;
using Ungated = Drifting<NoGate>;
static_assert(FrameTracker<Gated> && FrameTracker<Ungated> && Stateful<Gated>);

cv::Mat noise() {
  cv::Mat image(60, 80, CV_8UC1);
  cv::RNG(1).fill(image, cv::RNG::UNIFORM, 0, 255);
  return image;
}
const cv::Rect2d kBox(20, 20, 20, 20);

template <class T>
class TrackerBaseOf : public ::testing::Test {};
using Kinds = ::testing::Types<Gated, Ungated>;
TYPED_TEST_SUITE(TrackerBaseOf, Kinds);

TYPED_TEST(TrackerBaseOf, ImagesAndFramesAreTheSameButForAStage) {
  TypeParam by_image, by_frame;
  by_image.init(noise(), kBox);
  by_frame.init(Frame(noise()), kBox);
  const TrackResult image = by_image.update(noise()), frame = by_frame.update(Frame(noise()));
  EXPECT_EQ(image.box, frame.box);
  ASSERT_EQ(image.times.size(), 1u);
  EXPECT_EQ(image.times[0].stage, "frame");
  EXPECT_TRUE(frame.times.empty());
}

TYPED_TEST(TrackerBaseOf, RefusesWhatATrackerMust) {
  TypeParam tracker;
  EXPECT_THROW(tracker.update(noise()), std::logic_error);
  EXPECT_THROW(save_state(tracker), std::logic_error);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const cv::Rect2d& box : {cv::Rect2d(nan, 0, 5, 5), {0, 0, 0.5, 5}, {80, 0, 5, 5}, {-5, 0, 5, 5}})
    EXPECT_THROW(tracker.init(noise(), box), std::invalid_argument);
  EXPECT_THROW(tracker.init(cv::Mat(), kBox), std::invalid_argument);
  EXPECT_EQ(tracker.started(), 0);
  EXPECT_THROW(tracker.update(noise()), std::logic_error);
}

TYPED_TEST(TrackerBaseOf, GoesOnFromWhatWasSaved) {
  TypeParam tracker, restored;
  tracker.init(noise(), kBox);
  tracker.update(noise());
  restore_state(restored, save_state(tracker));
  EXPECT_EQ(restored.update(noise()).box, tracker.update(noise()).box);
}

TEST(TrackerBase, RefusesToStartOnNothingWhereItHasAGate) {
  Gated gated;
  Ungated ungated;
  gated.init(noise(), kBox), ungated.init(noise(), kBox);
  const cv::Mat blank = cv::Mat::zeros(60, 80, CV_8UC1);
  EXPECT_THROW(gated.init(blank, cv::Rect2d(0, 0, 5, 5)), std::invalid_argument);
  EXPECT_EQ(gated.started(), 1);
  EXPECT_EQ(gated.update(noise()).box, kBox + cv::Point2d(1, 0));  // as before
  EXPECT_NO_THROW(ungated.init(blank, cv::Rect2d(0, 0, 5, 5)));
  EXPECT_EQ(ungated.started(), 2);
  EXPECT_EQ(ungated.update(blank).box, cv::Rect2d(1, 0, 5, 5));
}

TEST(TrackerBase, StandsInAnInterruptionWhereItHasAGate) {
  Gated gated;
  Ungated ungated;
  gated.init(noise(), kBox), ungated.init(noise(), kBox);
  const cv::Mat blank = cv::Mat::zeros(60, 80, CV_8UC1);
  const TrackResult stays = gated.update(blank), goes = ungated.update(blank);
  EXPECT_TRUE(stays.interrupted);
  EXPECT_EQ(stays.box, kBox);
  EXPECT_EQ(gated.followed(), 0);
  EXPECT_FALSE(goes.interrupted);
  EXPECT_EQ(ungated.followed(), 1);
}

}  // namespace
}  // namespace asterism
