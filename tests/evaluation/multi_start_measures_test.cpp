#include "multi_start_measures.hpp"

#include <gtest/gtest.h>

#include <numeric>
#include <stdexcept>

namespace asterism::bench {
namespace {

using Anchors = std::vector<Anchor>;

/// The anchor, `good` frames of this overlap, and `lost` frames of .1, which is low.
AnchorRun run(std::size_t good, double overlap, std::size_t lost = 0) {
  AnchorRun result{.overlaps = {1}, .visible = std::vector<bool>(1 + good + lost, true)};
  result.overlaps.insert(result.overlaps.end(), good, overlap);
  result.overlaps.insert(result.overlaps.end(), lost, 0.1);
  return result;
}

TEST(Anchors, AreThoseOfTheDataSetForwardFirst) {
  EXPECT_EQ(anchors(std::vector{1, 0, -1, 1, -1}), (Anchors{{0, true}, {3, true}, {2, false}, {4, false}}));
  EXPECT_TRUE(anchors({}).empty());
}

TEST(Anchors, RegularOnesRunTowardTheFartherEnd) {
  EXPECT_EQ(regular_anchors(120), (Anchors{{0, true}, {50, true}, {100, false}, {119, false}}));
  EXPECT_EQ(regular_anchors(101), (Anchors{{0, true}, {50, true}, {100, false}}));
  EXPECT_EQ(regular_anchors(1), (Anchors{{0, true}}));
  EXPECT_TRUE(regular_anchors(0).empty());
  EXPECT_THROW(regular_anchors(10, 0), std::invalid_argument);
}

TEST(FramesTracked, EndWithTenLowOverlapsInARow) {
  EXPECT_EQ(frames_tracked(run(9, 0.8, 10)), 10U);
  EXPECT_EQ(frames_tracked(run(9, 0.8, 9)), 19U) << "nine are no failure";
  EXPECT_EQ(frames_tracked(run(0, 0, 9)), 0U) << "the anchor's overlap counts as 0";
  AnchorRun absent = run(9, 0.8, 10);
  absent.visible[15] = false;
  EXPECT_EQ(frames_tracked(absent), 20U) << "a frame without target ends the row";
}

TEST(MultiStart, ScoreByHand) {
  // 10 of 20 frames with a sum of 9 x .8, and all 12 frames with a sum of 11 x .6; the sequences have 30 and
  // 12 frames.
  const std::vector<MultiStartSequence> sequences = {{30, {run(9, 0.8, 10)}}, {12, {run(11, 0.6)}}};
  const MultiStartScore score = multi_start_score(sequences);
  EXPECT_NEAR(score.accuracy, (9 * 0.8 + 11 * 0.6) / 22, 1e-15);
  EXPECT_NEAR(score.robustness, (0.5 * 30 + 1.0 * 12) / 42, 1e-15);
}

TEST(MultiStart, CurveByHand) {
  const std::vector<MultiStartSequence> sequences = {{30, {run(9, 0.8, 10)}}, {12, {run(11, 0.6)}}};
  const std::vector<double> curve = multi_start_eao_curve(sequences, 25);
  ASSERT_EQ(curve.size(), 25U);
  EXPECT_EQ(curve[0], 0);
  EXPECT_NEAR(curve[1], (0.8 + 0.6) / 2, 1e-14);
  EXPECT_NEAR(curve[11], (9 * 0.8 / 11 + 0.6) / 2, 1e-14);
  EXPECT_NEAR(curve[12], 9 * 0.8 / 12, 1e-14) << "the second run is over";
  EXPECT_NEAR(curve[19], 9 * 0.8 / 19, 1e-14);
  EXPECT_NEAR(curve[20], 9 * 0.8 / 19, 1e-14) << "beyond the run that failed, divided by one frame fewer";
  EXPECT_NEAR(multi_start_eao(sequences, {11, 13}), (curve[11] + curve[12]) / 2, 1e-15);
}

TEST(MultiStart, OfAConstantOverlapIsNearlyThatOverlap) {
  const std::vector<MultiStartSequence> sequences = {{800, {run(799, 0.6), run(780, 0.6)}}};
  EXPECT_NEAR(multi_start_eao(sequences), 0.6, 1e-12);
  EXPECT_NEAR(multi_start_score(sequences).accuracy, 0.6 * (799 + 780) / (800 + 781), 1e-12)
      << "anchors count with overlap 0";
  EXPECT_EQ(multi_start_score(sequences).robustness, 1);
}

TEST(MultiStart, CurveIsZeroWhereNoRunIsSoLong) {
  const std::vector<MultiStartSequence> sequences = {{5, {run(4, 0.5)}}};
  EXPECT_EQ(multi_start_eao_curve(sequences, 7), (std::vector<double>{0, 0.5, 0.5, 0.5, 0.5, 0, 0}));
}

TEST(MultiStart, RefusesWhatDoesNotFit) {
  EXPECT_THROW(multi_start_score({}), std::invalid_argument);
  EXPECT_THROW(multi_start_score(std::vector<MultiStartSequence>(1)), std::invalid_argument);
  std::vector<MultiStartSequence> sequences = {{5, {run(4, 0.5)}}};
  EXPECT_THROW(multi_start_eao(sequences, {5, 5}), std::invalid_argument);
  sequences[0].runs[0].visible.pop_back();
  EXPECT_THROW(multi_start_eao_curve(sequences, 7), std::invalid_argument);
}

}  // namespace
}  // namespace asterism::bench
