// Runs trackers by name on a textured square that moves over another texture.
#include "peers.hpp"

#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <asterism/trackers/tracker/tracker.hpp>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "../trackers/moving_square.hpp"
#include "ground_truth.hpp"
#include "isolated.hpp"

namespace asterism::bench {
namespace {

constexpr int kFrames = 12;

cv::Mat draw_smooth_frame(int frame) { return draw_frame(frame, 9); }

std::vector<Report> follow(const EvaluatedTracker& tracker) {
  const Step step = tracker.start(draw_smooth_frame(0), Region::rectangle(true_box(0)));
  std::vector<Report> reports;
  for (int t = 1; t < kFrames; ++t) reports.push_back(step(draw_smooth_frame(t)));
  return reports;
}

double mean_overlap(const std::vector<Report>& reports) {
  double sum = 0;
  for (int t = 1; t < kFrames; ++t) {
    const auto& region = reports[static_cast<std::size_t>(t - 1)].region;
    sum += region ? tools::overlap(region->box(), true_box(t)) : 0;
  }
  return sum / (kFrames - 1);
}

const std::string kNanoTrack = "nanotrack:" ASTERISM_NANOTRACK, kDptNet = "dpt_net:" ASTERISM_NANOTRACK;

class EveryTracker : public testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {
    const bool networks = GetParam() == kNanoTrack || GetParam() == kDptNet;
#ifndef ASTERISM_TINY_NANOTRACK
    if (networks) GTEST_SKIP() << "OpenCV's dnn is not installed";
#endif
    if (networks && !std::filesystem::exists(ASTERISM_NANOTRACK "/head.onnx"))
      GTEST_SKIP() << "no networks in " ASTERISM_NANOTRACK
                   << " (configure with -DASTERISM_NANOTRACK=FOLDER to name another)";
  }
};

std::vector<std::string> every_tracker() {
  std::vector<std::string> names = evaluated_tracker_names();
  names.insert(names.end(), {kNanoTrack, kDptNet});
  return names;
}

TEST_P(EveryTracker, FollowsAnObjectAndStartsAnewEachTime) {
  const EvaluatedTracker tracker = evaluated_tracker(GetParam());
  EXPECT_EQ(tracker.name, GetParam());
  EXPECT_EQ(cv::getNumThreads(), 1);
  const std::vector<Report> first = follow(tracker);
  EXPECT_GT(mean_overlap(first), 0.4) << GetParam();
  // Some use random numbers.
  for (const char* random : {"opencv-mil", "opencv-boosting", "opencv-tld"})
    if (GetParam() == random) return;
  // Two at once, each with its own state.
  const Step other = tracker.start(draw_smooth_frame(5), Region::rectangle(true_box(5)));
  const std::vector<Report> again = follow(tracker);
  for (std::size_t i = 0; i < first.size(); ++i)
    EXPECT_EQ(again[i].region, first[i].region) << GetParam() << i;
  const Report report = other(draw_smooth_frame(6));
  EXPECT_TRUE(!report.region || tools::overlap(report.region->box(), true_box(6)) > 0.3);
}

TEST_P(EveryTracker, TakesAPolygonByItsEqualAreaBox) {
  if (GetParam() == "opencv-boosting") GTEST_SKIP() << "it reads through a null pointer on this box";
  const cv::Rect2d b = true_box(0);
  const Region hexagon = Region::polygon({{b.x, b.y + 20},
                                          {b.x + 6, b.y},
                                          {b.x + 42, b.y},
                                          {b.x + 48, b.y + 20},
                                          {b.x + 42, b.y + 40},
                                          {b.x + 6, b.y + 40}});
  const Step step = evaluated_tracker(GetParam()).start(draw_smooth_frame(0), hexagon);
  const Report report = step(draw_smooth_frame(1));
  EXPECT_TRUE(!report.region || tools::overlap(report.region->box(), true_box(1)) > 0.4);
}

INSTANTIATE_TEST_SUITE_P(Known, EveryTracker, testing::ValuesIn(every_tracker()), [](const auto& instance) {
  std::string name = name_of(instance.param);
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
});

// A tracker to be isolated: it calls `end` in the frame `last`.
Start mortal(int last, const std::function<void()>& end) {
  return [last, end](const Image&, const Region& object) -> Step {
    return [last, end, object, t = 0](const Image& image) mutable {
      if (++t == last) end();
      return Report{object, image.pixels.at<cv::Vec3b>(2, 3)[0] + 0.25};
    };
  };
}

TEST(IsolatedTrackers, SayWhatTheyWouldSay) {
  const Region object = Region::polygon({{1.5, 2}, {30, 2}, {30, 40.25}});
  const Step step = isolated(mortal(100, [] {}))(draw_smooth_frame(0), object);
  for (int t = 1; t < 5; ++t) {
    const Report report = step(draw_smooth_frame(t)(cv::Rect(10, 10, 100, 100)));  // rows not contiguous
    EXPECT_EQ(report.region, object);
    EXPECT_EQ(report.confidence, draw_smooth_frame(t).at<cv::Vec3b>(12, 13)[0] + 0.25);
  }
  // Two of the library's trackers at once.
  const EvaluatedTracker kcf = evaluated_tracker("kcf");
  const std::vector<Report> expected = follow(kcf);
  const Step other = isolated(kcf.start)(draw_smooth_frame(0), Region::rectangle(true_box(0)));
  const std::vector<Report> reports = follow({"kcf", isolated(kcf.start)});
  for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_EQ(reports[i].region, expected[i].region);
  EXPECT_EQ(other(draw_smooth_frame(1)).region, expected[0].region);
}

TEST(IsolatedTrackers, EndAlone) {
  const auto reason = [](const std::function<void()>& end) -> std::string {
    const Step step = isolated(mortal(2, end))(draw_smooth_frame(0), Region::rectangle(true_box(0)));
    step(draw_smooth_frame(1));
    try {
      step(draw_smooth_frame(2));
    } catch (const std::exception& error) {
      return error.what();
    }
    return "nothing";
  };
  EXPECT_EQ(reason([] { throw std::runtime_error("no idea"); }), "no idea");
  EXPECT_EQ(reason([] { raise(SIGKILL); }), "the tracker crashed: Killed");
  EXPECT_EQ(reason([] { _exit(3); }), "the tracker ended with code 3");
  const Start cannot = [](const Image&, const Region&) -> Step { throw std::runtime_error("never"); };
  EXPECT_THROW(isolated(cannot)(draw_smooth_frame(0), Region::rectangle(true_box(0))), std::runtime_error);
}

TEST(EvaluatedTrackers, AreOursAndThoseThatAreInstalled) {
  const std::vector<std::string> names = evaluated_tracker_names();
  for (const std::string& name : tracker_names())
    EXPECT_TRUE(std::count(names.begin(), names.end(), name)) << name;
}

TEST(EvaluatedTrackers, OfOursSayWhatTheySayAlone) {
  AnyTracker alone = make_tracker("kcf");
  alone.init(draw_smooth_frame(0), true_box(0));
  int t = 0;
  for (const Report& report : follow(evaluated_tracker("kcf"))) {
    const TrackResult result = alone.update(draw_smooth_frame(++t));
    EXPECT_EQ(report.region, Region::rectangle(result.box));
    EXPECT_EQ(report.confidence, result.confidence);
  }
}

// A part model and a peer's implementation of the same idea find the object at the same place.
TEST(EvaluatedTrackers, OtherFiltersFindWhatOursFind) {
  const std::vector<std::string> names = evaluated_tracker_names();
  const auto centres = [](const std::string& tracker) {
    std::vector<Point2> result;
    for (const Report& report : follow(evaluated_tracker(tracker)))
      result.push_back(report.region ? centre_of(report.region->box()) : Point2::Constant(1e9));
    return result;
  };
  for (const auto& [model, peer] : {std::pair("kcf", "dlib"), std::pair("mosse", "dlib"),
                                    std::pair("spatial_reliability", "opencv-csrt")}) {
    if (!std::count(names.begin(), names.end(), peer)) continue;
    const std::vector<Point2> theirs = centres(peer), ours = centres(std::string(R"(coarse{"root": ")") +
                                                                     model + R"(", "use_color": false})");
    for (int t = 1; t < kFrames; ++t) {
      const auto i = static_cast<std::size_t>(t - 1);
      EXPECT_LT((ours[i] - centre_of(true_box(t))).norm(), 1.5) << model << t;
      EXPECT_LT((ours[i] - theirs[i]).norm(), 2.5) << model << ' ' << peer << t;
    }
  }
}

