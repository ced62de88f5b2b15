// Analyses campaigns of stored results with known scores.
#include "analysis.hpp"

#include <gtest/gtest.h>
#include <stdlib.h>

#include <cmath>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <sstream>
#include <stdexcept>

#include "report.hpp"
#include "text.hpp"

namespace asterism::bench {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kLong = 30, kShort = 20;

class AnalysisTest : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "asterism-analysis-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    root_ = name;
    campaign_.folder = root_ / "out";
    campaign_.dataset = root_ / "data";
    campaign_.options.overlap = OverlapRule::Exact;
    campaign_.protocols = {Protocol::Vot, Protocol::Otb};
    campaign_.trackers = {{"good", "good"}, {"bad", "trax:bad --it's"}};
    campaign_.sequences = {sequence("long", kLong), sequence("short", kShort)};
  }
  void TearDown() override { fs::remove_all(root_); }

  // The object is at (10, 20), 10 x 8, in all frames; all frames are one image.
  Sequence sequence(const std::string& name, std::size_t length) const {
    fs::create_directories(root_ / "data" / name);
    const fs::path image = root_ / "data" / name / "image.png";
    cv::imwrite(image.string(), cv::Mat(60, 80, CV_8UC3, cv::Scalar::all(90)));
    Sequence result;
    result.name = name;
    result.images.assign(length, image);
    result.truth.assign(length, Region::rectangle({10, 20, 10, 8}));
    return result;
  }

  /// A region of the given overlap with the object.
  static TrajectoryFrame with_overlap(double overlap) {
    return {Region::rectangle({10, 20, 10 * overlap, 8}), TrajectoryFrame::kUnknown};
  }
  static TrajectoryFrame code(int value) { return {std::nullopt, value}; }

  /// A run of constant overlap; if supervised, it fails in the given frame and restarts five frames later.
  static Trajectory run(std::size_t length, double overlap, std::size_t failure = 0) {
    Trajectory trajectory;
    trajectory.frames.assign(length, with_overlap(overlap));
    trajectory.frames[0] = code(TrajectoryFrame::kStarted);
    if (failure > 0) {
      trajectory.frames[failure] = code(TrajectoryFrame::kFailed);
      for (std::size_t t = failure + 1; t < failure + 5; ++t)
        trajectory.frames[t] = code(TrajectoryFrame::kUnknown);
      trajectory.frames[failure + 5] = code(TrajectoryFrame::kStarted);
    }
    trajectory.values["time"].assign(length, 0.01);
    return trajectory;
  }

  fs::path store(const std::string& tracker, Protocol protocol, std::size_t sequence,
                 const Trajectory& trajectory, int number = 1) const {
    const bench::Run one{.protocol = protocol, .number = number, .offset = {}};
    const fs::path file = campaign_.file(tracker, campaign_.sequences[sequence], one);
    write_trajectory(file, trajectory);
    return file;
  }

  /// good: overlap 0.8 on the long sequence, 0.6 on the short one, no failures; bad: 0.5 everywhere, fails in
  /// frame 12 of the long one.
  void store_all() const {
    for (const Protocol protocol : {Protocol::Vot, Protocol::Otb}) {
      store("good", protocol, 0, run(kLong, 0.8));
      store("good", protocol, 1, run(kShort, 0.6));
      store("bad", protocol, 0, run(kLong, 0.5, protocol == Protocol::Vot ? 12 : 0));
      store("bad", protocol, 1, run(kShort, 0.5));
    }
  }

  /// Another run, as that of this number: both have 0.4 on the long sequence and 0.6 on the short one, good
  /// fails in frame 13 of the long one.
  void store_second(int number) const {
    for (const std::string tracker : {"good", "bad"})
      for (const Protocol protocol : {Protocol::Vot, Protocol::Otb}) {
        const bool fails = tracker == "good" && protocol == Protocol::Vot;
        store(tracker, protocol, 0, run(kLong, 0.4, fails ? 13 : 0), number);
        store(tracker, protocol, 1, run(kShort, 0.6), number);
      }
  }

  std::string error_of(const AnalysisOptions& options = {}) const {
    try {
      analyse(campaign_, options);
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return {};
  }

  fs::path root_;
  Campaign campaign_;
};

