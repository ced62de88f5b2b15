// The probability that a tracker's box is right.

#include <gtest/gtest.h>

#include <asterism/trackers/dpt/box_judge.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "moving_square.hpp"

namespace asterism {
namespace {

const cv::Rect2d kElsewhere(220, 20, 48, 40);

BoxJudge started() {
  BoxJudge judge;
  judge.init(Frame(draw_frame(0)), true_box(0));
  return judge;
}

TEST(BoxJudge, TellsTheObjectFromItsSurroundings) {
  BoxJudge judge = started();
  for (int t = 1; t <= 10; ++t) EXPECT_GT(judge.update(Frame(draw_frame(t)), true_box(t)), 0.95) << t;
  EXPECT_GT(judge.likeness().shape, 0.9);
  // The object is where the box is not. The average follows within about ten frames.
  double probability = 1;
  for (int t = 11; t <= 30; ++t) {
    const double next = judge.update(Frame(draw_frame(t)), kElsewhere);
    EXPECT_LT(next, probability) << t;
    probability = next;
  }
  EXPECT_LT(probability, BoxJudge::kLostBelow / 2);
  // The object is found again.
  for (int t = 31; t <= 50; ++t) probability = judge.update(Frame(draw_frame(t)), true_box(t));
  EXPECT_GT(probability, 0.9);
}

TEST(BoxJudge, TakesTheFirstFrameAsItIs) {
  BoxJudge judge = started();
  judge.update(Frame(draw_frame(0)), true_box(0));
  EXPECT_NEAR(judge.likeness().shape, 1, 1e-5);
  EXPECT_NEAR(judge.likeness().levels, 1, 1e-5);
  EXPECT_NEAR(judge.likeness().colors, 1, 1e-5);
  // An object twice as large, in an image twice as large, is the same.
  cv::Mat twice;
  cv::resize(draw_frame(0), twice, {}, 2, 2, cv::INTER_LINEAR);
  const cv::Rect2d box = true_box(0);
  BoxJudge larger = started();
  larger.update(Frame(twice), {2 * box.x, 2 * box.y, 2 * box.width, 2 * box.height});
  EXPECT_GT(larger.likeness().shape, 0.7);
  EXPECT_GT(larger.likeness().levels, 0.95);
  EXPECT_GT(larger.likeness().colors, 0.9);
}

// Gray images in one channel and in three equal ones are the same.
TEST(BoxJudge, TakesGrayImages) {
  cv::Mat gray, equal;
  cv::cvtColor(draw_frame(0), gray, cv::COLOR_BGR2GRAY);
  cv::cvtColor(gray, equal, cv::COLOR_GRAY2BGR);
  BoxJudge one, three;
  one.init(Frame(gray), true_box(0));
  three.init(Frame(equal), true_box(0));
  EXPECT_EQ(one.update(Frame(gray), kElsewhere), three.update(Frame(equal), kElsewhere));
}

// Without contrast, or far outside the image, the probability is a number and low.
TEST(BoxJudge, IsDefinedEverywhere) {
  const cv::Mat flat(240, 320, CV_8UC3, cv::Scalar::all(90));
  BoxJudge judge = started();
  EXPECT_LT(judge.update(Frame(flat), true_box(0)), BoxJudge::kLostBelow);
  judge = started();
  EXPECT_LT(judge.update(Frame(draw_frame(1)), {-5000, 9000, 48, 40}), BoxJudge::kLostBelow);
  judge = started();
  EXPECT_TRUE(std::isfinite(judge.update(Frame(draw_frame(1)), {60, 50, 0.01, 4000})));
  judge.init(Frame(flat), true_box(0));
  EXPECT_TRUE(std::isfinite(judge.update(Frame(flat), true_box(0))));
}

}  // namespace
}  // namespace asterism
