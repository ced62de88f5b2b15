// The object's pose, which all trackers share.

#include <gtest/gtest.h>

#include <asterism/trackers/constellation/pose.hpp>
#include <cmath>
#include <numbers>
#include <stdexcept>

namespace asterism {
namespace {

const cv::Rect2d kBox(30, 40, 20, 10);

TEST(ObjectPose, TakesPositionsInTheObjectToTheImage) {
  ObjectPose pose(kBox);
  EXPECT_LT((pose.transform()({3, -2}) - (centre_of(kBox) + Point2(3, -2))).norm(), 1e-12);
  pose.move_to({.scale = 2, .angle = std::numbers::pi / 2, .translation = {100, 50}});
  EXPECT_LT((pose.transform()({3, -2}) - Point2(104, 56)).norm(), 1e-12);
  EXPECT_EQ(pose.size(), Size2(40, 20));
  EXPECT_TRUE(pose.covers({10, 5}));
  EXPECT_FALSE(pose.covers({10, 5.1}));
}

// Two steps move the pose as their composition does.
TEST(ObjectPose, MovesByStepsAsByTheirProduct) {
  ObjectPose stepped(kBox), moved(kBox);
  const PlaneTransform step{.scale = 1.2, .angle = 0.3, .translation = {4, -1}};
  for (int i = 0; i < 2; ++i) stepped.move_by(step, step.scale);
  moved.move_to({1.44, 0.6, step(step(centre_of(kBox)))});
  EXPECT_LT((stepped.centre() - moved.centre()).norm(), 1e-12);
  EXPECT_LT((stepped.size() - moved.size()).norm(), 1e-12);
  EXPECT_NEAR(stepped.angle(), moved.angle(), 1e-12);
  EXPECT_NEAR(stepped.transform().scale, 1.44, 1e-12);
}

TEST(ObjectPose, TakesAnotherAspectRatio) {
  ObjectPose pose(kBox);
  pose.resize({40, 5});
  EXPECT_EQ(pose.size(), Size2(40, 5));
  EXPECT_NEAR(pose.transform().scale, 1, 1e-12);
  ObjectPose restored;
  restore_state(restored, save_state(pose));
  EXPECT_EQ(restored.size(), pose.size());
  pose.resize({1, 1000});
  EXPECT_EQ(pose.size(), Size2(2, 100));
}

TEST(ObjectPose, KeepsItsSizeInRange) {
  for (const double growth : {1e-3, 1e3}) {
    const double kept = growth < 1 ? ObjectPose::kMinScale : ObjectPose::kMaxScale;
    ObjectPose stepped(kBox), moved(kBox);
    stepped.move_by({}, growth);
    moved.move_to({.scale = growth, .angle = 0, .translation = {0, 0}});
    for (const ObjectPose& pose : {stepped, moved}) {
      EXPECT_LT((pose.size() - kept * Size2(20, 10)).norm(), 1e-12);
      EXPECT_EQ(pose.first_size(), Size2(20, 10));
    }
  }
}

TEST(ObjectPose, KeepsItsCentreInTheImage) {
  const Frame frame(cv::Mat::zeros(60, 80, CV_8UC1));
  ObjectPose pose(kBox);
  EXPECT_EQ(pose.keep_in(frame), Point2(0, 0));
  pose.move_to(Point2(-3, 62));
  EXPECT_EQ(pose.keep_in(frame), Point2(-3, 3));
  EXPECT_EQ(pose.centre(), Point2(0, 59));
}

TEST(ObjectPose, IsSavedAndRestored) {
  ObjectPose pose(kBox);
  pose.move_by({.scale = 1.1, .angle = 0.2, .translation = {5, 6}}, 1.3);
  ObjectPose restored;
  restore_state(restored, save_state(pose));
  EXPECT_EQ(restored.centre(), pose.centre());
  EXPECT_EQ(restored.size(), pose.size());
  EXPECT_EQ(restored.first_size(), pose.first_size());
  EXPECT_EQ(restored.angle(), pose.angle());
  EXPECT_EQ(restored.transform().scale, pose.transform().scale);
}

// The size is not the scale times the first size.
TEST(ObjectPose, RefusesAStateThatDoesNotHoldTogether) {
  StateArchive written;
  Size2 first(20, 10), size(40, 20);
  Point2 centre(1, 2);
  double angle = 0, scale = 3;
  written.size(first), written.size(size), written.position(centre), written(angle), written(scale);
  ObjectPose pose;
  const std::vector<std::byte> bytes = written.bytes();
  EXPECT_THROW(restore_state(pose, bytes), std::runtime_error);
}

}  // namespace
}  // namespace asterism