TEST_F(AnalysisTest, FiguresAreThoseOfTheDefinitions) {
  store_all();
  const Analysis analysis = analyse(campaign_, {.interval = LengthInterval{5, 15}});
  ASSERT_EQ(analysis.trackers.size(), 2u);
  const TrackerScores& good = analysis.trackers[0];
  const TrackerScores& bad = analysis.trackers[1];
  EXPECT_EQ(good.name, "good");  // sorted by EAO
  EXPECT_EQ(bad.name, "bad");

  // Frames after the burn-in: 20 with 0.8, 10 with 0.6.
  EXPECT_NEAR(good.supervised->legacy.accuracy, (20 * 0.8 + 10 * 0.6) / 30, 1e-12);
  EXPECT_EQ(good.supervised->legacy.failures, 0);
  EXPECT_NEAR(good.supervised->python.accuracy, (30 * 0.8 + 20 * 0.6) / 50, 1e-12);
  EXPECT_NEAR(bad.supervised->legacy.accuracy, 0.5, 1e-12);
  EXPECT_EQ(bad.supervised->legacy.failures, 1);
  EXPECT_NEAR(bad.supervised->python.failures, 30.0 / 50, 1e-12);
  EXPECT_NEAR(bad.supervised->legacy.reliability(), std::exp(-30.0 / 50), 1e-12);

  // Neither sequence ends before frame 16, so both count at each length.
  EXPECT_NEAR(good.supervised->legacy_eao, 0.7, 1e-12);
  // Three fragments: from the start, from the restart, and the short sequence. The first has 11 frames with
  // overlap and 0 from then on, the second 13 frames.
  double expected = 0;
  for (int n = 5; n <= 15; ++n) {
    const double failed = 0.5 * std::min(n - 1, 11) / (n - 1);
    expected += (n <= 13 ? (failed + 0.5 + 0.5) / 3 : (failed + 0.5) / 2) / 11;
  }
  EXPECT_NEAR(bad.supervised->legacy_eao, expected, 1e-12);

  EXPECT_NEAR(good.one_pass.at(Protocol::Otb).average_overlap, 0.7, 1e-12);
  EXPECT_NEAR(bad.one_pass.at(Protocol::Otb).average_overlap, 0.5, 1e-12);
  EXPECT_NEAR(good.sequences[1].average_overlap, 0.6, 1e-12);
  EXPECT_NEAR(good.sequences[0].accuracy, 0.8, 1e-12);
  EXPECT_EQ(bad.sequences[0].failures, 1);
  EXPECT_EQ(bad.sequences[0].failed, std::vector<std::size_t>{12});
  EXPECT_NEAR(bad.sequences[0].overlaps[11], 0.5, 1e-12);
  EXPECT_TRUE(std::isnan(bad.sequences[0].overlaps[13]));
  EXPECT_NEAR(good.frames_per_second, 100, 1e-9);

  // The failure costs the rest of its sequence.
  ASSERT_FALSE(bad.losses.empty());
  EXPECT_TRUE(bad.losses[0].failure);
  EXPECT_EQ(bad.losses[0].frame, 12u);
  EXPECT_EQ(bad.losses[0].cost, 18);
  EXPECT_EQ(*bad.losses[0].region, *with_overlap(0.5).region);
  EXPECT_FALSE(good.losses[0].failure);
  EXPECT_NEAR(good.losses[0].overlap, 0.6, 1e-12);
}

TEST_F(AnalysisTest, EveryStartAlone) {
  store_all();
  campaign_.options.starts = 2;
  store_second(2);
  const AnalysisOptions options{.interval = LengthInterval{5, 15}};
  const auto& trackers = analyse(campaign_, options).trackers;
  for (const std::size_t start : {0u, 1u}) {
    // As the report of a campaign that has these runs only.
    campaign_.folder = root_ / ("start " + std::to_string(start));
    campaign_.options.starts = 1;
    start == 0 ? store_all() : store_second(1);
    const auto& alone = analyse(campaign_, options).trackers;
    for (const TrackerScores& tracker : trackers) {
      const auto& wanted = *std::ranges::find(alone, tracker.name, &TrackerScores::name)->supervised;
      ASSERT_EQ(tracker.supervised->starts.size(), 2u);
      const LegacyScores& found = tracker.supervised->starts[start];
      EXPECT_NEAR(found.eao, wanted.legacy_eao, 1e-12);
      EXPECT_NEAR(found.score.accuracy, wanted.legacy.accuracy, 1e-12);
      EXPECT_EQ(found.score.failures, wanted.legacy.failures);
      EXPECT_TRUE(wanted.mixed_starts.empty()) << "one start";
    }
  }
  const TrackerScores& bad = *std::ranges::find(trackers, "bad", &TrackerScores::name);
  EXPECT_EQ(bad.sequences[0].start_failures, (std::vector<double>{1, 0}));
  // Half of the draws have the run that fails, as only the first sequence differs in it.
  double failures = 0;
  for (const LegacyScores& mixed : bad.supervised->mixed_starts) failures += mixed.score.failures;
  EXPECT_NEAR(failures / static_cast<double>(bad.supervised->mixed_starts.size()), 0.5, 0.15);
}

