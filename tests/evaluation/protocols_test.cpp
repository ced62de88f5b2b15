// Protocols and their scores, with scripted trackers that recognise the frame by its color.
#include "protocols.hpp"

#include <gtest/gtest.h>
#include <stdlib.h>

#include <cmath>
#include <cstdio>
#include <functional>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <thread>

#include "campaign.hpp"
#include "scoring.hpp"

namespace asterism::bench {
namespace {

namespace fs = std::filesystem;

class ProtocolsTest : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "asterism-protocols-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    root_ = name;
  }
  void TearDown() override { fs::remove_all(root_); }

  // Frames whose uniform color is their number, from 0; the object is at (10 + t, 20), 10 x 8.
  Sequence sequence(int length, const std::string& name = "moving") {
    Sequence result;
    result.name = name;
    fs::create_directories(root_ / name);
    for (int t = 0; t < length; ++t) {
      char file[32];
      std::snprintf(file, sizeof file, "%08d.png", t + 1);
      result.images.push_back(root_ / name / file);
      cv::imwrite(result.images.back().string(), cv::Mat(60, 200, CV_8UC3, cv::Scalar::all(t)));
      result.truth.emplace_back(truth(t));
    }
    return result;
  }

  static Region truth(int t) { return Region::rectangle({10.0 + t, 20, 10, 8}); }

  static std::optional<RunResult> run(const Start& start, const Sequence& sequence, const bench::Run& one,
                                      const ProtocolOptions& options = {}) {
    SequenceImages images(sequence);
    return execute(start, images, one, options, [] { return true; });
  }

  fs::path root_;
};

int number_of(const Image& image) { return image.pixels.at<cv::Vec3b>(0, 0)[0]; }

/// A tracker that answers answer(t), wherever it was started.
Start scripted(std::function<Report(int)> answer) {
  return [answer](const Image&, const Region&) -> Step {
    return [answer](const Image& image) { return answer(number_of(image)); };
  };
}

std::vector<int> codes(const Trajectory& trajectory) {  // -1 for a region
  std::vector<int> result;
  for (const TrajectoryFrame& frame : trajectory.frames) result.push_back(frame.region ? -1 : frame.code);
  return result;
}

TEST_F(ProtocolsTest, SupervisedRestartsFiveFramesAfterAFailure) {
  const Sequence moving = sequence(30);
  const auto answer = [](int t) {
    return t == 7 ? Report{Region::rectangle({100, 20, 10, 8})} : Report{ProtocolsTest::truth(t)};
  };
  const auto result = run(scripted(answer), moving, runs_of(moving, Protocol::Vot, {}).front());
  std::vector<int> expected(30, -1);
  expected[0] = TrajectoryFrame::kStarted;
  expected[7] = TrajectoryFrame::kFailed;
  for (int t = 8; t < 12; ++t) expected[static_cast<std::size_t>(t)] = TrajectoryFrame::kUnknown;
  expected[12] = TrajectoryFrame::kStarted;
  EXPECT_EQ(codes(result->trajectory), expected);
  const std::vector<double>& times = result->trajectory.values.at("time");
  for (std::size_t t = 0; t < 30; ++t)
    EXPECT_EQ(std::isnan(times[t]), expected[t] == TrajectoryFrame::kUnknown) << t;

  // By the definition: one failure in 30 frames; overlap 1 elsewhere.
  const SupervisedRun scored = supervised_run(result->trajectory, moving, {});
  const std::vector<SupervisedSequence> sequences = {supervised_sequence(moving, {scored})};
  const AccuracyRobustness score = accuracy_robustness(sequences, Toolkit::Legacy);
  EXPECT_DOUBLE_EQ(score.accuracy, 1);
  EXPECT_DOUBLE_EQ(score.failures, 1);
}

TEST_F(ProtocolsTest, ConfidencesAreStoredWhereThereAreAny) {
  const Sequence moving = sequence(12);
  const auto answer = [](int t) {
    Report report{t == 4 ? Region::rectangle({100, 20, 10, 8}) : ProtocolsTest::truth(t)};
    if (t != 6) report.confidence = t / 100.0;
    return report;
  };
  const auto result = run(scripted(answer), moving, runs_of(moving, Protocol::Vot, {}).front());
  const std::vector<double>& confidence = result->trajectory.values.at("confidence");
  ASSERT_EQ(confidence.size(), 12u);
  for (std::size_t t = 0; t < 12; ++t) {  // started in 0 and 9; the failed frame has a value
    const bool told = (t >= 1 && t <= 4) || t >= 10;
    EXPECT_EQ(std::isnan(confidence[t]), !told) << t;
    if (told) {
      EXPECT_EQ(confidence[t], static_cast<double>(t) / 100);
    }
  }

  const auto silent = [](int t) { return Report{ProtocolsTest::truth(t)}; };
  const auto without = run(scripted(silent), moving, runs_of(moving, Protocol::Otb, {}).front());
  EXPECT_FALSE(without->trajectory.values.contains("confidence"));
}