TEST(EvaluatedTrackers, SayWhenTheyHaveNotFoundTheObject) {
  const std::vector<std::string> names = evaluated_tracker_names();
  if (!std::count(names.begin(), names.end(), "opencv-kcf"))
    GTEST_SKIP() << "OpenCV's trackers are not installed";
  const Step step =
      evaluated_tracker("opencv-kcf").start(draw_smooth_frame(0), Region::rectangle(true_box(0)));
  for (int t = 1; t < 4; ++t) EXPECT_TRUE(step(draw_smooth_frame(t)).region);
  const Report report = step(cv::Mat(240, 320, CV_8UC3, cv::Scalar::all(0)));
  EXPECT_FALSE(report.region);
  EXPECT_TRUE(std::isnan(report.confidence));
}

TEST(EvaluatedTrackers, ListTheMostSimilarNameFirst) {
  const std::vector<std::string> known = evaluated_tracker_names();
  for (const auto& [wrong, nearest] :
       {std::pair("coarze", "coarse"), std::pair("dtp", "dpt"), std::pair("DPTT", "dpt"),
        std::pair("csrt", "opencv-csrt"), std::pair("CSRT", "opencv-csrt"), std::pair("crst", "opencv-csrt"),
        std::pair("opencv-crst", "opencv-csrt"), std::pair("trax:", ""), std::pair("siamfc", "")}) {
    if (std::string_view(nearest).starts_with("opencv") && std::ranges::find(known, nearest) == known.end())
      continue;  // not built
    try {
      evaluated_tracker(wrong);
      ADD_FAILURE() << wrong;
    } catch (const std::invalid_argument& error) {
      std::string start = std::string("unknown tracker '") + wrong + "'";
      start.append(*nearest == '\0' ? " (known: " : ", did you mean '").append(nearest);
      EXPECT_EQ(std::string(error.what()).substr(0, start.size()), start);
    }
  }
}