TEST_F(AnalysisTest, IntervalsAndDifferencesArePaired) {
  store_all();
  const Analysis analysis = analyse(campaign_, {.interval = LengthInterval{5, 15}});
  // Each bootstrap sample of two sequences has the overlaps 0.6 and 0.8, or one of them twice.
  const Estimate& overlap = analysis.trackers[0].estimates.at(Measure::Overlap);
  EXPECT_NEAR(overlap.value, 0.7, 1e-12);
  EXPECT_NEAR(overlap.low, 0.6, 1e-12);
  EXPECT_NEAR(overlap.high, 0.8, 1e-12);
  ASSERT_EQ(analysis.differences.size(), std::size(kMeasures));
  for (const Difference& difference : analysis.differences) {
    EXPECT_FALSE(difference.significant) << "of two sequences";
    const double sign = difference.measure == Measure::Failures ? -1 : 1;
    EXPECT_GT(sign * difference.estimate.value, 0);
  }
  const Difference& by_overlap = analysis.differences.back();
  EXPECT_EQ(by_overlap.measure, Measure::Overlap);
  EXPECT_NEAR(by_overlap.estimate.low, 0.1, 1e-12);
  EXPECT_NEAR(by_overlap.estimate.high, 0.3, 1e-12);
}

TEST_F(AnalysisTest, DifferencesOnEnoughSequencesAreSignificant) {
  campaign_.sequences.clear();
  for (std::size_t s = 0; s < kFewestSequences; ++s) {
    campaign_.sequences.push_back(sequence("s" + std::to_string(s), kLong));
    store("good", Protocol::Otb, s, run(kLong, 0.8 + 0.01 * static_cast<double>(s)));
    store("bad", Protocol::Otb, s, run(kLong, 0.7));
  }
  campaign_.protocols = {Protocol::Otb};
  const Analysis analysis = analyse(campaign_);
  ASSERT_EQ(analysis.differences.size(), 1u);
  EXPECT_TRUE(analysis.differences[0].significant);
  EXPECT_NEAR(analysis.differences[0].estimate.value, 0.125, 1e-12);
  EXPECT_FALSE(analysis.trackers[0].supervised);
}

TEST_F(AnalysisTest, TheUsualIntervalIsThatOfTheLengths) {
  store_all();
  const Analysis analysis = analyse(campaign_);
  const std::vector<std::size_t> lengths = {kLong, kShort};
  EXPECT_EQ(analysis.supervised.lengths.low, typical_lengths(lengths).interval.low);
  EXPECT_EQ(analysis.supervised.lengths.high, typical_lengths(lengths).interval.high);
  campaign_.sequences.pop_back();
  EXPECT_EQ(analyse(campaign_).supervised.lengths.low, kLong);
  EXPECT_TRUE(analyse(campaign_).trackers[0].estimates.empty()) << "of a single sequence";
  EXPECT_NEAR(analyse(campaign_).trackers[0].supervised->legacy_eao, 0.8, 1e-12);
  EXPECT_TRUE(std::isnan(analyse(campaign_).trackers[0].supervised->python_eao)) << "one frame later";
}

TEST_F(AnalysisTest, AttributesAndPracticalDifferences) {
  for (Sequence& sequence : campaign_.sequences) {
    sequence.practical.assign(sequence.length(), 0.05);
    sequence.tags["never"].assign(sequence.length(), false);
  }
  campaign_.sequences[1].tags["dark"].assign(kShort, true);
  store_all();
  const Analysis analysis = analyse(campaign_);
  EXPECT_EQ(analysis.tags, (std::vector<std::string>{"dark", "empty"}));
  EXPECT_TRUE(analysis.practical);
  const SupervisedScores& bad = *analysis.trackers[1].supervised;
  EXPECT_EQ(bad.attributes.at("dark").score.failures, 0);
  EXPECT_EQ(bad.attributes.at("empty").score.failures, 1);
  EXPECT_NEAR(analysis.trackers[0].supervised->attributes.at("dark").score.accuracy, 0.6, 1e-12);
  EXPECT_NEAR(bad.mean_over_tags.failures, (20 * 0 + 30 * 1) / 50.0, 1e-12);
  EXPECT_FALSE(std::isnan(bad.mean_accuracy_rank));
}