TEST_F(ProtocolsTest, WhatIsNotFoundOrThrownIsAFailure) {
  const Sequence moving = sequence(20);
  const auto answer = [](int t) {
    if (t == 3) return Report{};
    if (t == 12) throw std::runtime_error("no idea");
    return Report{ProtocolsTest::truth(t)};
  };
  const auto result = run(scripted(answer), moving, runs_of(moving, Protocol::Vot, {}).front());
  std::vector<int> failed;
  for (int t = 0; t < 20; ++t)
    if (codes(result->trajectory)[static_cast<std::size_t>(t)] == TrajectoryFrame::kFailed)
      failed.push_back(t);
  EXPECT_EQ(failed, (std::vector<int>{3, 12}));
  EXPECT_EQ(result->errors, std::vector<std::string>{"frame 13: no idea"});

  // Uncorrected: a missing object is a frame without region, and so are all frames from an error on.
  const auto once = run(scripted(answer), moving, runs_of(moving, Protocol::Otb, {}).front());
  std::vector<int> expected(20, -1);
  expected[0] = TrajectoryFrame::kStarted;
  expected[3] = TrajectoryFrame::kUnknown;
  for (std::size_t t = 12; t < 20; ++t) expected[t] = TrajectoryFrame::kUnknown;
  expected[12] = TrajectoryFrame::kFailed;
  EXPECT_EQ(codes(once->trajectory), expected);
  EXPECT_TRUE(std::isnan(once->trajectory.values.at("time")[12]));
}

TEST_F(ProtocolsTest, ATrackerThatThrowsMissesTheRestAlsoIfTheObjectIsStill) {
  Sequence still = sequence(20);
  still.truth.assign(20, ProtocolsTest::truth(0));
  const auto overlaps = [&](const Start& start) {
    const auto result = run(start, still, runs_of(still, Protocol::Otb, {}).front());
    return one_pass_run(result->trajectory, still, {}).overlaps;
  };
  const auto until = [](int last, bool throws) {
    return scripted([=](int t) {
      if (t > last && throws) throw std::runtime_error("no idea");
      return t > last ? Report{} : Report{ProtocolsTest::truth(0)};
    });
  };
  std::vector<double> expected(20, 1);
  EXPECT_EQ(overlaps(until(11, false)), expected) << "a missing object repeats the box before";
  std::fill(expected.begin() + 12, expected.end(), 0);
  EXPECT_EQ(overlaps(until(11, true)), expected);
  EXPECT_EQ(overlaps([](const Image&, const Region&) -> Step { throw std::runtime_error("no"); }),
            std::vector<double>(20, 0));
}

TEST_F(ProtocolsTest, TrackersThatCannotStartFailEverySixthFrame) {
  const Sequence moving = sequence(12);
  const Start start = [](const Image&, const Region&) -> Step { throw std::runtime_error("no"); };
  const auto result = run(start, moving, runs_of(moving, Protocol::Vot, {}).front());
  EXPECT_EQ(codes(result->trajectory), (std::vector<int>{2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0}));
  EXPECT_EQ(result->errors.size(), 3u);
}

TEST_F(ProtocolsTest, StartBoxesMoveByUpToThejitter) {
  const Sequence moving = sequence(8);
  ProtocolOptions options;
  options.starts = 40;
  options.jitter = 0.5;
  std::vector<Region> started;
  const Start start = [&](const Image&, const Region& region) -> Step {
    started.push_back(region);
    return [](const Image& image) { return Report{ProtocolsTest::truth(number_of(image))}; };
  };
  const std::vector<bench::Run> runs = runs_of(moving, Protocol::Otb, options);
  ASSERT_EQ(runs.size(), 40u);
  for (const bench::Run& r : runs) run(start, moving, r, options);
  EXPECT_EQ(started[0], truth(0));
  double most = 0;
  for (const Region& region : started) {
    const cv::Point2d move = region.box().tl() - truth(0).box().tl();
    EXPECT_EQ(region.box().size(), truth(0).box().size());
    most = std::max({most, std::abs(move.x), std::abs(move.y)});
  }
  EXPECT_LE(most, 0.5);
  EXPECT_GT(most, 0.4);

  // More starts begin with the same ones.
  ProtocolOptions fewer = options;
  fewer.starts = 3;
  const auto all = start_offsets(options), few = start_offsets(fewer);
  EXPECT_TRUE(std::equal(few.begin(), few.end(), all.begin()));
}

TEST_F(ProtocolsTest, PolygonsAreTheirBoxesWhereThatIsWanted) {
  Sequence tilted = sequence(4);
  tilted.truth[0] = Region::polygon({{10, 20}, {20, 10}, {30, 20}, {20, 30}});
  ProtocolOptions options;
  EXPECT_FALSE(truth_of(tilted, 0, options)->is_rectangle());
  options.boxes = true;
  EXPECT_EQ(*truth_of(tilted, 0, options), Region::rectangle({10, 10, 20, 20}));
}

