#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/method/ida.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/terms/registry.hpp>
#include <asterism/trackers/around/gated.hpp>
#include <asterism/trackers/constellation/elastic.hpp>
#include <asterism/trackers/constellation/stiffness.hpp>
#include <asterism/trackers/dpt/coarse.hpp>
#include <asterism/trackers/dpt/dpt.hpp>
#include <asterism/trackers/others/lgt.hpp>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <limits>
#include <optional>
#include <random>
#ifdef ASTERISM_TEST_JSON
#include <asterism/parts/concept/part_registry.hpp>
#endif

#include <asterism/testing/part_axioms.hpp>

#include "same_results.hpp"

#ifndef ASTERISM_TEST_EMULATOR
#define ASTERISM_TEST_EMULATOR ""
#endif

namespace asterism {
namespace {

using testing::texture;

// A textured object that moves along a known path on a textured background.
class Scene {
 public:
  Scene() : background_(texture(240, 320, 3)), object_(texture(64, 48, 9)) {
    // Reddish, so that the color model can distinguish it.
    object_ += cv::Scalar(0, 0, 80);
    background_ += cv::Scalar(60, 0, 0);
  }
  static cv::Rect2d box(int t) { return {100.0 + 2 * t, 80.0 + t, 48, 64}; }
  cv::Mat frame(int t) const {
    cv::Mat image = background_.clone();
    object_.copyTo(image(cv::Rect(box(t))));
    return image;
  }