#ifdef ASTERISM_TINY_NANOTRACK

// With the networks of tiny_nanotrack.py, which see blue on green; the expected values are the published
// formulas, for the cell in column 9 and row 6.
TEST(NanoTrack, TakesTheBestCellsBox) {
  cv::Mat image(600, 600, CV_8UC3, cv::Scalar(0, 255, 0));
  const auto start = [&](double x, double y) {  // the centre of the object
    return evaluated_tracker("nanotrack:" ASTERISM_TINY_NANOTRACK)
        .start(image, Region::rectangle({x - 63.5, y - 63.5, 127, 127}));
  };
  const auto expect = [](const Report& report, double x, double y, double width, double height) {
    ASSERT_TRUE(report.region);
    const cv::Rect2d box = report.region->box();
    EXPECT_NEAR(box.x + box.width / 2, x, 1e-3);
    EXPECT_NEAR(box.y + box.height / 2, y, 1e-3);
    EXPECT_NEAR(box.width, width, 1e-3);
    EXPECT_NEAR(box.height, height, 1e-3);
  };
  // Of a size in network pixels, for an object whose template is 127 pixels wide and of this aspect.
  const auto penalty = [](double width, double height, double aspect) {
    const double side = std::sqrt((width + (width + height) / 2) * (height + (width + height) / 2));
    const double size = std::max(side / 127, 127 / side);
    const double shape = std::max(width / height / aspect, height / width * aspect);
    return std::exp(-0.138 * (size * shape - 1));
  };
  const Step step = start(300, 300);  // 2 image pixels are 1 network pixel
  cv::Mat with_blue = image.clone();
  with_blue(cv::Rect(333, 237, 32, 32)).setTo(cv::Scalar(255, 0, 0));
  const Report found = step(with_blue);
  double probability = 1 / (1 + std::exp(-3.0));
  double rate = 0.348 * penalty(126, 130, 1) * probability;
  double width = 127 + rate * (252 - 127), height = 127 + rate * (260 - 127);
  expect(found, 300 + 2 * (32 + 3), 300 + 2 * (-16 - 5), width, height);
  EXPECT_NEAR(found.confidence, probability, 1e-5);
  EXPECT_TRUE(has_confidence("nanotrack:" ASTERISM_TINY_NANOTRACK));
  // All cells are alike: the Hann window decides for the one in the middle.
  const Report next = step(image);
  const double scale = 127 / std::sqrt((width + (width + height) / 2) * (height + (width + height) / 2));
  probability = 1 / (1 + std::exp(3.0));
  rate = 0.348 * penalty(126, 130, width / height) * probability;
  expect(next, 370 + 3 / scale, 258 - 5 / scale, width + rate * (126 / scale - width),
         height + rate * (130 / scale - height));
  EXPECT_NEAR(next.confidence, probability, 1e-5);
  // Outside the image is its mean, green, which is not more like the object; the centre stays inside.
  rate = 0.348 * penalty(126, 130, 1) * probability;
  expect(start(10, 4)(image), 16, 0, 127 + rate * (252 - 127), 127 + rate * (260 - 127));
}

