// What trackers inherit from TrackerBase, and GatedTracker around any tracker.

#include <gtest/gtest.h>

#include <asterism/trackers/around/gated.hpp>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>

namespace asterism {
namespace {

// Moves its box to the right, and counts the calls.
class Drifting : public TrackerBase<Drifting> {
 public:
  int started() const { return started_; }
  int followed() const { return followed_; }
  const Drifting& tracker() const { return *this; }
  TrackResult standing() const {
    TrackResult result;
    result.box = box_;
    result.parts.resize(1);
    result.parts[0].position = centre_of(box_);
    return result;
  }

 private:
  friend TrackerBase<Drifting>;
  static constexpr std::string_view kName = "Drifting";
  void start(const Frame&, const cv::Rect2d& box) { box_ = box, ++started_; }
  TrackResult follow(const Frame&) {
    box_.x += 1, ++followed_;
    TrackResult result = standing();
    result.confidence = 1;
    return result;
  }
  void visit_learned(StateArchive& archive) {
    archive(box_.x), archive(box_.y), archive(box_.width), archive(box_.height);
  }

  cv::Rect2d box_;
  int started_ = 0, followed_ = 0;
};
using Gated = GatedTracker<Drifting>;
struct NewGated : Gated {
  NewGated() : Gated(Drifting()) {}
};
static_assert(FrameTracker<Drifting> && FrameTracker<Gated> && Stateful<Gated>);
static_assert(FrameTracker<GatedTracker<AnyTracker>> && Stateful<GatedTracker<AnyTracker>>);

cv::Mat noise(std::uint64_t seed = 1) {
  cv::Mat image(60, 80, CV_8UC1);
  cv::RNG(seed).fill(image, cv::RNG::UNIFORM, 0, 255);
  return image;
}
cv::Mat blank() { return cv::Mat::zeros(60, 80, CV_8UC1); }
const cv::Rect2d kBox(20, 20, 20, 20);

template <class T>
class TrackerBaseOf : public ::testing::Test {};
using Kinds = ::testing::Types<Drifting, NewGated>;
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
  EXPECT_EQ(tracker.tracker().started(), 0);
  EXPECT_THROW(tracker.update(noise()), std::logic_error);
}

TYPED_TEST(TrackerBaseOf, GoesOnFromWhatWasSaved) {
  TypeParam tracker, restored;
  tracker.init(noise(), kBox);
  tracker.update(noise());
  restore_state(restored, save_state(tracker));
  EXPECT_EQ(restored.update(noise()).box, tracker.update(noise()).box);
}

TEST(GatedTracker, RefusesToStartOnNothing) {
  Gated gated{Drifting()};
  Drifting ungated;
  gated.init(noise(), kBox), ungated.init(noise(), kBox);
  EXPECT_THROW(gated.init(blank(), cv::Rect2d(0, 0, 5, 5)), std::invalid_argument);
  EXPECT_EQ(gated.tracker().started(), 1);
  EXPECT_EQ(gated.update(noise()).box, kBox + cv::Point2d(1, 0));  // as before
  EXPECT_NO_THROW(ungated.init(blank(), cv::Rect2d(0, 0, 5, 5)));
  EXPECT_EQ(ungated.started(), 2);
  EXPECT_EQ(ungated.update(blank()).box, cv::Rect2d(1, 0, 5, 5));
}

TEST(GatedTracker, StandsInAnInterruption) {
  Gated gated{Drifting()};
  Drifting ungated;
  gated.init(noise(), kBox), ungated.init(noise(), kBox);
  const TrackResult stays = gated.update(blank()), goes = ungated.update(blank());
  EXPECT_TRUE(stays.interrupted && stays.lost);
  EXPECT_EQ(stays.confidence, 0);
  EXPECT_EQ(stays.box, kBox);
  ASSERT_EQ(stays.parts.size(), 1u);
  EXPECT_EQ(stays.parts[0].position, centre_of(kBox));
  EXPECT_EQ(gated.tracker().followed(), 0);
  EXPECT_FALSE(goes.interrupted);
  EXPECT_EQ(ungated.followed(), 1);
}

// A tracker as a user may write it: it takes images alone, cannot be saved, throws or returns no box at will.
struct OfAUser {
  void init(const cv::Mat&, const cv::Rect2d& start) { box = start; }
  TrackResult update(const cv::Mat& image) {
    if (!box) throw std::logic_error("OfAUser: update before init");
    if (*fails) throw std::runtime_error("OfAUser: failed");
    box->x += 1;
    TrackResult result;
    result.box = *empty != 0 ? cv::Rect2d(box->x, box->y, *empty, 0) : *box;
    result.confidence = cv::mean(image)[0] < 127 ? 1 : 0;  // not found in inverted frames
    return result;
  }
  std::shared_ptr<bool> fails = std::make_shared<bool>(false);
  std::shared_ptr<double> empty = std::make_shared<double>(0);
  std::optional<cv::Rect2d> box = {};
};
static_assert(!Stateful<GatedTracker<OfAUser>> && std::copyable<GatedTracker<OfAUser>>);

cv::Mat scene(bool inverted = false) {
  cv::Mat image = noise() / 2;
  if (inverted) cv::bitwise_not(image, image);
  return image;
}

TEST(GatedTracker, GoesAroundATrackerOfAUser) {
  GatedTracker tracker{OfAUser()};
  EXPECT_THROW(tracker.update(scene()), std::logic_error);
  tracker.init(scene(), kBox);
  EXPECT_EQ(tracker.update(scene()).box, kBox + cv::Point2d(1, 0));
  EXPECT_EQ(tracker.update(blank()).box, kBox + cv::Point2d(1, 0));
  for (int i = 0; i < 3; ++i) {
    const TrackResult held = tracker.update(scene(true));
    EXPECT_TRUE(held.interrupted);
    EXPECT_EQ(held.box, kBox + cv::Point2d(1, 0));
  }
  EXPECT_EQ(tracker.tracker().box, kBox + cv::Point2d(4, 0));
  EXPECT_EQ(tracker.update(scene()).box, kBox + cv::Point2d(2, 0));  // the copy goes on
}

// Whatever the frame is, it is as if it had not been shown.
TEST(GatedTracker, GoesOnAfterATrackerThatThrows) {
  for (const bool inverted : {false, true}) {
    OfAUser user;
    GatedTracker tracker{user};
    tracker.init(scene(), kBox);
    tracker.update(scene());
    tracker.update(scene(true));
    *user.fails = true;
    EXPECT_THROW(tracker.update(scene(inverted)), std::runtime_error);
    EXPECT_THROW(tracker.update(scene(inverted)), std::runtime_error);
    *user.fails = false;
    EXPECT_EQ(tracker.update(scene()).box, kBox + cv::Point2d(2, 0));
  }
}

TEST(GatedTracker, RepeatsTheLastBoxThatWasOne) {
  for (const double width : {0.5, std::numeric_limits<double>::quiet_NaN()}) {
    OfAUser user;
    GatedTracker tracker{user};
    tracker.init(scene(), kBox);
    *user.empty = width;
    EXPECT_EQ(tracker.update(scene()).box.height, 0);
    EXPECT_EQ(tracker.update(blank()).box, kBox);
  }
}

}  // namespace
}  // namespace asterism