 private:
  cv::Mat background_, object_;
};

class Trackers : public ::testing::TestWithParam<std::string> {};

TEST_P(Trackers, FollowsAMovingObject) {
  const Scene scene;
  AnyTracker tracker = make_tracker(GetParam());
  tracker.init(scene.frame(0), Scene::box(0));
  for (int t = 1; t <= 40; ++t) {
    const TrackResult result = tracker.update(scene.frame(t));
    const cv::Rect2d truth = Scene::box(t);
    ASSERT_NEAR(result.box.x, truth.x, 2) << t;
    ASSERT_NEAR(result.box.y, truth.y, 2) << t;
    ASSERT_NEAR(result.box.width, truth.width, 4) << t;
    ASSERT_FALSE(result.lost) << t;
    ASSERT_GT(result.confidence, 0.2) << t;
    ASSERT_LE(result.confidence, 1) << t;
    ASSERT_GT(result.milliseconds(), 0);
  }
}

TEST_P(Trackers, IsDeterministicAndStartsAnew) {
  const Scene scene;
  AnyTracker once = make_tracker(GetParam()), twice = make_tracker(GetParam());
  // Earlier use must leave no trace, even with another frame size.
  twice.init(texture(100, 100, 5), {20, 20, 30, 40});
  twice.update(texture(100, 100, 6));
  once.init(scene.frame(0), Scene::box(0));
  twice.init(scene.frame(0), Scene::box(0));
  for (int t = 1; t <= 10; ++t) expect_same(once.update(scene.frame(t)), twice.update(scene.frame(t)));
}

// Not a test but a helper program: prints every bit of a run for the test below.
TEST_P(Trackers, DISABLED_Digest) {
  const Scene scene;
  AnyTracker tracker = make_tracker(GetParam());
  tracker.init(scene.frame(0), Scene::box(0));
  for (int t = 1; t <= 10; ++t) {
    const TrackResult result = tracker.update(scene.frame(t));
    std::printf("digest %a %a %a %a %a", result.box.x, result.box.y, result.box.width, result.box.height,
                result.confidence);
    for (const PartState& part : result.parts)
      std::printf(" %a %a %a", part.position.x(), part.position.y(), part.weight);
    std::printf("\n");
  }
}

// Results are the same bit for bit in every process.
TEST_P(Trackers, GivesTheSameBitsInAnotherProcess) {
  if (!std::filesystem::exists("/proc/self/exe")) GTEST_SKIP() << "no /proc/self/exe here";
  const std::string self = std::filesystem::read_symlink("/proc/self/exe").string();
  const std::string test = ::testing::UnitTest::GetInstance()->current_test_info()->name();
  const std::string filter = "All/Trackers.DISABLED_Digest" + test.substr(test.find('/'));
  const auto run = [&] {
    std::string digest;
    FILE* pipe = popen(
        (ASTERISM_TEST_EMULATOR + self + " --gtest_also_run_disabled_tests --gtest_filter=" + filter).c_str(),
        "r");
    if (pipe == nullptr) return digest;
    std::string line(1 << 16, '\0');  // room for hundreds of parts
    while (std::fgets(line.data(), static_cast<int>(line.size()), pipe) != nullptr)
      if (line.starts_with("digest")) digest += line.c_str();
    pclose(pipe);
    return digest;
  };
  const std::string first = run();
  EXPECT_EQ(std::count(first.begin(), first.end(), '\n'), 10);
  EXPECT_EQ(first, run());
}

// The same pixels in every format that Frame accepts give the same boxes.
TEST_P(Trackers, TakesGrayAndAlphaAndDeepImages) {
  const Scene scene;
  const auto convert = [](const cv::Mat& image, int code) {
    cv::Mat result;
    cv::cvtColor(image, result, code);
    return result;
  };
  const auto deepen = [](const cv::Mat& image, int depth) {
    cv::Mat result;
    image.convertTo(result, depth, depth == CV_16U ? 257 : 1.0 / 255);
    return result;
  };
  for (const bool color : {true, false}) {
    const auto frame = [&](int t) {
      return color ? scene.frame(t) : convert(scene.frame(t), cv::COLOR_BGR2GRAY);
    };
    const auto with_alpha = [&](int t) {
      return convert(frame(t), color ? cv::COLOR_BGR2BGRA : cv::COLOR_GRAY2BGRA);
    };
    const std::vector<std::function<cv::Mat(int)>> forms{
        [&](int t) { return deepen(frame(t), CV_16U); }, [&](int t) { return deepen(frame(t), CV_32F); },
        with_alpha, [&](int t) { return deepen(with_alpha(t), CV_16U); },
        [&](int t) {  // part of a larger image: rows with gaps between them
          cv::Mat large;
          cv::copyMakeBorder(frame(t), large, 3, 3, 5, 5, cv::BORDER_CONSTANT);
          return large(cv::Rect({5, 3}, frame(t).size()));
        }};
    AnyTracker expected = make_tracker(GetParam());
    expected.init(frame(0), Scene::box(0));
    std::vector<AnyTracker> trackers;
    for (const auto& form : forms) {
      trackers.push_back(make_tracker(GetParam()));
      trackers.back().init(form(0), Scene::box(0));
    }
    // LGT's box includes parts that were added beside the object: without color little prevents that.
    const double near = GetParam() == "lgt" && !color ? 8 : 2;
    for (int t = 1; t <= 5; ++t) {
      const TrackResult result = expected.update(frame(t));
      EXPECT_NEAR(result.box.x, Scene::box(t).x, near) << t;
      for (std::size_t i = 0; i < forms.size(); ++i) {
        // Models that use color treat gray levels in four channels as a color video.
        const bool another = !color && (i == 2 || i == 3);
        if (another) {
          EXPECT_NEAR(trackers[i].update(forms[i](t)).box.x, Scene::box(t).x, near) << t;
        } else {
          expect_same(trackers[i].update(forms[i](t)), result);
        }
      }
    }
    // A gray frame in a color video is valid, and vice versa.
    EXPECT_NO_THROW(expected.update(color ? convert(frame(6), cv::COLOR_BGR2GRAY) : scene.frame(6)));
  }
}

TEST_P(Trackers, RefusesBadStartsAndKeepsItsState) {
  const Scene scene;
  AnyTracker tracker = make_tracker(GetParam());
  EXPECT_THROW(tracker.update(scene.frame(0)), std::logic_error);
  AnyTracker reference = make_tracker(GetParam());
  tracker.init(scene.frame(0), Scene::box(0));
  reference.init(scene.frame(0), Scene::box(0));
  const double nan = std::nan("");
  for (const cv::Rect2d& box :
       {cv::Rect2d(0, 0, 0, 10), cv::Rect2d(10, 10, -5, 5), cv::Rect2d(10, 10, 0.5, 20),
        cv::Rect2d(nan, 0, 10, 10), cv::Rect2d(0, 0, INFINITY, 10), cv::Rect2d(320, 10, 20, 20),
        cv::Rect2d(-30, 10, 20, 20)})
    EXPECT_THROW(tracker.init(scene.frame(0), box), std::invalid_argument) << box;
  EXPECT_THROW(tracker.init(cv::Mat(), {1, 1, 5, 5}), std::invalid_argument);
  EXPECT_THROW(tracker.update(cv::Mat()), std::invalid_argument);
  EXPECT_THROW(tracker.update(cv::Mat(10, 10, CV_32SC1, cv::Scalar(0))), std::invalid_argument);
  for (int t = 1; t <= 3; ++t) expect_same(tracker.update(scene.frame(t)), reference.update(scene.frame(t)));
}

// Boxes that crashed reference trackers: thin, tiny, as large as the frame, across its edge, on a constant
// image.
TEST_P(Trackers, HandlesOddBoxes) {
  const cv::Mat first = texture(720, 1280, 2), second = testing::shifted(first, 1, 1);
  for (const cv::Rect2d& box :
       {cv::Rect2d(5, 5, 500, 10), cv::Rect2d(600, 300, 1, 1), cv::Rect2d(0, 0, 1280, 720),
        cv::Rect2d(300, 2, 3, 700), cv::Rect2d(-20, -20, 60, 60), cv::Rect2d(1270, 700, 40, 40),
        cv::Rect2d(-100, -100, 1500, 1000)}) {
    AnyTracker tracker = make_tracker(GetParam());
    tracker.init(first, box);
    for (int t = 0; t < 3; ++t) {
      const TrackResult result = tracker.update(second);
      EXPECT_TRUE(std::isfinite(result.box.x) && std::isfinite(result.box.y)) << box;
      EXPECT_GT(result.box.width, 0) << box;
      EXPECT_GT(result.box.height, 0) << box;
    }
  }
  AnyTracker tracker = make_tracker(GetParam());
  cv::Mat flat(240, 320, CV_8UC3, cv::Scalar(90, 120, 30));
  EXPECT_THROW(tracker.init(flat, {100, 100, 40, 40}), std::invalid_argument);
  flat(cv::Rect(110, 110, 20, 20)).setTo(cv::Scalar(90, 130, 30));
  tracker.init(flat, {100, 100, 40, 40});
  for (int t = 0; t < 3; ++t) EXPECT_NEAR(tracker.update(flat).box.x, 100, 5);
}

// Unrelated frames may drive models and constellation anywhere, but all numbers stay finite.
TEST_P(Trackers, SurvivesNoise) {
  AnyTracker tracker = make_tracker(GetParam());
  tracker.init(texture(120, 160, 1), {50, 40, 40, 30});
  for (std::uint32_t t = 2; t < 300; ++t) {
    const TrackResult result = tracker.update(texture(120, 160, t));
    ASSERT_TRUE(std::isfinite(result.box.x) && std::isfinite(result.box.y) &&
                std::isfinite(result.confidence))
        << t;
    ASSERT_GE(result.box.width, 4) << t;
    ASSERT_LE(result.box.width, 400) << t;
  }
}

TEST_P(Trackers, SurvivesAChangeOfFrameSize) {
  const Scene scene;
  AnyTracker tracker = make_tracker(GetParam());
  tracker.init(scene.frame(0), Scene::box(0));
  for (const cv::Size& size : {cv::Size(640, 480), cv::Size(40, 30), cv::Size(320, 240), cv::Size(1, 1)}) {
    cv::Mat image;
    cv::resize(scene.frame(1), image, size);
    const TrackResult result = tracker.update(image);
    EXPECT_TRUE(std::isfinite(result.box.x) && std::isfinite(result.box.width));
  }
}

// Without the variants of DPT that only set options (MakeTracker.VariantsAreOptions).
std::vector<std::string> distinct_names() {
  std::vector<std::string> names = tracker_names();
  std::erase_if(names,
                [](const std::string& name) { return name.starts_with("dpt_") && name != "dpt_plus"; });
  return names;
}
INSTANTIATE_TEST_SUITE_P(All, Trackers, ::testing::ValuesIn(distinct_names()));

TEST(MakeTracker, NamesTheKnownOnesInItsError) {
  try {
    make_tracker("ncc");
    FAIL();
  } catch (const std::invalid_argument& error) {
    for (const std::string& name : tracker_names())
      EXPECT_NE(std::string(error.what()).find(name), std::string::npos) << error.what();
  }
}

#ifdef ASTERISM_TEST_JSON
std::string refusal(const std::string& description) {
  try {
    make_tracker(description);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "taken";
}

TEST(MakeTracker, TakesOptionsAsJson) {
  const Scene scene;
  const auto parts = [&](const std::string& description) {
    AnyTracker tracker = make_tracker(description);
    tracker.init(scene.frame(0), Scene::box(0));
    return tracker.update(scene.frame(1)).parts.size();
  };
  EXPECT_EQ(parts("dpt{}"), 4u);
  EXPECT_EQ(parts(R"(dpt{"grid_rows": 3, "part": "mosse", "constellation": "star"})"), 6u);
  EXPECT_EQ(parts(R"({"tracker": "dpt", "grid_cols": 1, "part": {"model": "kcf", "lambda": 1e-3}})"), 2u);
  EXPECT_EQ(parts("dpt+template"), 4u);
  EXPECT_EQ(parts(R"(coarse{"use_color": false, "root": "mosse"})"), 0u);
}

// The names of variants stand for options.
TEST(MakeTracker, VariantsAreOptions) {
  const Scene scene;
  const auto last = [&](std::string_view description) {
    AnyTracker tracker = make_tracker(description);
    tracker.init(scene.frame(0), Scene::box(0));
    TrackResult result;
    for (int t = 1; t <= 5; ++t) result = tracker.update(scene.frame(t));
    return result;
  };
  for (const auto& [name, description] : std::initializer_list<std::pair<const char*, const char*>>{
           {"dpt_loc", R"(dpt{"constellation": "local"})"},
           {"dpt_str", R"(dpt{"constellation": "star"})"},
           {"dpt_3x3_ov", R"(dpt{"grid_rows": 3, "grid_cols": 3, "overlap": 0.5})"},
           {"dpt_3x3_nov", R"(dpt{"grid_rows": 3, "grid_cols": 3})"},
           {"dpt_crs", "coarse"},
           {"dpt_crs_nos", R"(dpt_crs{"use_color": false})"},
           {"dpt_local", R"(dpt{"constellation": "local"})"},
           {"dpt_star", R"(dpt{"constellation": "star"})"},
           {"dpt_nine_overlapping", R"(dpt{"grid_rows": 3, "grid_cols": 3, "overlap": 0.5})"},
           {"dpt_nine_parts", R"(dpt{"grid_rows": 3, "grid_cols": 3})"},
           {"dpt_coarse_no_color", R"(dpt_crs{"use_color": false})"},
           {R"(dpt{"part": "mosse"})", "dpt+mosse"}}) {
    SCOPED_TRACE(name);
    expect_same(last(name), last(description));
  }
}

// The listed options make the same tracker, and list the same.
TEST(TrackerOptions, AreADescription) {
  const Scene scene;
  std::vector<std::string> descriptions = tracker_names();
  descriptions.insert(
      descriptions.end(),
      {"dpt+mosse", R"(dpt{"overlap": 0.5})", R"(kalman{"of": "kcf", "lost_factor": 7})",
       R"(dpt{"solver": {"method": "newton", "max_iterations": 7, "tolerance": 1e-3, "align": false}})",
       R"({"tracker": "dpt", "grid_rows": 3, "part": {"model": "template", "distance": "ssd"}})"});
  for (const std::string& description : descriptions) {
    SCOPED_TRACE(description);
    const std::string listed = tracker_options(description);
    EXPECT_EQ(tracker_options(listed), listed);
    AnyTracker first = make_tracker(description), second = make_tracker(listed);
    for (AnyTracker* tracker : {&first, &second}) tracker->init(scene.frame(0), Scene::box(0));
    for (int t = 1; t <= 3; ++t) expect_same(second.update(scene.frame(t)), first.update(scene.frame(t)));
  }
}

TEST(TrackerOptions, AreThoseThatWereSet) {
  const auto has = [](const std::string& description, const char* text) {
    return tracker_options(description).find(text) != std::string::npos;
  };
  EXPECT_TRUE(has("dpt", R"("grid_rows": 2)"));
  EXPECT_TRUE(has(R"(dpt{"grid_rows": 3})", R"("grid_rows": 3)"));
  EXPECT_TRUE(has("dpt_plus", R"("model": "spatial_reliability")"));
  EXPECT_TRUE(has("kcf", R"("proportional_window": true)"));
  EXPECT_TRUE(has(R"(dpt{"solver": {"max_iterations": 7}})", R"("method": "ida",)"));
  EXPECT_TRUE(has(R"(kalman{"of": "kcf"})", R"("tracker": "kcf")"));
  EXPECT_THROW(tracker_options("ncc"), std::invalid_argument);
  EXPECT_THROW(tracker_options(R"(dpt{"grid_row": 3})"), std::invalid_argument);
}

TEST(MakeTracker, SaysWhatIsWrongWithADescription) {
  EXPECT_EQ(refusal(R"(dpt{"grid_row": 3})"), "dpt: unknown option 'grid_row', did you mean 'grid_rows'?");
  EXPECT_EQ(refusal(R"(dpt{"coarse": {"color": {"mrf": {"on": true}}}})"),
            "dpt: unknown option 'coarse.color.mrf.on', did you mean 'coarse.color.mrf.enabled'?");
  EXPECT_EQ(refusal(R"(dpt{"constellation": "ring"})"),
            R"(dpt: option 'constellation' must be one of "full", "local", "star", not "ring")");
  EXPECT_EQ(refusal(R"(dpt{"part": "kfc"})"), "unknown part model 'kfc', did you mean 'kcf'?");
  EXPECT_EQ(refusal(R"(dpt{"part": {"lambda": 1}})"),
            "dpt: option 'part' must be a part model's name or an object with it as \"model\", not "
            R"({"lambda":1})");
  EXPECT_EQ(refusal(R"(dpt{"part": {"model": "kcf", "lambda": -1}})"),
            "kcf: KcfOptions: lambda must be in [1e-09, 1000000000], is -1");
  EXPECT_EQ(refusal(R"(dpt{"spring_rate": 2})"), "DptOptions: spring_rate must be in [0, 1], is 2");
  EXPECT_EQ(refusal(R"(dpt_plus{"redetct": true})"),
            "dpt_plus: unknown option 'redetct', did you mean 'redetect'?");
  EXPECT_EQ(refusal(R"(kalman{"off": "kcf"})"), "kalman: unknown option 'off', did you mean 'of'?");
  EXPECT_EQ(refusal(R"(kalman{"of": {"tracker": "lgt", "redetct": true}})"),
            "lgt: unknown option 'redetct', did you mean 'redetect'?");
  EXPECT_EQ(refusal(R"(dpt{"solver": {"methd": "newton"}})"),
            "dpt: unknown option 'solver.methd', did you mean 'method'?");
  EXPECT_EQ(refusal(R"(dpt{"solver": {"max_iteration": 3}})"),
            "ida: unknown option 'max_iteration', did you mean 'max_iterations'?");
  EXPECT_EQ(refusal(R"({"part": "kcf"})"), "a tracker's description must have its name as \"tracker\"");
  EXPECT_NE(refusal(R"({"tracker": "dp"})").find("unknown tracker 'dp', did you mean 'dpt'?"),
            std::string::npos);
  EXPECT_NE(refusal("DPTT").find("did you mean 'dpt'? (known: dpt, "), std::string::npos);
  for (const char* of_dpt_plus : {"dpt_plusx", "dpt_plus ", "DPT-Plus", "dptplus"})
    EXPECT_NE(refusal(of_dpt_plus).find("did you mean 'dpt_plus'? (known"), std::string::npos) << of_dpt_plus;
  for (const char* of_opencv : {"csrt", "CSRT", "opencv-csrt", "opencv_csrt"})
    EXPECT_NE(refusal(of_opencv).find("asterism-eval runs as 'opencv-csrt'"), std::string::npos) << of_opencv;
  for (const auto& [of_others, evaluated] :
       {std::pair("dlib", "dlib"), std::pair("nanotrack", "nanotrack:FOLDER"),
        std::pair("trax:kcf", "trax:kcf")})
    EXPECT_NE(refusal(of_others).find(std::string(" as '") + evaluated + "'"), std::string::npos)
        << of_others;
  EXPECT_NE(refusal("dpt{").find("dpt: its options are not a JSON object"), std::string::npos);
  EXPECT_NE(refusal("{").find("not a JSON object"), std::string::npos);
  EXPECT_NE(refusal(R"({"tracker": "dpt", "spring_rate": 1e999})").find("not a JSON object"),
            std::string::npos);
  const std::string deep(100000, '[');
  EXPECT_EQ(refusal("{\"tracker\": " + deep), "a tracker's description: options nested more than 100 deep");
  EXPECT_EQ(refusal("kalman{\"of\": " + deep), "kalman: options nested more than 100 deep");
}

// Any model can be the root of the coarse layer: with color if it has a response map, otherwise without.
TEST(Coarse, AnyModelCanBeTheRoot) {
  const Scene scene;
  PartRegistry registry;
  for (const std::string& model : registry.names()) {
    CoarseOptions options;
    options.root = registry.make(model);
    // Color options with which the random field converges and the posterior is flat on the object: some
    // models' responses are so flat at their maximum that they would follow a slope.
    options.color = ColorOptions();
    CoarseTracker tracker(options);
    tracker.init(scene.frame(0), Scene::box(0));
    TrackResult result;
    for (int t = 1; t <= 10; ++t) result = tracker.update(scene.frame(t));
    EXPECT_NEAR(result.box.x, Scene::box(10).x, 4) << model;
    EXPECT_NEAR(result.box.y, Scene::box(10).y, 4) << model;
  }
}
#endif

// The tracker reports that the object has vanished: at once that the response is weak and, where the box is
// judged by the first frame, after some frames that the object is lost.
TEST(Dpt, ReportsALostTarget) {
  const Scene scene;
  const cv::Mat empty(240, 320, CV_8UC3, cv::Scalar(20, 200, 20));
  for (const bool judge : {false, true}) {
    DptOptions options;
    options.judge = judge;
    Dpt tracker(options);
    tracker.init(scene.frame(0), Scene::box(0));
    for (int t = 1; t <= 10; ++t) EXPECT_FALSE(tracker.update(scene.frame(t)).lost);
    TrackResult result = tracker.update(empty);
    EXPECT_TRUE(result.is_weak());
    EXPECT_EQ(result.lost, !judge);
    EXPECT_EQ(result.probability.has_value(), judge);
    for (int i = 0; i < 20; ++i) result = tracker.update(empty);
    EXPECT_TRUE(result.lost);
    EXPECT_LT(result.probability.value_or(0), 0.2);
  }
}

// The mean posterior of the box leads to the object where the filter finds nothing.
TEST(Coarse, ColorAloneFindsTheObject) {
  const Scene scene;
  CoarseOptions options;
  options.color_share = 1;
  CoarseTracker tracker(options);
  tracker.init(scene.frame(0), Scene::box(0));
  const cv::Rect2d box = tracker.update(scene.frame(8)).box;  // 18 px at once
  EXPECT_LT((centre_of(box) - centre_of(Scene::box(8))).norm(), 3);
}

TEST(Dpt, PartsTileTheBoxAndTheirSpringsFollowTheEquations) {
  const Scene scene;
  Dpt tracker;
  tracker.init(scene.frame(0), Scene::box(0));
  const TrackResult result = tracker.update(scene.frame(1));
  ASSERT_EQ(result.parts.size(), 4u);
  ASSERT_EQ(result.links.size(), 6u);
  const cv::Rect2d truth = Scene::box(1);
  for (int i = 0; i < 4; ++i) {
    const PartState& part = result.parts[static_cast<std::size_t>(i)];
    EXPECT_EQ(part.size, Size2(24, 32));
    const cv::Rect2d quarter(truth.x + (i % 2) * 24, truth.y + (i / 2) * 32, 24, 32);
    EXPECT_LT((part.position - centre_of(quarter)).norm(), 1.5) << i;
    EXPECT_TRUE(part.updated) << i;
  }
  // The placement is a stationary point of the energy of its spring system.
  EXPECT_TRUE(tracker.summary().usable());
  EXPECT_LE(tracker.summary().final_energy, tracker.summary().initial_energy);
  // alpha_spr = 0.95: the rest lengths nearly equal those of the new placement.
  ASSERT_EQ(result.links.size(), static_cast<std::size_t>(tracker.springs().rest_lengths().cols()));
  for (int l = 0; const Link& link : result.links) {
    const double now = (result.parts[static_cast<std::size_t>(link.i)].position -
                        result.parts[static_cast<std::size_t>(link.j)].position)
                           .norm();
    EXPECT_NEAR(tracker.springs().rest_lengths()(0, l++), now, 0.2);
  }
}

// Nine parts of the size of four: together they still cover the box, each part's centre on its neighbour's
// corner.
TEST(Dpt, OverlappingPartsCoverTheBox) {
  const Scene scene;
  DptOptions options;
  options.grid_rows = options.grid_cols = 3;
  options.overlap = 0.5;
  Dpt tracker(options);
  tracker.init(scene.frame(0), Scene::box(0));
  const TrackResult result = tracker.update(scene.frame(1));
  ASSERT_EQ(result.parts.size(), 9u);
  const cv::Rect2d truth = Scene::box(1);
  for (int i = 0; i < 9; ++i) {
    const PartState& part = result.parts[static_cast<std::size_t>(i)];
    EXPECT_EQ(part.size, Size2(24, 32));
    const cv::Rect2d box(truth.x + (i % 3) * 12, truth.y + (i / 3) * 16, 24, 32);
    EXPECT_LT((part.position - centre_of(box)).norm(), 1.5) << i;
  }
}

TEST(Dpt, ShowsWhatItSolves) {
  struct Solve {
    SpringSystem<double, 2> system;
    Dpt::Placement start;
    std::vector<Evidence> evidence;
    cv::Rect2d start_box;
    Summary summary;
  };
  std::vector<Solve> solves;
  DptOptions options;
  options.on_solve = [&](const DptSolve& solve) {
    solves.push_back({springs_of(solve.springs),
                      solve.start,
                      {solve.evidence.begin(), solve.evidence.end()},
                      solve.start_box,
                      solve.summary});
  };
  const Scene scene;
  Dpt watched(options), alone;
  watched.init(scene.frame(0), Scene::box(0));
  alone.init(scene.frame(0), Scene::box(0));
  for (int t = 1; t <= 10; ++t) {
    const TrackResult result = watched.update(scene.frame(t));
    expect_same(result, alone.update(scene.frame(t)));
    // The paper's algorithm for the recorded springs, from the recorded start, finds the tracker's placement.
    ASSERT_EQ(solves.size(), static_cast<std::size_t>(t));
    const Solve& last = solves.back();
    Dpt::Placement x = last.start;
    const Summary summary = Ida(last.system).solve(last.system, x);
    EXPECT_NEAR(summary.iterations, last.summary.iterations, 1);
    EXPECT_NEAR(summary.initial_energy, last.summary.initial_energy, 1e-12 * summary.initial_energy);
    EXPECT_NEAR(summary.final_energy, last.summary.final_energy, 1e-12 * summary.initial_energy);
    for (std::size_t i = 0; i < 4; ++i)
      EXPECT_LT((x.col(static_cast<Eigen::Index>(i)) - result.parts[i].position).norm(), 1e-5);
    // The evidence is what the springs follow from.
    ASSERT_EQ(last.evidence.size(), 4u);
    for (std::size_t i = 0; i < 4; ++i) {
      const Evidence& part = last.evidence[i];
      EXPECT_EQ(part.position, result.parts[i].visual_best);
      EXPECT_EQ(last.system.anchor_stiffness(static_cast<Eigen::Index>(i)),
                part.peak / part.covariance.trace());
    }
    // The box follows from that of the start by the similarity between the placements.
    const PlaneTransform step = fit_transform(last.start, x, TransformModel::Similarity);
    EXPECT_LT((step(centre_of(last.start_box)) - centre_of(result.box)).norm(), 1e-5);
    EXPECT_NEAR(step.scale * last.start_box.width, result.box.width, 1e-5);
  }
}

TEST(Dpt, GoesOnAfterAnObserverThatThrows) {
  DptOptions options;
  bool throws = false;
  options.on_solve = [&](const DptSolve&) {
    if (throws) throw std::runtime_error("full");
  };
  const Scene scene;
  Dpt disturbed(options), alone;
  disturbed.init(scene.frame(0), Scene::box(0));
  alone.init(scene.frame(0), Scene::box(0));
  for (int t = 1; t <= 6; ++t) {
    throws = t == 3;
    if (throws) {
      EXPECT_THROW(disturbed.update(scene.frame(t)), std::runtime_error);
    } else {
      expect_same(disturbed.update(scene.frame(t)), alone.update(scene.frame(t)));
    }
  }
}

// Half of the object is covered: the covered parts must not learn the occluder.
TEST(Dpt, OccludedPartsAreNotUpdated) {
  const Scene scene;
  Dpt tracker;
  tracker.init(scene.frame(0), Scene::box(0));
  for (int t = 1; t <= 10; ++t) tracker.update(scene.frame(t));
  int left_updates = 0, right_updates = 0;
  for (int t = 11; t <= 15; ++t) {
    cv::Mat image = scene.frame(t);
    const cv::Rect2d box = Scene::box(t);
    cv::rectangle(image, cv::Rect2d(box.x + 24, box.y - 10, 40, 84), cv::Scalar(40, 220, 40), cv::FILLED);
    const TrackResult result = tracker.update(image);
    for (std::size_t i = 0; i < 4; ++i)
      (i % 2 == 0 ? left_updates : right_updates) += result.parts[i].updated;
    EXPECT_NEAR(result.box.x, box.x, 6) << t;
  }
  EXPECT_GE(left_updates, 8);
  EXPECT_EQ(right_updates, 0);
}

// The size of a growing object is followed through its constellation, and through a scale filter.
TEST(Dpt, FollowsSize) {
  const cv::Mat background = texture(240, 320, 3), object = texture(60, 60, 9);
  const auto frame = [&](double scale) {
    cv::Mat image = background.clone(), scaled;
    const int side = static_cast<int>(std::lround(60 * scale));
    cv::resize(object, scaled, {side, side}, 0, 0, cv::INTER_AREA);
    scaled.copyTo(image(cv::Rect(160 - side / 2, 120 - side / 2, side, side)));
    return image;
  };
  for (const double share : {0.0, 0.5, 1.0}) {
    DptOptions options;
    options.scale_filter_share = share;
    Dpt tracker(options);
    tracker.init(frame(1), {130, 90, 60, 60});
    double scale = 1;
    TrackResult result;
    for (int t = 0; t < 40; ++t) result = tracker.update(frame(scale *= 1.01));
    EXPECT_NEAR(result.box.width, 60 * scale, 8) << share;
    for (const PartState& part : result.parts)
      EXPECT_EQ(part.size.x(), 30) << share;  // parts keep their size
    // The placement is scaled with the box.
    if (share > 0) {
      const double spread = (result.parts[1].position - result.parts[0].position).norm();
      EXPECT_NEAR(spread, result.box.width / 2, 0.1 * spread) << share;
    }
  }
}

// The root's evidence is a measurement of the centre beside the constellation's: by its information, and with
// a very large one the root alone.
TEST(Dpt, WeighsTheRoot) {
  const Scene scene;
  Point2 centre[3], root;
  Eigen::Matrix2d covariance[3];
  double stiffness = 0;
  for (int i = 0; i < 3; ++i) {
    DptOptions options;
    options.root_weight = i == 2 ? 1e9 : i;
    Dpt tracker(options);
    tracker.init(scene.frame(0), Scene::box(0));
    const TrackResult result = tracker.update(scene.frame(1));
    ASSERT_TRUE(result.covariance);
    centre[i] = centre_of(result.box);
    covariance[i] = result.covariance->topLeftCorner<2, 2>();
    root = tracker.coarse().evidence().position;
    stiffness = static_stiffness(tracker.coarse().evidence(), options.stiffness);
  }
  const Eigen::Matrix2d parts = covariance[0].inverse(),
                        both = parts + stiffness * Eigen::Matrix2d::Identity();
  EXPECT_GT((centre[0] - root).norm(), 1e-3);
  EXPECT_LT((centre[1] - both.inverse() * (parts * centre[0] + stiffness * root)).norm(), 1e-6);
  EXPECT_TRUE(covariance[1].isApprox(both.inverse(), 1e-9));
  EXPECT_LT((centre[2] - root).norm(), 1e-6);
}

TEST(TrackResult, CornersGoRoundTheTurnedBox) {
  TrackResult result;
  result.box = {10, 20, 40, 10};
  using Corners = std::array<cv::Point2d, 4>;
  EXPECT_EQ(result.corners(), (Corners{{{10, 20}, {50, 20}, {50, 30}, {10, 30}}}));
  // A quarter turn from x to y about the middle (30, 25): the top left corner becomes the top right one.
  result.angle = std::acos(-1) / 2;
  const Corners expected{{{35, 5}, {35, 45}, {25, 45}, {25, 5}}}, found = result.corners();
  for (std::size_t i = 0; i < 4; ++i) EXPECT_LT(cv::norm(found[i] - expected[i]), 1e-12) << i;
  // A part, whose position refers to a pixel's centre.
  PartState part;
  part.position = {29.5, 24.5};
  part.size = {40, 10};
  const Corners of_part = result.corners(part);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_LT(cv::norm(of_part[i] - expected[i]), 1e-12) << i;
}

// The angle of a rotating object is followed through its parts.
TEST(Dpt, FollowsRotation) {
  const cv::Mat background = texture(240, 320, 3) + cv::Scalar(60, 0, 0),
                object = texture(60, 80, 9) + cv::Scalar(0, 0, 80);
  const auto frame = [&](double angle) {
    cv::Mat image = background.clone();
    const double c = std::cos(angle), s = std::sin(angle), x = 39.5, y = 29.5;
    const cv::Matx23d place(c, -s, 160 - c * x + s * y, s, c, 120 - s * x - c * y);
    cv::warpAffine(object, image, place, image.size(), cv::INTER_LINEAR, cv::BORDER_TRANSPARENT);
    return image;
  };
  for (const double step : {0.01, -0.01}) {
    Dpt tracker;
    tracker.init(frame(0), {120.5, 90.5, 80, 60});
    double angle = 0;
    TrackResult result;
    for (int t = 0; t < 30; ++t) result = tracker.update(frame(angle += step));
    EXPECT_NEAR(result.angle, angle, 0.12) << "filters that learn the turning appearance lag behind";
    // The corners match those of the drawn object, in coordinates of pixel edges.
    const double c = std::cos(angle), s = std::sin(angle);
    for (std::size_t i = 0; i < 4; ++i) {
      const double x = i == 1 || i == 2 ? 40 : -40, y = i >= 2 ? 30 : -30;
      const cv::Point2d truth(160.5 + c * x - s * y, 120.5 + s * x + c * y);
      EXPECT_LT(cv::norm(result.corners()[i] - truth), 5) << i;
    }
    tracker.init(frame(0), {120.5, 90.5, 80, 60});
    EXPECT_NEAR(tracker.update(frame(0)).angle, 0, 0.01) << "init begins upright";
  }
}

TEST(Dpt, EveryGridAndTopologyTracks) {
  const Scene scene;
  for (const auto& [rows, cols] : {std::pair{1, 1}, {1, 2}, {2, 2}, {3, 3}, {4, 4}})
    for (const Constellation constellation :
         {Constellation::Full, Constellation::Local, Constellation::Star}) {
      DptOptions options;
      options.grid_rows = rows;
      options.grid_cols = cols;
      options.constellation = constellation;
      Dpt tracker(options);
      tracker.init(scene.frame(0), Scene::box(0));
      TrackResult result;
      for (int t = 1; t <= 5; ++t) result = tracker.update(scene.frame(t));
      EXPECT_NEAR(result.box.x, Scene::box(5).x, 3) << rows << "x" << cols;
      EXPECT_TRUE(tracker.summary().usable()) << tracker.summary().message;
    }
}

TEST(Dpt, NewtonFindsThePlacementsOfIda) {
  const Scene scene;
  DptOptions options;
  options.solver = {"newton", {}};
  int solves = 0;
  options.on_solve = [&](const DptSolve& solve) {
    const SpringSystem<double, 2> springs = springs_of(solve.springs);
    const Dpt::Placement& start = solve.start;
    const Summary& summary = solve.summary;
    EXPECT_EQ(summary.solver, system_solvers().make("newton").name());
    Dpt::Placement newton = start, ida = start;
    EXPECT_NEAR(Newton(springs).solve(springs, newton).final_energy, summary.final_energy,
                1e-9 * summary.initial_energy);
    Ida(springs).solve(springs, ida);
    EXPECT_LT((newton - ida).colwise().norm().maxCoeff(), 1e-3);
    ++solves;
  };
  Dpt tracker(options);
  tracker.init(scene.frame(0), Scene::box(0));
  for (int t = 1; t <= 10; ++t) tracker.update(scene.frame(t));
  EXPECT_EQ(solves, 10);
}

TEST(Dpt, SaysWhetherThePlacementIsProven) {
  const Scene scene;
  DptOptions options;
  options.certify = true;
  std::optional<bool> expected;
  options.on_solve = [&](const DptSolve& solve) {
    Dpt::Placement x = solve.start;
    const SpringSystem<double, 2> springs = springs_of(solve.springs);
    Ida(springs).solve(springs, x);
    expected = certify(springs, x).certified();
  };
  Dpt tracker(options), plain;
  tracker.init(scene.frame(0), Scene::box(0));
  plain.init(scene.frame(0), Scene::box(0));
  int certified = 0;
  for (int t = 1; t <= 10; ++t) {
    const TrackResult result = tracker.update(scene.frame(t));
    EXPECT_EQ(result.certified, expected);
    certified += result.certified.value_or(false) ? 1 : 0;
    const TrackResult other = plain.update(scene.frame(t));
    EXPECT_EQ(other.certified, std::nullopt);
    EXPECT_EQ(other.box, result.box);
  }
  EXPECT_GT(certified, 5);
}

// Exponents, scale and floor against the formulas, written with logarithms.
TEST(Stiffness, FollowsTheParametersOfItsLaw) {
  const StiffnessLaw law{.peak_exponent = 0.5,
                         .variance_exponent = 1.5,
                         .link_scale = 3,
                         .strain_exponent = 1.2,
                         .strain_floor = 0.1};
  Evidence evidence{{3, 4}, 0.7, 5 * Eigen::Matrix2d::Identity()};
  const double k = std::exp(0.5 * std::log(0.7) - 1.5 * std::log(10));
  EXPECT_NEAR(static_stiffness(evidence, law), k, 1e-15);
  for (const double distance : {30.0, 40.0, 55.0}) {
    const double strain = std::abs(40 - distance) / 40;
    EXPECT_NEAR(dynamic_stiffness(40, distance, law), 3 * std::exp(1.2 * std::log(std::hypot(strain, 0.1))),
                1e-14);
  }
  EXPECT_EQ(dynamic_stiffness(0, 3, law), 0);
  // Without any response, and for a part that breaks its promise, too.
  for (const double peak : {0.0, -1.0})
    for (const double exponent : {0.3, 1.0, 4.0}) {
      evidence.peak = peak;
      EXPECT_EQ(static_stiffness(evidence, {.peak_exponent = exponent}), 1e-12 / 10);
    }
  EXPECT_EQ(static_stiffness(evidence, {.peak_exponent = 0}), 0.1);  // all anchors are alike
  EXPECT_EQ(dynamic_stiffness(40, 40, {.strain_exponent = 0}), 1);   // all links are alike
}

// The default law is the paper's to the last bit.
TEST(Stiffness, IsThePapersByDefault) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (int k = 0; k < 10'000; ++k) {
    const double peak = uniform(random), mu = 100 * uniform(random), distance = 100 * uniform(random);
    Evidence evidence{{0, 0}, peak, Eigen::Matrix2d::Identity()};
    evidence.covariance(0, 0) = 1000 * uniform(random) + 1e-3;
    ASSERT_EQ(static_stiffness(evidence), peak / evidence.covariance.trace());
    const double strain = (mu - distance) / mu;
    ASSERT_EQ(dynamic_stiffness(mu, distance), strain * strain);
  }
}

// The option reaches the springs, those of the first frame that is solved: all before it is the same.
TEST(Dpt, TakesAnotherLaw) {
  const Scene scene;
  DptOptions options;
  options.stiffness = {.peak_exponent = 0.5,
                       .variance_exponent = 1.5,
                       .link_scale = 3,
                       .strain_exponent = 1.2,
                       .strain_floor = 0.1};
  Dpt plain;
  plain.init(scene.frame(0), Scene::box(0));
  plain.update(scene.frame(1));
  std::vector<Evidence> evidence;
  options.on_solve = [&](const DptSolve& solve) {
    evidence.assign(solve.evidence.begin(), solve.evidence.end());
  };
  Dpt tracker(options);
  tracker.init(scene.frame(0), Scene::box(0));
  tracker.update(scene.frame(1));
  const SpringSystem<double, 2> springs = springs_of(tracker.springs()), before = springs_of(plain.springs());
  EXPECT_EQ(springs.anchors, before.anchors);
  for (int i = 0; i < 4; ++i) {
    EXPECT_EQ(springs.anchor_stiffness(i),
              static_stiffness(evidence[static_cast<std::size_t>(i)], options.stiffness));
    EXPECT_GT(std::abs(springs.anchor_stiffness(i) / before.anchor_stiffness(i) - 1), 0.01) << i;
  }
  // Eq. 12 gave strain^2.
  for (int l = 0; l < springs.link_count(); ++l)
    EXPECT_NEAR(springs.link_stiffness(l), 3 * std::pow(before.link_stiffness(l) + 0.01, 0.6), 1e-12);
}

TEST(Dpt, AnyNumberOfThreadsGivesTheSameBits) {
  const Scene scene;
  const auto results = [&](int threads) {
    DptOptions options;
    options.grid_rows = 3;
    options.threads = threads;
    Dpt tracker(options);
    tracker.init(scene.frame(0), Scene::box(0));
    std::vector<TrackResult> all;
    for (int t = 1; t < 12; ++t) all.push_back(tracker.update(scene.frame(t)));
    return all;
  };
  const std::vector<TrackResult> expected = results(1);
  for (const int threads : {0, 2, 3, 8}) {
    const std::vector<TrackResult> found = results(threads);
    for (std::size_t t = 0; t < expected.size(); ++t) expect_same(found[t], expected[t]);
  }
}

TEST(Dpt, RefusesBadOptions) {
  const auto refused = [](auto change) {
    DptOptions options;
    change(options);
    EXPECT_THROW(Dpt{options}, std::invalid_argument);
  };
  refused([](DptOptions& o) { o.grid_rows = 0; });
  refused([](DptOptions& o) { o.grid_cols = -1; });
  refused([](DptOptions& o) { o.grid_rows = o.grid_cols = 5; });
  refused([](DptOptions& o) { o.grid_rows = o.grid_cols = 65536; });  // the product is 0 in 32 bits
  refused([](DptOptions& o) { o.spring_rate = 2; });
  refused([](DptOptions& o) { o.threads = -1; });
  refused([](DptOptions& o) { o.stiffness.peak_exponent = -0.1; });
  refused([](DptOptions& o) { o.stiffness.link_scale = 0; });
  refused([](DptOptions& o) { o.stiffness.strain_floor = std::numeric_limits<double>::quiet_NaN(); });
  refused([](DptOptions& o) { o.solver.options = {{"tolerance", -1.0}}; });
  refused([](DptOptions& o) { o.solver.options = {{"tolerence", 1e-3}}; });
  refused([](DptOptions& o) { o.solver.name = "newtom"; });
  refused([](DptOptions& o) { o.overlap = 1; });
  refused([](DptOptions& o) { o.overlap = -0.1; });
  refused([](DptOptions& o) { o.scale_filter_share = 1.5; });
  refused([](DptOptions& o) { o.scale.scales = 2; });
  refused([](DptOptions& o) { o.coarse.color_share = -1; });
  refused([](DptOptions& o) { o.coarse.color.histogram_rate = 7; });
}

TEST(Lgt, FollowsSize) {
  cv::Mat background = texture(240, 320, 3) + cv::Scalar(60, 0, 0),
          object = texture(60, 60, 9) + cv::Scalar(0, 0, 80);
  const auto frame = [&](double side) {
    // Warped, so that size and position are sub-pixel.
    cv::Mat image = background.clone();
    const double scale = side / 60;
    const cv::Matx23d place(scale, 0, 160 - 29.5 * scale, 0, scale, 120 - 29.5 * scale);
    cv::warpAffine(object, image, place, image.size(), cv::INTER_LINEAR, cv::BORDER_TRANSPARENT);
    return image;
  };
  Lgt tracker;
  tracker.init(frame(60), {130, 90, 60, 60});
  double side = 60;
  TrackResult result;
  for (int t = 0; t < 40; ++t) result = tracker.update(frame(side *= 1.01));
  // Histograms locate a part only coarsely, so the size lags behind.
  EXPECT_GT(result.box.width, 61);
  // The box extends to the outermost part, and the background is as still as the object.
  EXPECT_NEAR(result.box.x + result.box.width / 2, 160, 8);
}

TEST(Lgt, SurvivesAHalfCoveredObject) {
  const Scene scene;
  Lgt tracker;
  tracker.init(scene.frame(0), Scene::box(0));
  for (int t = 1; t <= 10; ++t) tracker.update(scene.frame(t));
  for (int t = 11; t <= 15; ++t) {
    cv::Mat image = scene.frame(t);
    const cv::Rect2d box = Scene::box(t);
    cv::rectangle(image, cv::Rect2d(box.x + 24, box.y - 10, 40, 84), cv::Scalar(40, 220, 40), cv::FILLED);
    const TrackResult result = tracker.update(image);
    EXPECT_NEAR(result.box.x, box.x, 8) << t;
    EXPECT_NEAR(result.box.y, box.y, 8) << t;
  }
  TrackResult result;
  for (int t = 16; t <= 20; ++t) result = tracker.update(scene.frame(t));
  EXPECT_FALSE(result.lost);
  EXPECT_NEAR(result.box.x, Scene::box(20).x, 8);
}

TEST(Lgt, SaysThatTheObjectVanishedAndStays) {
  const Scene scene;
  GatedTracker tracker{Lgt()};
  tracker.init(scene.frame(0), Scene::box(0));
  for (int t = 1; t <= 10; ++t) tracker.update(scene.frame(t));
  for (int t = 0; t < 3; ++t) {
    const TrackResult result = tracker.update(cv::Mat(240, 320, CV_8UC3, cv::Scalar(20, 200, 20)));
    EXPECT_TRUE(result.lost);
    EXPECT_NEAR(result.box.x, Scene::box(10).x, 5);
    EXPECT_NEAR(result.box.width, 48, 5);
  }
}

TEST(Lgt, PartsLieOnTheObjectAndAreLinked) {
  const Scene scene;
  Lgt tracker;
  tracker.init(scene.frame(0), Scene::box(0));
  TrackResult result;
  for (int t = 1; t <= 5; ++t) result = tracker.update(scene.frame(t));
  const int n = static_cast<int>(result.parts.size());
  EXPECT_GE(n, 8);
  EXPECT_GE(result.links.size(), result.parts.size() - 1);
  for (const auto& [i, j] : result.links) EXPECT_TRUE(0 <= i && i < n && 0 <= j && j < n && i != j);
  for (const PartState& part : result.parts) {
    EXPECT_GT(part.size.minCoeff(), 0);
    EXPECT_LT(std::abs(part.position.x() - centre_of(Scene::box(5)).x()), 30);
    EXPECT_LT(std::abs(part.position.y() - centre_of(Scene::box(5)).y()), 38);
  }
}

TEST(Delaunay, LinksNeighboursAlone) {
  ElasticConstellation::Points points(2, 5);  // a square and its middle
  points << 0, 1, 0, 1, 0.5, 0, 0, 1, 1, 0.5;
  const Topology<> links = delaunay(points);
  EXPECT_EQ(links.link_count(), 8);
  for (const auto& [i, j] : links.links()) EXPECT_NE(i + j, 3) << "a diagonal";
  // Few points, coincident points, collinear points.
  EXPECT_EQ(delaunay(points.leftCols(2)).link_count(), 1);
  EXPECT_GE(delaunay(ElasticConstellation::Points::Ones(2, 4)).link_count(), 0);
  ElasticConstellation::Points line(2, 4);
  line << 0, 1, 2, 3, 0, 0, 0, 0;
  EXPECT_GE(delaunay(line).link_count(), 3);
}

// Lgt predicts the motion: finally the object moves five deviations of the search per frame.
TEST(Lgt, FollowsANearlyConstantVelocity) {
  const cv::Mat background = texture(240, 320, 3), object = texture(64, 48, 9);
  double x = 20, velocity = 0;
  const auto frame = [&] {
    cv::Mat image = background.clone();
    object.copyTo(image(cv::Rect(static_cast<int>(x), 80, 48, 64)));
    return image;
  };
  LgtOptions options;
  options.translation = 2;
  Lgt tracker(options);
  tracker.init(frame(), {x, 80, 48, 64});
  for (int t = 0; t < 28; ++t) {
    velocity = std::min(velocity + 0.5, 10.0);
    x += velocity;
    const TrackResult result = tracker.update(frame());
    EXPECT_NEAR(result.box.x + result.box.width / 2, std::floor(x) + 24, 8) << t;
  }
}

TEST(Lgt, SaysHowTheObjectTurns) {
  const cv::Mat background = texture(240, 320, 3), object = texture(64, 64, 9);
  const auto frame = [&](double angle) {
    cv::Mat image = background.clone();
    const double c = std::cos(angle), s = std::sin(angle);
    // About the middle of the object, which is at (160, 120).
    const cv::Matx23d turn(c, -s, 160 - 31.5 * (c - s), s, c, 120 - 31.5 * (s + c));
    cv::warpAffine(object, image, turn, image.size(), cv::INTER_LINEAR, cv::BORDER_TRANSPARENT);
    return image;
  };
  for (const double speed : {0.03, -0.03}) {
    Lgt tracker;
    tracker.init(frame(0), {128.5, 88.5, 64, 64});
    TrackResult result;
    for (int t = 1; t <= 20; ++t) result = tracker.update(frame(speed * t));
    EXPECT_NEAR(result.angle, 20 * speed, 0.1);
    EXPECT_NEAR(result.box.x + result.box.width / 2, 160.5, 4);
    EXPECT_NEAR(result.box.y + result.box.height / 2, 120.5, 4);
  }
}

// The first box covers only two thirds of the object: parts are added on the rest.
TEST(Lgt, PartsJoinWhereTheObjectIs) {
  const cv::Mat shades = texture(240, 320, 3);
  const cv::Rect2d object(130, 90, 60, 60);
  cv::Mat frame = shades / 4 + cv::Scalar(150, 60, 0);
  frame(object) = shades(object) / 4 + cv::Scalar(0, 60, 150);
  Lgt tracker;
  tracker.init(frame, {130, 90, 40, 60});
  TrackResult result;
  for (int t = 0; t < 30; ++t) result = tracker.update(frame);
  int on = 0, on_the_rest = 0;
  for (const PartState& part : result.parts) {
    on += object.contains(cv::Point2d(part.position.x(), part.position.y()));
    on_the_rest += part.position.x() > 170 && part.position.x() < 190;
  }
  EXPECT_GE(on, 0.9 * static_cast<double>(result.parts.size()));
  EXPECT_GE(on_the_rest, 3);
}

#ifdef ASTERISM_TEST_JSON
TEST(Lgt, BadPartsLeave) {
  // The lower half of the object changes permanently.
  const Scene scene;
  const auto changed = [&](int t) {
    cv::Mat image = scene.frame(t);
    const cv::Rect2d box = Scene::box(t);
    image(cv::Rect2d(box.x, box.y + 32, 48, 32)).setTo(cv::Scalar(255, 255, 255));
    return image;
  };
  const auto worst_part = [&](const char* description) {
    AnyTracker tracker = make_tracker(description);
    tracker.init(scene.frame(0), Scene::box(0));
    TrackResult result;
    for (int t = 1; t <= 20; ++t) result = tracker.update(t < 5 ? scene.frame(t) : changed(t));
    return std::ranges::min_element(result.parts, {}, &PartState::weight)->weight;
  };
  EXPECT_GT(worst_part("lgt"), 0.1);
  EXPECT_LT(worst_part(R"(lgt{"remove_below": 0})"), 0.1);
}

TEST(Lgt, HasNoMorePartsThanAskedFor) {
  const Scene scene;
  for (const int parts : {1, 2, 5, 20}) {
    AnyTracker tracker = make_tracker("lgt{\"max_parts\": " + std::to_string(parts) + "}");
    tracker.init(scene.frame(0), Scene::box(0));
    for (int t = 1; t <= 20; ++t) {
      const TrackResult result = tracker.update(scene.frame(t));
      EXPECT_GE(result.parts.size(), 1u);
      EXPECT_LE(result.parts.size(), static_cast<std::size_t>(parts));
    }
  }
}

TEST(AnyTracker, ShowsTheTrackerInIt) {
  const AnyTracker tracker = make_tracker("dpt_str");
  const auto* const dpt = tracker.target<GatedTracker<Dpt>>();
  ASSERT_NE(dpt, nullptr);
  EXPECT_EQ(dpt->tracker().options().constellation, Constellation::Star);
  EXPECT_EQ(tracker.target<GatedTracker<CoarseTracker>>(), nullptr);
}

TEST(Lgt, RefusesBadOptions) {
  EXPECT_EQ(refusal("lgt{}"), "taken");
  EXPECT_EQ(refusal(R"(lgt{"max_parts": 0})"), "LgtOptions: max_parts must be in [1, 100], is 0");
  EXPECT_EQ(refusal(R"(lgt{"weight_rate": -1})"), "LgtOptions: weight_rate must be in [1e-09, 1], is -1");
  EXPECT_EQ(refusal(R"(lgt{"springs": {"reach": 0}})"),
            "LgtOptions: springs.reach must be in [1e-09, 1000000000], is 0");
  EXPECT_EQ(refusal(R"(lgt{"springs": {"reach": 1, "deformatio": 1}})"),
            "lgt: unknown option 'springs.deformatio', did you mean 'springs.deformation'?");
  EXPECT_NE(refusal(R"(lgt{"lost_below": 2})"), "taken");
  EXPECT_NE(refusal(R"(lgt{"springs": {"deformation": -1}})"), "taken");
  EXPECT_NE(refusal(R"(lgt{"springs": {"solver": {"tolerance": -1}}})"), "taken");
}
#endif

}  // namespace
}  // namespace asterism
