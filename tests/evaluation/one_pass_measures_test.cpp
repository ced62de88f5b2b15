#include "one_pass_measures.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

namespace asterism::bench {
namespace {

using Boxes = std::vector<OtbBox>;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

OnePassScore score(const OnePassRun& run) { return one_pass_score(std::vector<OnePassSequence>{{{run}}}); }

/// A run with these overlaps and zero errors.
OnePassRun overlapping(std::vector<double> overlaps) {
  const std::vector<double> zeros(overlaps.size());
  return {std::move(overlaps), zeros, zeros};
}

TEST(Compare, BoxesByHand) {
  const Boxes truth(2, {1, 1, 10, 10});
  const OnePassRun run = compare(Boxes{{90, 90, 1, 1}, {6, 1, 10, 10}}, truth);
  EXPECT_EQ(run.overlaps[0], 1) << "the first frame counts as the ground truth";
  EXPECT_EQ(run.centre_errors[0], 0);
  EXPECT_NEAR(run.overlaps[1], 50.0 / 150, 1e-15);
  EXPECT_NEAR(run.centre_errors[1], 5, 1e-15);
  EXPECT_NEAR(run.normalised_errors[1], 0.5, 1e-15);
  EXPECT_EQ(compare(truth, Boxes{{1, 1, 10, 10}, {20, 1, 10, 10}}).overlaps[1], 0);
}

TEST(Compare, AResultThatIsNoBoxRepeatsTheOneBefore) {
  const Boxes truth(4, {1, 1, 10, 10});
  const OnePassRun run =
      compare(Boxes{{1, 1, 10, 10}, {6, 1, 10, 10}, {kNaN, kNaN, kNaN, kNaN}, {1, 1, 0, 10}}, truth);
  EXPECT_EQ(run.overlaps[2], run.overlaps[1]);
  EXPECT_EQ(run.overlaps[3], run.overlaps[1]);
}

TEST(Compare, AResultThatIsNoBoxWhereThereIsNoTruthIsNotRepeated) {
  const OtbBox box = {1, 1, 10, 10}, none = {kNaN, kNaN, kNaN, kNaN};
  const OnePassRun run = compare(Boxes{box, box, none, none}, Boxes{box, box, none, box});
  EXPECT_EQ(run.overlaps, (std::vector<double>{1, 1, -1, 1}));
}

TEST(Compare, FramesWithoutGroundTruthAreMarked) {
  const Boxes truth = {{1, 1, 10, 10}, {kNaN, kNaN, kNaN, kNaN}, {0, 1, 10, 10}, {1, 1, 0, 0}};
  const OnePassRun run = compare(Boxes(4, {1, 1, 10, 10}), truth);
  EXPECT_EQ(run.overlaps, (std::vector<double>{1, -1, -1, -1}));
  EXPECT_EQ(run.centre_errors, (std::vector<double>{0, -1, -1, -1}));
  // Counted from 0, a box may begin at the border of the image, or outside.
  const Boxes from_zero = {{1, 1, 10, 10}, {0, 0, 10, 10}, {-5, 1, 10, 10}, {1, 1, 0, 10}};
  EXPECT_EQ(compare(from_zero, from_zero, false).overlaps, (std::vector<double>{1, 1, 1, -1}));
  EXPECT_EQ(compare(from_zero, from_zero).overlaps, (std::vector<double>{1, -1, -1, -1}));
  EXPECT_EQ(compare(Boxes(2, {1, 1, 10, 10}), Boxes{{1, 1, 10, 10}, {kNaN, 1, 10, 10}}, false).overlaps[1],
            -1);
  EXPECT_THROW(compare(truth, Boxes(3)), std::invalid_argument);
  EXPECT_THROW(compare(Boxes(), Boxes()), std::invalid_argument);
}

TEST(Compare, FramesAfterTheLastResultAreMisses) {
  const OtbBox box = {1, 1, 10, 10}, none = {kNaN, kNaN, kNaN, kNaN};
  const Boxes truth = {box, box, box, none};
  const OnePassRun run = compare(Boxes(2, box), truth);
  EXPECT_EQ(run.overlaps, (std::vector<double>{1, 1, 0, -1}));
  EXPECT_EQ(run.centre_errors[2], std::numeric_limits<double>::infinity());
  EXPECT_EQ(run.normalised_errors[2], std::numeric_limits<double>::infinity());
  EXPECT_EQ(compare({}, truth).overlaps, (std::vector<double>{0, 0, 0, -1}));
}

TEST(OnePassScore, APerfectTrackerMissesTheLastThreshold) {
  const OnePassScore perfect = score(overlapping(std::vector<double>(10, 1)));
  EXPECT_NEAR(perfect.auc(), 20.0 / 21, 1e-15);
  EXPECT_EQ(perfect.success[19], 1);
  EXPECT_EQ(perfect.success[20], 0);
  EXPECT_EQ(perfect.average_overlap, 1);
  EXPECT_EQ(perfect.precision[0], 1);
  EXPECT_EQ(perfect.normalised_precision_at_20(), 1);
}

// A test set gives only the first box; a mean over no frames is NaN, not 0.
TEST(OnePassScore, OfFramesWithoutGroundTruthIsNone) {
  const OnePassRun unknown{{1, -1, -1}, {0, -1, -1}, {0, -1, -1}};
  for (const OnePassRun& run : {unknown, overlapping({1})}) {
    const OnePassScore nothing = score(run);
    EXPECT_TRUE(std::isnan(nothing.average_overlap));
    EXPECT_TRUE(std::isnan(nothing.auc()));
    EXPECT_TRUE(std::isnan(nothing.precision_at_20()));
    EXPECT_TRUE(std::isnan(nothing.normalised_precision_at_20()));
  }
  const OnePassRun half = overlapping({1, 0.5, 0.5});
  const std::vector<OnePassSequence> sequences = {{{half}}, {{unknown}}, {{overlapping({1})}}};
  EXPECT_EQ(one_pass_score(sequences).average_overlap, 0.5);
  EXPECT_EQ(one_pass_score(sequences).auc(), score(half).auc());
  EXPECT_EQ(one_pass_score(sequences).precision, score(half).precision);
}

TEST(OnePassScore, EachFrameAddsItsOverlapRoundedUpToTwentieths) {
  const std::vector<double> overlaps = {1, 0.5, 0.51, 0.04, 0, 0.999};
  const double expected = (20 + 10 + 11 + 1 + 0 + 20) / 21.0 / 6;
  EXPECT_NEAR(score(overlapping(overlaps)).auc(), expected, 1e-15);
  EXPECT_NEAR(score(overlapping(overlaps)).average_overlap, (0.5 + 0.51 + 0.04 + 0 + 0.999) / 5, 1e-15);
}

TEST(OnePassScore, FramesWithoutGroundTruthMissOverlapsAndMeetPrecisions) {
  const OnePassScore half = score({{1, 0.8, -1, -1}, {0, 20.5, -1, -1}, {0, 0.205, -1, -1}});
  EXPECT_NEAR(half.success[0], 0.5, 1e-15);
  EXPECT_NEAR(half.average_overlap, 0.8, 1e-15);
  EXPECT_NEAR(half.precision_at_20(), 0.75, 1e-15);
  EXPECT_NEAR(half.precision[21], 1, 1e-15);
  EXPECT_NEAR(half.normalised_precision_at_20(), 0.75, 1e-15);
}

TEST(OnePassScore, RunsPoolFramesAndSequencesHaveEqualWeights) {
  const OnePassRun good = overlapping({1, 1, 1, 1, 1, 1}), bad = overlapping({0, 0});
  const std::vector<OnePassSequence> sequences = {{{good, bad}}, {{bad}}};
  EXPECT_NEAR(one_pass_score(sequences).success[10], (6.0 / 8 + 0) / 2, 1e-15);
  const std::vector<OnePassSequence> reversed(sequences.rbegin(), sequences.rend());
  EXPECT_NEAR(one_pass_score(reversed).auc(), one_pass_score(sequences).auc(), 1e-15);
  EXPECT_THROW(one_pass_score({}), std::invalid_argument);
  EXPECT_THROW(one_pass_score(std::vector<OnePassSequence>(1)), std::invalid_argument);
  EXPECT_THROW(score({}), std::invalid_argument);
}

TEST(TemporalStarts, AreTwentyFromTheFirstFrameToTheLastWithTwentyLeft) {
  // floor(1 + 81 k / 19), and 81, minus 1: frame 80 is the last start with 20 frames.
  EXPECT_EQ(temporal_starts(std::vector<bool>(100, true)),
            (std::vector<std::size_t>{0,  4,  8,  12, 17, 21, 25, 29, 34, 38,
                                      42, 46, 51, 55, 59, 63, 68, 72, 76, 80}));
}

TEST(TemporalStarts, AreUsableFrames) {
  std::vector<bool> usable(400, true);
  std::fill_n(usable.begin(), 50, false);
  std::fill_n(usable.begin() + 100, 200, false);
  const std::vector<std::size_t> starts = temporal_starts(usable);
  EXPECT_EQ(starts.size(), 20U);
  EXPECT_EQ(starts.front(), 50U);
  EXPECT_EQ(starts.back(), 380U);
  EXPECT_TRUE(std::ranges::is_sorted(starts));
  EXPECT_TRUE(std::ranges::all_of(starts, [&](std::size_t t) { return usable[t]; }));
}

TEST(TemporalStarts, OfShortSequencesAreFewerAndRepeat) {
  EXPECT_EQ(temporal_starts(std::vector<bool>(20, true)), (std::vector<std::size_t>{0, 0}));
  EXPECT_THROW(temporal_starts(std::vector<bool>(19, true)), std::invalid_argument);
  EXPECT_THROW(temporal_starts(std::vector<bool>(100)), std::invalid_argument);
  EXPECT_THROW(temporal_starts(std::vector<bool>(100, true), 1), std::invalid_argument);
}

TEST(SpatialStarts, ByHand) {
  const auto starts = spatial_starts({50, 40, 30, 20}, 200, 100);
  const std::array<OtbBox, 12> expected = {{{47, 40, 30, 20},
                                            {53, 40, 30, 20},
                                            {50, 38, 30, 20},
                                            {50, 42, 30, 20},
                                            {47, 38, 33, 22},  // corners moved out by 3 and 2
                                            {50, 38, 33, 22},
                                            {47, 40, 33, 22},
                                            {50, 40, 33, 22},
                                            {53, 42, 24, 16},  // around (65, 50)
                                            {52, 41, 27, 18},  // 51.5 is rounded up
                                            {49, 39, 33, 22},
                                            {47, 38, 36, 24}}};
  for (std::size_t i = 0; i < starts.size(); ++i) EXPECT_EQ(starts[i], expected[i]) << i;
}

TEST(SpatialStarts, AreClippedToTheImage) {
  for (const OtbBox& box : spatial_starts({1, 2, 95, 45}, 96, 48)) {
    EXPECT_GE(box.left, 1);
    EXPECT_GE(box.top, 1);
    EXPECT_LE(box.left + box.width - 1, 96);
    EXPECT_LE(box.top + box.height - 1, 48);
  }
}

}  // namespace
}  // namespace asterism::bench