TEST_F(AnalysisTest, MultiStartCountsEachAnchor) {
  for (std::size_t s = 0; s < campaign_.sequences.size(); ++s)
    for (const bench::Run& one : runs_of(campaign_.sequences[s], Protocol::MultiStart, campaign_.options))
      write_trajectory(campaign_.file("good", campaign_.sequences[s], one), run(one.frames, 0.5));
  const Analysis analysis = analyse(campaign_);
  ASSERT_EQ(analysis.trackers.size(), 1u);
  const MultiStartScores& scores = *analysis.trackers[0].multi_start;
  EXPECT_EQ(scores.score.robustness, 1);
  EXPECT_NEAR(scores.eao, 0.5, 1e-12);
  // In each of four runs the anchor counts as 0.
  EXPECT_NEAR(scores.score.accuracy, 0.5 * (100 - 4) / 100, 1e-12);
}

TEST_F(AnalysisTest, ResultsOfOthersTakePart) {
  store_all();
  for (int number = 1; number <= 3; ++number) {
    store("other", Protocol::Vot, 0, run(kLong, 0.7), number);
    if (number < 3) store("other", Protocol::Vot, 1, run(kShort, 0.7, 11), number);
  }
  fs::create_directories(campaign_.folder / "results/nothing/of/ours");
  const Analysis analysis = analyse(campaign_, {.interval = LengthInterval{5, 15}});
  ASSERT_EQ(analysis.trackers.size(), 3u);
  const auto other = std::ranges::find(analysis.trackers, "other", &TrackerScores::name);
  EXPECT_TRUE(other->foreign);
  EXPECT_EQ(other->most_starts, 3u);
  EXPECT_EQ(other->supervised->legacy.failures, 1);
  EXPECT_TRUE(other->estimates.contains(Measure::Eao));
  EXPECT_FALSE(other->estimates.contains(Measure::Overlap));
  EXPECT_EQ(analysis.left_out, std::vector<std::string>{"other has no results of otb"});
  // Three pairs by three supervised measures, and one by the one-pass measure.
  EXPECT_EQ(analysis.differences.size(), 3u * 3u + 1u);

  fs::remove_all(campaign_.folder / "results/other/baseline/short");
  EXPECT_NE(error_of().find("short_001.txt: results of others"), std::string::npos) << error_of();
}

TEST_F(AnalysisTest, WhatIsMissingIsNamedWithItsCommand) {
  EXPECT_NE(error_of().find("no results in"), std::string::npos);
  store_all();
  fs::remove(store("bad", Protocol::Vot, 1, run(kShort, 0.5)));
  const std::string error = error_of();
  EXPECT_NE(error.find("bad/baseline/short/short_001.txt"), std::string::npos) << error;
  EXPECT_NE(error.find("--external 'bad=bad --it'\\''s' --protocol vot"), std::string::npos) << error;
  EXPECT_NE(error.find("--overlap exact"), std::string::npos) << error;

  fs::remove_all(campaign_.folder / "results/bad");
  const Analysis analysis = analyse(campaign_);
  EXPECT_EQ(analysis.trackers.size(), 1u);
  EXPECT_EQ(analysis.left_out.size(), 2u);
}

TEST_F(AnalysisTest, DamagedResultsAreNamed) {
  store_all();
  fs::path file = store("good", Protocol::Otb, 0, run(kShort, 0.5));
  EXPECT_NE(error_of().find(file.string()), std::string::npos) << error_of();
  EXPECT_NE(error_of().find("has 20 frames, not 30"), std::string::npos) << error_of();
  std::ofstream(file) << "1\nnonsense\n";
  EXPECT_NE(error_of().find(file.string() + ":2"), std::string::npos) << error_of();
}

TEST_F(AnalysisTest, ATrackerThatNeverAnswersKeepsItsStartIfItCouldStart) {
  Trajectory dead;
  dead.frames.assign(kLong, code(TrajectoryFrame::kUnknown));
  dead.frames[0] = code(TrajectoryFrame::kStarted);
  store("bad", Protocol::Otb, 0, dead);
  dead.frames.resize(kShort);
  dead.frames[0] = code(TrajectoryFrame::kFailed);
  store("bad", Protocol::Otb, 1, dead);
  const Analysis analysis = analyse(campaign_);
  EXPECT_EQ(analysis.trackers[0].one_pass.at(Protocol::Otb).average_overlap, 0.5)
      << "the object does not move: 1 where it has started, and 0 where it threw";
}