// On gray texture and a blue square, with all the weight on the root: the box is the best cell's, as above.
TEST(DptNet, TakesTheBestCellsBoxAndMovesItsParts) {
  cv::Mat gray(600, 600, CV_8U), image;
  cv::RNG(1).fill(gray, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(gray, gray, {}, 2.5);
  cv::cvtColor(gray, image, cv::COLOR_GRAY2BGR);
  cv::Mat with_blue = image.clone();
  with_blue(cv::Rect(333, 237, 32, 32)).setTo(cv::Scalar(255, 0, 0));
  AnyTracker tracker = make_tracker("dpt_net:" ASTERISM_TINY_NANOTRACK R"({"root_weight": 1e9})");
  tracker.init(image, cv::Rect2d(300 - 63.5, 300 - 63.5, 127, 127));
  AnyTracker other = make_tracker("dpt_net:" ASTERISM_TINY_NANOTRACK R"({"root_weight": 1e9})");
  restore_state(other, save_state(tracker));
  const TrackResult found = tracker.update(with_blue);
  const double probability = 1 / (1 + std::exp(-3.0)), side = std::sqrt((126 + 128) * (130 + 128)) / 127,
               shape = 130.0 / 126;
  const double rate = 0.348 * std::exp(-0.138 * (side * shape - 1)) * probability;
  EXPECT_NEAR(found.box.width, 127 + rate * (252 - 127), 1e-3);
  EXPECT_NEAR(found.box.height, 127 + rate * (260 - 127), 1e-3);
  EXPECT_NEAR(found.box.x + found.box.width / 2, 300 + 2 * (32 + 3), 1e-3);
  EXPECT_NEAR(found.box.y + found.box.height / 2, 300 + 2 * (-16 - 5), 1e-3);
  EXPECT_NEAR(found.confidence, probability, 1e-5);
  EXPECT_FALSE(found.lost);
  ASSERT_EQ(found.parts.size(), 4U);
  const Point2 across = found.parts[1].position - found.parts[0].position;
  EXPECT_NEAR(across.x(), found.box.width / 2, 0.1 * found.box.width);
  // A saved one goes on alike.
  EXPECT_EQ(other.update(with_blue).box, found.box);
  EXPECT_EQ(other.update(image).box, tracker.update(image).box);

  const auto reason = [](const std::string& name) -> std::string {
    try {
      make_tracker(name);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(reason("dpt_net"), "dpt_net: name the folder of its networks, dpt_net:FOLDER");
  EXPECT_EQ(reason("dpt_net:/no/such"), "siamese: no folder \"/no/such\"");
  EXPECT_EQ(reason(R"(dpt_plus{"coarse": {"root": "siamese"}})"),
            "siamese: \"network\" has to name a folder with backbone.onnx and head.onnx");
}

TEST(NanoTrack, SaysWhichNetworkIsMissingOrWrong) {
  namespace fs = std::filesystem;
  const fs::path folder = fs::path(testing::TempDir()) / ("asterism_nanotrack_" + std::to_string(getpid()));
  const auto reason = [&folder] {
    try {
      evaluated_tracker("nanotrack:" + folder.string());
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  const fs::path networks = ASTERISM_TINY_NANOTRACK;
  const std::string backbone = (folder / "backbone.onnx").string(), head = (folder / "head.onnx").string();
  EXPECT_EQ(reason(), "nanotrack: no folder \"" + folder.string() + '"');
  fs::create_directory(folder);
  EXPECT_EQ(reason(),
            "nanotrack: no file " + backbone + "; the folder has to have backbone.onnx and head.onnx");
  fs::copy_file(networks / "backbone.onnx", backbone);
  EXPECT_EQ(reason(), "nanotrack: no file " + head + "; the folder has to have backbone.onnx and head.onnx");
  std::ofstream(head) << "no network";
  EXPECT_EQ(reason(), "nanotrack: " + head + " is not a network that OpenCV " CV_VERSION " reads");
  fs::copy_file(networks / "backbone.onnx", head, fs::copy_options::overwrite_existing);
  EXPECT_EQ(reason(),
            "nanotrack: the networks in " + folder.string() + " are not a backbone and a head of NanoTrack");
  fs::remove_all(folder);
}

#endif

TEST(EvaluatedTrackers, AreStoredUnderTheirNames) {
  EXPECT_EQ(name_of("nanotrack:/some/folder"), "nanotrack");
  EXPECT_EQ(name_of("dpt_net:/some/folder"), "dpt_net");
  EXPECT_EQ(name_of("opencv-csrt"), "opencv-csrt");
}

TEST(EvaluatedTrackers, SpeakTrax) {
  for (const char* command : {"trax:/no/such/program", "trax:exit 3", "trax:echo hello", "trax:sleep 9"})
    EXPECT_THROW(evaluated_tracker(command, 0.3).start(draw_smooth_frame(0), Region::rectangle(true_box(0))),
                 UnusableTracker)
        << command;
#ifdef ASTERISM_TRAX_TOOL
  const std::vector<Report> direct = follow(evaluated_tracker("kcf"));
  const std::vector<Report> through =
      follow(evaluated_tracker("trax:" ASTERISM_TRAX_TOOL " --tracker kcf 2>/dev/null"));
  for (std::size_t i = 0; i < direct.size(); ++i) {
    ASSERT_TRUE(through[i].region);
    EXPECT_GT(tools::overlap(through[i].region->box(), direct[i].region->box()), 0.99);
    EXPECT_NEAR(through[i].confidence, direct[i].confidence, 1e-3);
  }
#endif
}

}  // namespace
}  // namespace asterism::bench