TEST_F(ProtocolsTest, TemporalAndSpatialStartsAndAnchors) {
  const Sequence moving = sequence(120);
  std::vector<std::pair<int, Region>> started;
  const Start start = [&](const Image& image, const Region& region) -> Step {
    started.emplace_back(number_of(image), region);
    return [](const Image& next) { return Report{ProtocolsTest::truth(number_of(next))}; };
  };

  const std::vector<bench::Run> segments = runs_of(moving, Protocol::Tre, {});
  EXPECT_EQ(segments.front().first, 0u);
  const bench::Run& later = segments[5];
  const auto from_there = run(start, moving, later);
  EXPECT_EQ(started.back().first, static_cast<int>(later.first));
  EXPECT_EQ(codes(from_there->trajectory)[later.first], TrajectoryFrame::kStarted);
  EXPECT_EQ(one_pass_run(from_there->trajectory, moving, {}).overlaps.size(), 120 - later.first);

  const std::vector<bench::Run> shifts = runs_of(moving, Protocol::Sre, {});
  ASSERT_EQ(shifts.size(), 12u);
  for (const bench::Run& shift : shifts) {
    run(start, moving, shift);
    EXPECT_NE(started.back().second, truth(0)) << shift.number;
  }

  const std::vector<bench::Run> anchors = runs_of(moving, Protocol::MultiStart, {});
  ASSERT_EQ(anchors.size(), 4u);  // 0 and 50 forward, 100 and 119 backward
  const auto backward = run(start, moving, anchors[2]);
  EXPECT_EQ(started.back().first, 100);
  ASSERT_EQ(backward->trajectory.frames.size(), 101u);
  EXPECT_EQ(*backward->trajectory.frames[1].region, truth(99));
  EXPECT_EQ(*backward->trajectory.frames[100].region, truth(0));
  const AnchorRun scored = anchor_run(backward->trajectory, moving, anchors[2], {});
  for (std::size_t i = 1; i < scored.overlaps.size(); ++i) EXPECT_DOUBLE_EQ(scored.overlaps[i], 1);
  EXPECT_EQ(anchors[2].file(moving), "moving_00000100.txt");
}

TEST_F(ProtocolsTest, FramesWithoutTruthDoNotCount) {
  Sequence hidden = sequence(12);
  hidden.truth[4] = std::nullopt;
  const auto away = [](int t) {
    return t == 4 ? Report{Region::rectangle({150, 40, 10, 8})} : Report{ProtocolsTest::truth(t)};
  };
  const auto result = run(scripted(away), hidden, runs_of(hidden, Protocol::Vot, {}).front());
  const SupervisedRun scored = supervised_run(result->trajectory, hidden, {});
  EXPECT_EQ(scored.outcomes[4], Outcome::Skipped);
  EXPECT_EQ(std::count(scored.outcomes.begin(), scored.outcomes.end(), Outcome::Failed), 0);
}

TEST_F(ProtocolsTest, RunsEndWhereTheyAreStopped) {
  const Sequence moving = sequence(10);
  SequenceImages images(moving);
  const Start start = scripted([](int t) { return Report{ProtocolsTest::truth(t)}; });
  for (const Protocol protocol : kProtocols) {
    const std::vector<bench::Run> runs = runs_of(moving, protocol, {});
    if (runs.empty()) continue;  // too short
    int frames = 0;
    EXPECT_FALSE(execute(start, images, runs.front(), {}, [&] { return ++frames < 3; }));
    EXPECT_EQ(frames, 3);
  }
}

TEST_F(ProtocolsTest, ImagesAreSharedBetweenThreads) {
  const Sequence moving = sequence(40);
  for (const std::size_t kept : {std::size_t{0}, std::size_t{1} << 30}) {
    SequenceImages images(moving, kept);
    std::vector<std::jthread> pool;
    for (int thread = 0; thread < 3; ++thread)
      pool.emplace_back([&] {
        for (std::size_t t = 0; t < 40; ++t) EXPECT_EQ(number_of(images(t)), static_cast<int>(t));
      });
  }
}

TEST_F(ProtocolsTest, ResultsThatDoNotFitTheSequenceAreRefused) {
  const Sequence moving = sequence(5);
  Trajectory shorter;
  shorter.frames.resize(4);
  EXPECT_THROW(supervised_run(shorter, moving, {}), std::runtime_error);
  EXPECT_THROW(one_pass_run(shorter, moving, {}), std::runtime_error);
}

TEST_F(ProtocolsTest, NamesOfProtocols) {
  for (const Protocol protocol : kProtocols)
    EXPECT_EQ(parse_protocol(std::string(to_string(protocol))), protocol);
  const std::string known = " (known: vot, otb, tre, sre, multistart)";
  for (const auto& [wrong, answer] :
       {std::pair("vott", ", did you mean 'vot'?"), std::pair("vot2018", ": use 'vot'"),
        std::pair("vot2022", ": use 'multistart'"), std::pair("unsupervised", ": use 'otb'")}) {
    try {
      parse_protocol(wrong);
      ADD_FAILURE() << wrong;
    } catch (const std::invalid_argument& error) {
      EXPECT_EQ(error.what(), std::string("unknown protocol '") + wrong + "'" + answer + known);
    }
  }
}

}  // namespace
}  // namespace asterism::bench