TEST_F(AnalysisTest, ATrackerThatCannotStartScoresNothing) {
  store_all();
  for (const std::size_t s : {std::size_t{0}, std::size_t{1}}) {
    Trajectory dead;
    dead.frames.assign(campaign_.sequences[s].length(), code(TrajectoryFrame::kUnknown));
    for (std::size_t t = 0; t < dead.frames.size(); t += 5) dead.frames[t] = code(TrajectoryFrame::kFailed);
    store("bad", Protocol::Vot, s, dead);
  }
  const Analysis analysis = analyse(campaign_, {.interval = LengthInterval{5, 15}});
  const SupervisedScores& bad = *analysis.trackers[1].supervised;
  EXPECT_EQ(bad.legacy.failures, 6 + 4);
  EXPECT_EQ(bad.legacy.accuracy, 0);
  EXPECT_EQ(bad.legacy_eao, 0);
  EXPECT_TRUE(bad.python_curve.empty()) << "of the longest run before a failure";
}

TEST_F(AnalysisTest, SequencesWithoutGroundTruthAfterTheFirstBoxChangeNothing) {
  store_all();
  const Analysis before = analyse(campaign_, {.interval = LengthInterval{5, 15}});
  campaign_.sequences.push_back(sequence("blind", 50));
  for (std::size_t t = 1; t < 50; ++t) campaign_.sequences.back().truth[t].reset();
  for (const Protocol protocol : campaign_.protocols)
    for (const char* tracker : {"good", "bad"}) store(tracker, protocol, 2, run(50, 0.1));
  const Analysis after = analyse(campaign_, {.interval = LengthInterval{5, 15}});
  EXPECT_EQ(after.left_out, std::vector<std::string>{
                                "blind: no ground truth after the first box, so that nothing is measured"});
  EXPECT_EQ(after.measured, 2u);
  const TrackerScores &was = before.trackers[0], &is = after.trackers[0];
  EXPECT_EQ(is.one_pass.at(Protocol::Otb).average_overlap, was.one_pass.at(Protocol::Otb).average_overlap);
  EXPECT_EQ(is.one_pass.at(Protocol::Otb).precision, was.one_pass.at(Protocol::Otb).precision);
  EXPECT_EQ(is.supervised->legacy.accuracy, was.supervised->legacy.accuracy);
  EXPECT_EQ(is.supervised->python.failures, was.supervised->python.failures);
  EXPECT_EQ(is.supervised->legacy_eao, was.supervised->legacy_eao);
  EXPECT_EQ(is.estimates.at(Measure::Overlap).low, was.estimates.at(Measure::Overlap).low);
  EXPECT_TRUE(std::isnan(is.sequences[2].average_overlap) && std::isnan(is.sequences[2].accuracy) &&
              std::isnan(is.sequences[2].failures));
  EXPECT_EQ(analyse(campaign_).supervised.lengths.high, [&] {
    campaign_.sequences.pop_back();
    return analyse(campaign_).supervised.lengths.high;
  }());
  write_report(campaign_, before, root_ / "report", {.paper = true, .baseline = ""});

  campaign_.sequences = {sequence("blind", 50)};
  for (std::size_t t = 1; t < 50; ++t) campaign_.sequences.back().truth[t].reset();
  EXPECT_NE(error_of().find("blind: no ground truth after the first box"), std::string::npos) << error_of();
  EXPECT_NE(error_of().find("export-got10k"), std::string::npos);
}

