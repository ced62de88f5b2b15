#include "supervised_measures.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace asterism::bench {
namespace {

using Sequences = std::vector<SupervisedSequence>;

/// A run written as one character per frame: S start, F failure, - skipped, 0 to 9 the overlap in tenths.
SupervisedRun run(std::string_view frames) {
  SupervisedRun result;
  for (const char frame : frames) {
    result.outcomes.push_back(frame == 'S'   ? Outcome::Started
                              : frame == 'F' ? Outcome::Failed
                              : frame == '-' ? Outcome::Skipped
                                             : Outcome::Tracked);
    result.overlaps.push_back(result.outcomes.back() == Outcome::Tracked ? (frame - '0') / 10.0
                                                                         : std::nan(""));
  }
  return result;
}

SupervisedSequence sequence(std::initializer_list<std::string_view> runs) {
  SupervisedSequence result;
  for (const std::string_view frames : runs) result.runs.push_back(run(frames));
  return result;
}

std::vector<bool> frames(std::string_view marks) {
  std::vector<bool> result;
  for (const char mark : marks) result.push_back(mark == 'x');
  return result;
}

std::string start_and(std::size_t tracked, char tenths) {
  std::string frames(1 + tracked, tenths);
  frames[0] = 'S';
  return frames;
}

void expect_close(const std::vector<double>& actual, const std::vector<double>& expected) {
  ASSERT_EQ(actual.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_NEAR(actual[i], expected[i], 1e-14) << i;
}

// 12 frames, 2 of them after the burn-in, at .5; and 31 with 2 frames at .6, a failure, and 4 at .8.
const Sequences kTwo = {sequence({"S55555555555"}), sequence({"S66666666666F----S8888888888888"})};

TEST(AccuracyRobustness, PythonWeighsSequencesByLength) {
  const AccuracyRobustness measures = accuracy_robustness(kTwo, Toolkit::Python);
  EXPECT_NEAR(measures.accuracy, (12 * 0.5 + 31 * (2 * 0.6 + 4 * 0.8) / 6) / 43, 1e-14);
  EXPECT_NEAR(measures.failures, 31.0 / 43, 1e-14);
  EXPECT_NEAR(measures.failure_rate, 31.0 / 43 / 21.5, 1e-14) << "a mean sequence has 21.5 frames";
  EXPECT_NEAR(measures.reliability(), std::exp(-30 * 31.0 / 43 / 21.5), 1e-14);
}

TEST(AccuracyRobustness, LegacyPoolsFrames) {
  const AccuracyRobustness measures = accuracy_robustness(kTwo, Toolkit::Legacy);
  EXPECT_NEAR(measures.accuracy, (2 * 0.5 + 2 * 0.6 + 4 * 0.8) / 8, 1e-14);
  EXPECT_NEAR(measures.failures, 1, 1e-14);
  EXPECT_NEAR(measures.failure_rate, 1.0 / 43, 1e-14);
  EXPECT_NEAR(measures.reliability(100), std::exp(-100.0 / 43), 1e-14);
}

TEST(AccuracyRobustness, RepetitionsAreAveragedByRunOrByFrame) {
  const Sequences sequences = {sequence({"S44444444444", "S8888888888F"})};
  // Frame 11 has .4 and .8, frame 12 only .4.
  EXPECT_NEAR(accuracy_robustness(sequences, Toolkit::Legacy).accuracy, (0.6 + 0.4) / 2, 1e-14);
  EXPECT_NEAR(accuracy_robustness(sequences, Toolkit::Python).accuracy, (0.4 + 0.8) / 2, 1e-14);
  EXPECT_NEAR(accuracy_robustness(sequences, Toolkit::Legacy).failures, 0.5, 1e-14);
  EXPECT_NEAR(accuracy_robustness(sequences, Toolkit::Python).failures, 0.5, 1e-14);
}

TEST(AccuracyRobustness, IsThatOfAPerfectTrackerAndOfOneThatNeverGetsFar) {
  SupervisedSequence perfect = sequence({start_and(29, '0')});
  std::ranges::fill(perfect.runs[0].overlaps, 1);
  for (const Toolkit toolkit : {Toolkit::Python, Toolkit::Legacy}) {
    const AccuracyRobustness best = accuracy_robustness(Sequences{perfect}, toolkit);
    EXPECT_EQ(best.accuracy, 1);
    EXPECT_EQ(best.failures, 0);
    EXPECT_EQ(best.reliability(), 1);
    const AccuracyRobustness worst = accuracy_robustness(Sequences{sequence({"S9F----S9F--"})}, toolkit);
    EXPECT_EQ(worst.accuracy, 0) << "no frame is left after the burn-in";
    EXPECT_EQ(worst.failures, 2);
  }
}

TEST(AccuracyRobustness, DoesNotDependOnTheOrderOfSequences) {
  const Sequences reversed(kTwo.rbegin(), kTwo.rend());
  for (const Toolkit toolkit : {Toolkit::Python, Toolkit::Legacy}) {
    EXPECT_NEAR(accuracy_robustness(reversed, toolkit).accuracy, accuracy_robustness(kTwo, toolkit).accuracy,
                1e-15);
    expect_close(eao_curve(reversed, toolkit), eao_curve(kTwo, toolkit));
  }
}

TEST(Tags, BurnInCountsTaggedFramesFromATaggedStart) {
  SupervisedSequence tagged = sequence({"S0123456789123F"});
  tagged.tags["late"] = frames("-----xxxxxxxxxx");
  tagged.tags["both"] = frames("x---xxxxxxxxxxx");
  const Sequences sequences = {tagged};
  EXPECT_EQ(tags(sequences), (std::vector<std::string>{"both", "empty", "late"}));
  // The start is not tagged: frames 6 to 14 count, .4 to .9 and .1 to .3.
  EXPECT_NEAR(accuracy_robustness(sequences, Toolkit::Legacy, "late").accuracy, 4.5 / 9, 1e-14);
  // The start is tagged: of the tagged frames, the burn-in takes the first and the nine from the fifth on.
  EXPECT_NEAR(accuracy_robustness(sequences, Toolkit::Legacy, "both").accuracy, 0.3, 1e-14);
  // Frames 2 to 4 have no tag, and no start among them.
  EXPECT_NEAR(accuracy_robustness(sequences, Toolkit::Legacy, kUntagged).accuracy, (0 + 0.1 + 0.2) / 3,
              1e-14);
  EXPECT_EQ(accuracy_robustness(sequences, Toolkit::Legacy, "late").failures, 1);
  EXPECT_NEAR(accuracy_robustness(sequences, Toolkit::Legacy, "late").failure_rate, 1.0 / 10, 1e-14);
  EXPECT_EQ(accuracy_robustness(sequences, Toolkit::Legacy, kUntagged).failures, 0);
  EXPECT_EQ(accuracy_robustness(sequences, Toolkit::Legacy, "none such").accuracy, 0);
  EXPECT_THROW(accuracy_robustness(sequences, Toolkit::Python, "late"), std::invalid_argument);
  // 10 frames of late, 12 of both, 3 of none.
  const AccuracyRobustness mean = mean_over_tags(sequences);
  EXPECT_NEAR(mean.accuracy, (10 * 0.5 + 12 * 0.3 + 3 * 0.1) / 25, 1e-14);
  EXPECT_NEAR(mean.failures, (10 + 12) / 25.0, 1e-14);
  EXPECT_NEAR(mean.failure_rate, 2 / 25.0, 1e-14);
}

TEST(Tags, NamesNoneWithoutTags) {
  EXPECT_TRUE(tags(kTwo).empty());
  EXPECT_THROW(mean_over_tags(kTwo), std::invalid_argument);
}

// Run 1 splits into "S66F-S", which failed, and "S66", which survived; run 2 survived.
const Sequences kShort = {sequence({"S66F-S66"}), sequence({"S88888"})};

TEST(Eao, LegacyCurveByHand) {
  const double after_3 = (0.6 + 0.6 + 0.8) / 3;
  expect_close(
      eao_curve(kShort, Toolkit::Legacy),
      {1, after_3, after_3, (1.2 / 3 + 0.8) / 2, (1.2 / 4 + 0.8) / 2, (1.2 / 5 + 0.8) / 2, 1.2 / 6, 1.2 / 7});
  EXPECT_NEAR(eao(kShort, {3, 5}, Toolkit::Legacy), (after_3 + 0.6 + 0.55) / 3, 1e-14);
}

TEST(Eao, PythonCurveEndsWithTheLongestFragmentAndItsIntervalIsOneFrameLater) {
  const double after_3 = (0.6 + 0.6 + 0.8) / 3;
  expect_close(eao_curve(kShort, Toolkit::Python), {0, after_3, after_3, 0.6, 0.55, 0.52});
  EXPECT_NEAR(eao(kShort, {3, 5}, Toolkit::Python), (0.6 + 0.55 + 0.52) / 3, 1e-14);
  EXPECT_NEAR(eao(kShort, {4, 100}, Toolkit::Python), (0.55 + 0.52) / 2, 1e-14) << "what the curve has";
  EXPECT_TRUE(std::isnan(eao(kShort, {6, 7}, Toolkit::Python)));
}

TEST(Eao, TooLateAFailureSurvivesInTheLegacyToolkit) {
  const Sequences sequences = {sequence({"S666F--"}), sequence({"S88888888"})};
  const std::vector<double> legacy = eao_curve(sequences, Toolkit::Legacy);
  EXPECT_NEAR(legacy[6], (1.8 / 6 + 0.8) / 2, 1e-14);
  EXPECT_NEAR(legacy[7], 0.8, 1e-14) << "the first run was not that long";
  EXPECT_NEAR(eao_curve(sequences, Toolkit::Python)[7], (1.8 / 7 + 0.8) / 2, 1e-14);
}

TEST(Eao, RunsShareTheWeightOfTheirSequenceInTheLegacyToolkit) {
  const Sequences sequences = {sequence({"S2222"}), sequence({"S8888", "S8888", "S8888"})};
  EXPECT_NEAR(eao(sequences, {2, 4}, Toolkit::Legacy), (0.2 + 0.8) / 2, 1e-14);
  EXPECT_NEAR(eao(sequences, {2, 4}, Toolkit::Python), (0.2 + 3 * 0.8) / 4, 1e-14);
}

TEST(Eao, FragmentsWeighAsMuchOfThemAsIsTagged) {
  Sequences sequences = {sequence({"S222222222"}), sequence({"S888888888"})};
  sequences[0].tags["a"] = frames("xxxxx-----");
  sequences[1].tags["a"] = frames("xxxxxxxxxx");
  EXPECT_NEAR(eao(sequences, {2, 10}, Toolkit::Legacy, "a"), (0.5 * 0.2 + 0.8) / 1.5, 1e-14);
  EXPECT_TRUE(std::isnan(eao(sequences, {2, 10}, Toolkit::Legacy, "none such")));

  // For untagged frames, the toolkit counts all four of the sequence in each fragment, of 6 and of 3 frames.
  Sequences untagged = {sequence({"S66F-S99"})};
  untagged[0].tags["a"] = frames("xxxx----");
  EXPECT_NEAR(eao_curve(untagged, Toolkit::Legacy, kUntagged)[1], (4.0 / 6 * 0.6 + 4.0 / 3 * 0.9) / 2, 1e-14);
}

TEST(Eao, OfAConstantOverlapIsThatOverlap) {
  const Sequences sequences = {sequence({start_and(40, '7')}), sequence({start_and(90, '7')})};
  for (const Toolkit toolkit : {Toolkit::Python, Toolkit::Legacy}) {
    EXPECT_NEAR(eao(sequences, {20, 60}, toolkit), 0.7, 1e-14);
  }
}

TEST(TypicalLengths, AreThoseOfTheBenchmarks) {
  const std::vector<std::size_t> vot2014 = {602, 725, 271, 350, 252, 770, 219, 1210, 292, 436, 310, 207, 244,
                                            267, 307, 164, 371, 400, 201, 172, 282,  264, 569, 731, 597};
  const TypicalLengths lengths2014 = typical_lengths(vot2014);
  EXPECT_EQ(lengths2014.mode, 266U);
  EXPECT_EQ(lengths2014.interval.low, 166U);
  EXPECT_EQ(lengths2014.interval.high, 377U);

  const std::vector<std::size_t> vot2015 = {
      196, 105,  41,  725, 339, 539, 225, 76,  350, 293, 175, 151, 742, 393, 131, 326, 292, 366, 310, 519,
      682, 1500, 120, 366, 844, 567, 240, 118, 465, 267, 377, 402, 708, 661, 707, 63,  201, 100, 164, 61,
      999, 291,  140, 713, 158, 156, 558, 365, 251, 351, 366, 131, 392, 128, 138, 201, 365, 191, 731, 341};
  const TypicalLengths lengths2015 = typical_lengths(vot2015);
  EXPECT_EQ(lengths2015.interval.low, 100U);
  EXPECT_EQ(lengths2015.interval.high, 371U);
  EXPECT_THROW(typical_lengths(std::vector<std::size_t>{100, 100}), std::invalid_argument);
}

/// Two sequences with 50 counted frames; 15 equal runs of each.
Sequences tracker(double even, double odd, bool fails = false) {
  SupervisedSequence one = sequence({start_and(59, '0')});
  for (std::size_t t = 0; t < 60; ++t) one.runs[0].overlaps[t] = t % 2 == 0 ? even : odd;
  if (fails) one.runs[0].outcomes.back() = Outcome::Failed;
  one.runs.resize(15, one.runs[0]);
  return {one, one};
}

TEST(ArRanks, TrackersThatDoNotDifferShareARank) {
  // The first differs from the second by +-1/4 in as many frames, from the third by 3/8 in all.
  const std::vector<Sequences> trackers = {tracker(0.5, 0.5), tracker(0.25, 0.75),
                                           tracker(0.125, 0.125, true)};
  const ArRanks ranks = ar_ranks(trackers);
  expect_close(ranks.accuracy, {1.5, 1.5, 3});
  expect_close(ranks.robustness, {1.5, 1.5, 3});  // no failure in 30 runs against one in each of 30
}

TEST(ArRanks, AccuracyMustDifferInPracticeToo) {
  std::vector<Sequences> trackers = {tracker(0.8, 0.8), tracker(0.5, 0.5)};
  expect_close(ar_ranks(trackers).accuracy, {1, 2});
  for (SupervisedSequence& sequence : trackers[0]) sequence.practical_difference.assign(60, 0.4);
  expect_close(ar_ranks(trackers).accuracy, {1.5, 1.5});  // .3 / .4 < 1
  expect_close(ar_ranks(trackers, kAllFrames, {.practical = false}).accuracy, {1, 2});
  expect_close(ar_ranks(trackers).robustness, {1.5, 1.5});
}

TEST(ArRanks, FewRepetitionsAreFilledUp) {
  std::vector<Sequences> trackers = {tracker(0.8, 0.8), tracker(0.8, 0.8, true)};
  for (Sequences& sequences : trackers)
    for (SupervisedSequence& sequence : sequences) sequence.runs.resize(1);
  expect_close(ar_ranks(trackers).robustness, {1, 2});
  // Two failures against none: p = 2 / C(4, 2) = 1 / 3.
  expect_close(ar_ranks(trackers, kAllFrames, {.repetitions = 1}).robustness, {1.5, 1.5});
}

TEST(ArRanks, OfTagsHaveEqualWeights) {
  std::vector<Sequences> trackers = {tracker(0.8, 0.8), tracker(0.5, 0.5, true)};
  for (SupervisedSequence& sequence : trackers[0]) {
    sequence.tags["few"] = std::vector<bool>(60);
    sequence.tags["few"][59] = true;
  }
  // The tag has one frame per sequence: too few to compare, which counts as different. Robustness differs
  // only there.
  expect_close(ar_ranks(trackers, "few").robustness, {1, 2});
  expect_close(ar_ranks(trackers, kUntagged).robustness, {1.5, 1.5});
  expect_close(mean_ar_ranks(trackers).robustness, {1.25, 1.75});
  expect_close(mean_ar_ranks(trackers).accuracy, {1, 2});
  EXPECT_THROW(ar_ranks(trackers, "none such"), std::invalid_argument);
}

TEST(SupervisedMeasures, RefuseWhatDoesNotFit) {
  EXPECT_THROW(accuracy_robustness(Sequences{}, Toolkit::Python), std::invalid_argument);
  EXPECT_THROW(eao_curve(Sequences{sequence({})}, Toolkit::Legacy), std::invalid_argument);
  EXPECT_THROW(eao_curve(Sequences{sequence({"S55", "S5"})}, Toolkit::Legacy), std::invalid_argument);
  Sequences tagged = {sequence({"S55"})};
  tagged[0].tags["a"] = frames("xx");
  EXPECT_THROW(tags(tagged), std::invalid_argument);
  EXPECT_THROW(eao(kShort, {5, 3}, Toolkit::Legacy), std::invalid_argument);
  EXPECT_THROW(eao(kShort, {0, 3}, Toolkit::Python), std::invalid_argument);
  EXPECT_THROW(ar_ranks(std::vector<Sequences>{}), std::invalid_argument);
  EXPECT_THROW(ar_ranks(std::vector{kTwo, kShort}), std::invalid_argument);
}

}  // namespace
}  // namespace asterism::bench
