#include "statistics.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include "supervised_measures.hpp"

namespace asterism::bench {
namespace {

using Values = std::vector<double>;

TEST(SignedRank, ExactByHand) {
  // No negative rank: 2 of 2^5 choices of signs are as extreme.
  EXPECT_NEAR(signed_rank_p(Values{1, 2, 3, 4, 5}), 2 / 32.0, 1e-15);
  // The negative ranks sum to 4: the subsets {}, 1, 2, 3, 4, 1 + 2 and 1 + 3 do not exceed it.
  EXPECT_NEAR(signed_rank_p(Values{1, 2, 3, -4}), 2 * 7 / 16.0, 1e-15);
  // Ties have rank 2 each: {} and each single one do not exceed 2.
  EXPECT_NEAR(signed_rank_p(Values{1, 1, -1}), 1, 1e-15);
  EXPECT_NEAR(signed_rank_p(Values{0, 1, std::nan(""), 2, 3, 4, 5, 0}), 2 / 32.0, 1e-15);
  EXPECT_EQ(signed_rank_p(Values{0, 0}), 1);
  EXPECT_EQ(signed_rank_p({}), 1);
}

TEST(SignedRank, NormalByHand) {
  // n = 16, all positive and equal: deviation from the mean 68, variance (16 17 33 - (16^3 - 16) / 2) / 24 =
  // 289, z = 4.
  EXPECT_NEAR(signed_rank_p(Values(16, 0.3)), std::erfc(4 / std::sqrt(2.0)), 1e-15);
}

TEST(RankSum, ExactByHand) {
  // One of C(6, 3) = 20 choices of ranks is as low, one as high.
  EXPECT_NEAR(rank_sum_p(Values{1, 2, 3}, Values{4, 5, 6}), 2 / 20.0, 1e-15);
  EXPECT_NEAR(rank_sum_p(Values{4, 5, 6}, Values{1, 2, 3}), 2 / 20.0, 1e-15);
  EXPECT_NEAR(rank_sum_p(Values{1, 1}, Values{1, 1, 1}), 1, 1e-15);
}

TEST(AreaUnderRoc, IsTheShareOfPairsInOrder) {
  std::vector<std::pair<double, bool>> scores;
  std::mt19937 random(1);
  for (int i = 0; i < 200; ++i) {
    const bool member = random() % 3 == 0;
    scores.emplace_back(static_cast<double>(random() % 20) + (member ? 5 : 0), member);  // with ties
  }
  double pairs = 0, ordered = 0;
  for (const auto& [a, member] : scores)
    for (const auto& [b, other] : scores)
      if (member && !other) pairs += 1, ordered += a > b ? 1 : a == b ? 0.5 : 0;
  EXPECT_NEAR(area_under_roc(scores), ordered / pairs, 1e-12);
  EXPECT_EQ(area_under_roc({{1, false}, {2, true}}), 1);
  EXPECT_EQ(area_under_roc({{1, true}, {2, false}}), 0);
  EXPECT_EQ(area_under_roc({{3, true}, {3, false}}), 0.5);
  const double infinity = std::numeric_limits<double>::infinity();
  EXPECT_EQ(area_under_roc({{-infinity, false}, {-infinity, true}, {1, true}}), 0.75);
  EXPECT_TRUE(std::isnan(area_under_roc({{1, true}})));
  EXPECT_TRUE(std::isnan(area_under_roc({})));
  EXPECT_THROW(area_under_roc({{std::nan(""), true}}), std::invalid_argument);
}

TEST(RankSum, NormalByHand) {
  // Twelve zeros and twelve ones: deviation from the mean 72 - .5, variance 12 (25 - 2 (12^3 - 12) / (24 23))
  // = 225.39.
  const double variance = 12 * (25 - 2 * (1728 - 12) / (24.0 * 23));
  EXPECT_NEAR(rank_sum_p(Values(12, 0), Values(12, 1)), std::erfc(71.5 / std::sqrt(2 * variance)), 1e-15);
  EXPECT_EQ(rank_sum_p(Values(20, 3), Values(20, 3)), 1);
  EXPECT_THROW(rank_sum_p({}, Values{1}), std::invalid_argument);
  EXPECT_THROW(rank_sum_p(Values{std::nan("")}, Values{1}), std::invalid_argument);
}

TEST(Kde, ScalesWithTheValues) {
  const Values values = {3, 5, 8, 8.5, 20};
  Values scaled;
  for (const double x : values) scaled.push_back(10 * x - 4);
  EXPECT_NEAR(kde_bandwidth(scaled), 10 * kde_bandwidth(values), 1e-12);
  EXPECT_THROW(kde_bandwidth(Values{2, 2}), std::invalid_argument);
  EXPECT_THROW(kde_bandwidth({}), std::invalid_argument);
}

TEST(Kde, IsADensity) {
  const Values values = {3, 5, 8, 8.5, 20};
  const double bandwidth = kde_bandwidth(values);
  double mass = 0;
  for (int i = -4000; i < 6000; ++i) mass += 0.01 * kde_density(values, bandwidth, 0.01 * i);
  EXPECT_NEAR(mass, 1, 1e-9);
}

const std::vector<Values> kMeasured = {{0.1, 0.2}, {0.5}, {0.7, 0.8, 0.9}};
const std::vector<std::size_t> kStarts = {2, 1, 3};

double mean_of_measured(std::span<const Draw> draws) { return mean(kMeasured, draws); }

TEST(Bootstrap, FirstMeasuresTheDataAsTheyAre) {
  EXPECT_NEAR(bootstrap(kStarts, mean_of_measured).value, (0.15 + 0.5 + 0.8) / 3, 1e-15);
  EXPECT_THROW(bootstrap({}, mean_of_measured), std::invalid_argument);
  EXPECT_THROW(bootstrap(std::vector<std::size_t>{1, 0}, mean_of_measured), std::invalid_argument);
}

TEST(Bootstrap, DrawsAreThoseOfTheSeed) {
  const Bootstrapped first = bootstrap(kStarts, mean_of_measured, {.resamples = 5, .seed = 3});
  const Bootstrapped again = bootstrap(kStarts, mean_of_measured, {.resamples = 5, .seed = 3});
  EXPECT_EQ(first.resamples, again.resamples);
  EXPECT_NE(first.resamples, bootstrap(kStarts, mean_of_measured, {.resamples = 5, .seed = 4}).resamples);
}

TEST(Bootstrap, OfHalfOnesIsBinomial) {
  std::vector<Values> measured(100, Values{0});
  std::fill_n(measured.begin(), 50, Values{1});
  const std::vector<std::size_t> starts(100, 1);
  const Estimate interval =
      estimate(bootstrap(starts, [&](std::span<const Draw> draws) { return mean(measured, draws); }));
  EXPECT_EQ(interval.value, 0.5);
  EXPECT_NEAR(interval.low, 0.5 - 1.96 * 0.05, 0.015);
  EXPECT_NEAR(interval.high, 0.5 + 1.96 * 0.05, 0.015);
}

TEST(Bootstrap, StartsAreResampledWithinTheirSequence) {
  const std::vector<Values> one = {{0, 1, 0, 1}};
  const std::vector<std::size_t> starts = {4};
  const Estimate interval =
      estimate(bootstrap(starts, [&](std::span<const Draw> draws) { return mean(one, draws); }));
  EXPECT_EQ(interval.low, 0) << "with probability 1 / 16";
  EXPECT_EQ(interval.high, 1);
}

TEST(Bootstrap, PairsWhatHasTheSameDraws) {
  const Bootstrapped a = bootstrap(kStarts, mean_of_measured);
  Bootstrapped b = a;
  b.value -= 0.01;
  for (double& x : b.resamples) x -= 0.01;
  const Estimate better = estimate(difference(a, b));
  EXPECT_NEAR(better.value, 0.01, 1e-15);
  EXPECT_NEAR(better.low, 0.01, 1e-15);
  EXPECT_TRUE(better.excludes_zero());
  EXPECT_FALSE(estimate(difference(a, a)).excludes_zero());
  EXPECT_THROW(difference(a, {0, {1, 2}}), std::invalid_argument);
}

TEST(Estimate, InterpolatesPercentilesAndLeavesOutNaN) {
  const Estimate half = estimate({7, {3, std::nan(""), 1, 2, 5, 4}}, 0.5);
  EXPECT_EQ(half.value, 7);
  EXPECT_NEAR(half.low, 2, 1e-15);
  EXPECT_NEAR(half.high, 4, 1e-15);
  EXPECT_NEAR(estimate({7, {3, 1, 2, 5, 4}}, 0.9).low, 1.2, 1e-12);
  EXPECT_THROW(estimate({7, {}}), std::invalid_argument);
}

TEST(Resampled, HasTheDrawnRuns) {
  std::vector<SupervisedSequence> sequences(2);
  for (SupervisedSequence& sequence : sequences)
    for (const double overlap : {0.1, 0.2}) sequence.runs.push_back({{Outcome::Tracked}, {overlap}});
  sequences[1].tags["a"] = {true};
  const std::vector<Draw> draws = {{1, {1, 1, 0}}, {1, {0}}};
  const std::vector<SupervisedSequence> drawn = resampled(sequences, std::span(draws));
  ASSERT_EQ(drawn.size(), 2U);
  ASSERT_EQ(drawn[0].runs.size(), 3U);
  EXPECT_EQ(drawn[0].runs[0].overlaps[0], 0.2);
  EXPECT_EQ(drawn[0].runs[2].overlaps[0], 0.1);
  EXPECT_EQ(drawn[1].tags.count("a"), 1U);
}

// The example in docs/evaluation-measures.md.
TEST(Bootstrap, ComparesTheEaoOfTwoTrackers) {
  const auto tracker = [](double overlap) {
    std::vector<SupervisedSequence> sequences(6);
    for (std::size_t s = 0; s < sequences.size(); ++s)
      for (std::size_t r = 0; r < 3; ++r) {
        SupervisedRun run{std::vector(400, Outcome::Tracked), std::vector<double>(400)};
        run.outcomes[0] = Outcome::Started;
        for (std::size_t t = 0; t < 400; ++t)
          run.overlaps[t] = overlap + 0.1 * std::sin(static_cast<double>(t + 70 * s + 20 * r));
        sequences[s].runs.push_back(run);
      }
    return sequences;
  };
  const std::vector<std::size_t> starts(6, 3);
  const auto sample = [&](const std::vector<SupervisedSequence>& sequences) {
    return bootstrap(starts,
                     [&](std::span<const Draw> draws) {
                       return eao(resampled(sequences, draws), {166, 377}, Toolkit::Legacy);
                     },
                     {.resamples = 200});
  };
  const Bootstrapped better = sample(tracker(0.6)), worse = sample(tracker(0.55));
  const Estimate gain = estimate(difference(better, worse));
  EXPECT_NEAR(gain.value, 0.05, 1e-12);
  EXPECT_NEAR(gain.low, 0.05, 1e-12) << "the trackers differ alike in each run";
  EXPECT_TRUE(gain.excludes_zero());
  EXPECT_LT(estimate(better).low, estimate(better).value);
}

}  // namespace
}  // namespace asterism::bench