// Text cells that a spreadsheet would evaluate are escaped; numbers stay numbers.
TEST_F(AnalysisTest, CellsAreNoFormulas) {
  campaign_.sequences[0].name = "=1+2";
  campaign_.sequences[1].name = "@sum, \"x\"";
  campaign_.sequences[0].tags["-tag"] = std::vector<bool>(kLong, true);
  campaign_.trackers = {{"+good", "good"}, {"-bad", "bad"}};
  for (const char* tracker : {"+good", "-bad"}) {
    store(tracker, Protocol::Vot, 0, run(kLong, tracker[0] == '+' ? 0.8 : 0.5, tracker[0] == '+' ? 0 : 12));
    store(tracker, Protocol::Vot, 1, run(kShort, 0.5));
  }
  campaign_.protocols = {Protocol::Vot};
  write_report(campaign_, analyse(campaign_), root_ / "report", {.paper = false, .baseline = ""});
  std::string all;
  for (const char* name : {"summary", "sequences", "attributes", "differences", "curves"}) {
    std::ifstream file(root_ / "report" / (std::string(name) + ".csv"));
    for (std::string line; std::getline(file, line);) {
      all += line + "\n";
      std::string cell;
      for (std::istringstream cells(line); std::getline(cells, cell, ',');) {
        const std::string_view text(cell);
        const bool number = text.find_first_not_of("+-.0123456789e") == std::string_view::npos;
        EXPECT_TRUE(text.empty() || number || std::string_view("=+-@").find(text.front()) == text.npos)
            << line;
      }
    }
  }
  for (const char* cell :
       {"\"'+good\",\"'=1+2\",30,", "\"'@sum, \"\"x\"\"\",20,", "\"'-tag\",", "F,\"'+good\",\"'-bad\",-1"})
    EXPECT_NE(all.find(cell), std::string::npos) << cell << " in " << all.substr(0, 2000);
}

TEST_F(AnalysisTest, AFolderWhoseNameIsNotUtf8IsLeftOut) {
  store_all();
  fs::create_directories(campaign_.folder / "results/\xFFother/baseline/long");
  const Analysis analysis = analyse(campaign_);
  ASSERT_EQ(analysis.left_out.size(), 1u);
  EXPECT_NE(analysis.left_out[0].find("results/\\xFFother: the name is not UTF-8"), std::string::npos);
  write_report(campaign_, analysis, root_ / "report", {.paper = false, .baseline = ""});
}

TEST(Text, IsUtf8OrPrintable) {
  for (const char* text : {"", "car", "\xC3\xA9", "\xE2\x82\xAC", "\xF0\x9F\x98\x80"}) {
    EXPECT_TRUE(is_utf8(text)) << text;
    EXPECT_EQ(printable(text), text);
  }
  for (const auto& [text, shown] :
       {std::pair("\xFF", "\\xFF"), std::pair("a\xC3", "a\\xC3"), std::pair("\xC0\xAF", "\\xC0\\xAF"),
        std::pair("\xE0\x80\x80z", "\\xE0\\x80\\x80z"), std::pair("\xED\xA0\x80", "\\xED\\xA0\\x80"),
        std::pair("\xF4\x90\x80\x80", "\\xF4\\x90\\x80\\x80"), std::pair("\xE2\x82", "\\xE2\\x82")}) {
    EXPECT_FALSE(is_utf8(text)) << shown;
    EXPECT_EQ(printable(text), shown);
  }
}

TEST(BoundedJson, IsAsDeepAsAllowed) {
  const auto nested = [](std::size_t depth) { return std::string(depth, '[') + std::string(depth, ']'); };
  EXPECT_EQ(parse_json(nested(60)).size(), 1u);
  for (const std::string& text : {nested(66), nested(100'000), std::string(100'000, '['), std::string("{"),
                                  std::string("x"), std::string()})
    EXPECT_THROW(parse_json(text), std::runtime_error) << text.substr(0, 10);
}

TEST_F(AnalysisTest, ReportsAreTheSameEachTime) {
  store_all();
  store("other <&>", Protocol::Vot, 0, run(kLong, 0.7));
  store("other <&>", Protocol::Vot, 1, run(kShort, 0.7));
  const Analysis analysis = analyse(campaign_);
  const auto content = [](const fs::path& file) {
    std::ifstream stream(file, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(stream), {});
  };
  write_report(campaign_, analysis, root_ / "a", {.paper = true, .baseline = "bad"});
  write_report(campaign_, analyse(campaign_), root_ / "b", {.paper = true, .baseline = "bad"});
  for (const char* name : {"report.html", "report.json", "summary.csv", "sequences.csv", "attributes.csv",
                           "differences.csv", "curves.csv"}) {
    EXPECT_FALSE(content(root_ / "a" / name).empty()) << name;
    EXPECT_EQ(content(root_ / "a" / name), content(root_ / "b" / name)) << name;
  }
  EXPECT_NE(content(root_ / "a/report.html").find("other &lt;&amp;&gt;"), std::string::npos);
  EXPECT_EQ(content(root_ / "a/report.html").find("<&>"), std::string::npos);
  EXPECT_THROW(write_report(campaign_, analysis, root_ / "c", {.paper = false, .baseline = "none"}),
               std::invalid_argument);
  EXPECT_NE(summary_text(analysis).find("good"), std::string::npos);
}

}  // namespace
}  // namespace asterism::bench
