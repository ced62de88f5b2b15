// Interrupted videos: frames that show nothing, or little, of the scene.

#include <gtest/gtest.h>

#include <asterism/trackers/around/gated.hpp>
#include <filesystem>
#include <map>

#include "ground_truth.hpp"
#include "image_source.hpp"
#include "interruptions.hpp"
#include "moving_square.hpp"

namespace asterism {
namespace {

namespace fs = std::filesystem;

bool in_image(const TrackResult& result, const cv::Mat& image) {
  const Point2 centre = centre_of(result.box);
  return centre.x() >= 0 && centre.y() >= 0 && centre.x() <= image.cols - 1 && centre.y() <= image.rows - 1;
}

double distance(const cv::Rect2d& a, const cv::Rect2d& b) { return (centre_of(a) - centre_of(b)).norm(); }

// Without the variants of DPT that differ only in the number of parts and links.
std::vector<std::string> trackers() {
  std::vector<std::string> names = tracker_names();
  std::erase_if(names,
                [](const std::string& name) { return name.starts_with("dpt_") && name != "dpt_plus"; });
#ifdef ASTERISM_TEST_JSON
  names.insert(names.end(), {"dpt+mosse", "dpt+template", "dpt+color_histogram"});
#endif
  return names;
}

class Interrupted : public ::testing::TestWithParam<std::string> {
 protected:
  // A tracker after some frames of the scene: a copy of one that all tests of its name start from.
  static constexpr int kSeen = 8;
  static AnyTracker running() {
    static std::map<std::string, AnyTracker> kept;
    auto found = kept.find(GetParam());
    if (found == kept.end()) {
      found = kept.emplace(GetParam(), make_tracker(GetParam())).first;
      found->second.init(draw_frame(0), true_box(0));
      for (int t = 1; t <= kSeen; ++t) found->second.update(draw_frame(t));
    }
    return found->second;
  }
  // From frame t on, both trackers do the same, bit for bit, and follow the object.
  static void expect_same_from(int t, AnyTracker& tracker, AnyTracker& other) {
    for (const int end = t + 4; t < end; ++t) {
      const TrackResult result = tracker.update(draw_frame(t)), expected = other.update(draw_frame(t));
      EXPECT_EQ(result.box, expected.box) << t;
      EXPECT_EQ(result.confidence, expected.confidence) << t;
      EXPECT_FALSE(result.interrupted) << t;
      EXPECT_LT(distance(result.box, true_box(t)), 5) << t;
    }
  }
};

TEST_P(Interrupted, KeepsItsBoxAndLearnsNothingWhereNothingIsSeen) {
  for (const testing::Interruption& kind : testing::interruptions()) {
    if (!kind.blind) continue;
    SCOPED_TRACE(kind.name);
    AnyTracker tracker = running();
    const cv::Rect2d box = tracker.update(draw_frame(kSeen + 1)).box;
    AnyTracker uninterrupted = tracker;
    constexpr int kFrames = 40;
    for (int i = 0; i < kFrames; ++i) {
      const TrackResult result = tracker.update(kind.show(draw_frame(kSeen + 1), i, kFrames));
      ASSERT_EQ(result.box, box) << i;
      ASSERT_TRUE(result.lost && result.interrupted) << i;
    }
    expect_same_from(kSeen + 2, tracker, uninterrupted);
  }
}

// Frames of another video, or of the same one in disorder, are inserted. What a tracker learned in them does
// not matter when the scene is back.
TEST_P(Interrupted, GoesOnAsIfThereHadBeenNoOtherScene) {
  std::vector<testing::Interruption> kinds;
  for (const testing::Interruption& kind : testing::interruptions())
    if (kind.name == "inverted" || kind.name == "rolled" || kind.name == "test_card") kinds.push_back(kind);
  for (std::uint64_t seed = 11; seed < 15; ++seed)
    kinds.push_back(
        {"other video " + std::to_string(seed),
         [seed](const cv::Mat& clean, int i, int) { return testing::other_video(clean, i, seed); }, false});
  kinds.push_back(
      {"two other videos",
       [](const cv::Mat& clean, int i, int n) { return testing::other_video(clean, i, 2 * i < n ? 11 : 12); },
       false});
  for (const testing::Interruption& kind : kinds)
    for (const int frames : {1, 5, 25}) {
      // The filter is outside the gate: it does not forget what it measured after the hold.
      if (GetParam() == "kalman" && frames > GatedTracker<AnyTracker>::kMostHeld) continue;
      // A tracker that finds its object in one of them, as lgt does, takes it as the scene to come back to.
      if (kind.name == "two other videos" && (frames == 25 || GetParam() == "lgt")) continue;
      SCOPED_TRACE(kind.name + ", " + std::to_string(frames));
      AnyTracker tracker = running(), uninterrupted = tracker;
      for (int i = 0; i < frames; ++i) tracker.update(kind.show(draw_frame(kSeen), i, frames));
      expect_same_from(kSeen + 1, tracker, uninterrupted);
    }
}

// A scene that has changed for good is not taken as an interruption for ever.
TEST_P(Interrupted, GoesOnInAnotherSceneAtLast) {
  for (const testing::Interruption& kind : testing::interruptions()) {
    const bool lasts = kind.name == "inverted" || kind.name == "rolled" || kind.name == "doubled" ||
                       kind.name == "letterbox" || kind.name == "other_video" ||
                       kind.name == "gray_lower_half" || kind.name == "gray_left_half";
    if (!lasts) continue;
    SCOPED_TRACE(kind.name);
    AnyTracker tracker = running();
    for (int i = 0; i < GatedTracker<AnyTracker>::kMostHeld; ++i)
      tracker.update(kind.show(draw_frame(kSeen + i), i, 40));
    for (int i = GatedTracker<AnyTracker>::kMostHeld; i < 40; ++i)
      ASSERT_FALSE(tracker.update(kind.show(draw_frame(kSeen + i), i, 40)).interrupted) << i;
  }
}

// A tracker whose response is weak has no box to keep: it searches on.
TEST_P(Interrupted, HoldsNothingWhereTheObjectWasLostBefore) {
  for (const testing::Interruption& kind : testing::interruptions()) {
    if (kind.name != "inverted" && kind.name != "letterbox" && kind.name != "other_video") continue;
    SCOPED_TRACE(kind.name);
    AnyTracker tracker = running();
    bool weak = false;
    for (int i = 0; i < 60 && !weak; ++i) {  // something else is where the object was
      cv::Mat image = draw_frame(kSeen);
      noise({200, 200}, 31, 0, 255, static_cast<std::uint64_t>(100 + i))
          .copyTo(image(cv::Rect(20, 10, 200, 200)));
      const TrackResult result = tracker.update(image);
      weak = result.is_weak() && !result.interrupted;
    }
    if (!weak) continue;  // it followed that
    EXPECT_FALSE(tracker.update(kind.show(draw_frame(kSeen), 0, 1)).interrupted);
  }
}

TEST_P(Interrupted, FindsItsObjectAgain) {
  for (const testing::Interruption& kind : testing::interruptions()) {
    SCOPED_TRACE(kind.name);
    AnyTracker tracker = running();
    constexpr int kFrames = 4;
    int t = kSeen;
    for (int i = 0; i < kFrames; ++i) {
      const cv::Mat image = kind.show(draw_frame(++t), i, kFrames);
      EXPECT_TRUE(in_image(tracker.update(image), image)) << t;
    }
    AnyTracker saved = make_tracker(GetParam());
    saved.restore(tracker.save());
    TrackResult result;
    for (int i = 0; i < 6; ++i) {
      result = tracker.update(draw_frame(++t));
      EXPECT_EQ(saved.update(draw_frame(t)).box, result.box) << t;
    }
    EXPECT_LT(distance(result.box, true_box(t)), 8);
    EXPECT_FALSE(result.interrupted);
  }
}

TEST_P(Interrupted, StaysWhereTheVideoIsFrozenAndFollowsWhereFramesAreMissing) {
  AnyTracker tracker = running();
  for (int i = 0; i < 40; ++i)
    EXPECT_LT(distance(tracker.update(draw_frame(kSeen)).box, true_box(kSeen)), 5) << i;
  TrackResult result;
  for (const int t : {kSeen + 4, kSeen + 5, kSeen + 6, kSeen + 7}) result = tracker.update(draw_frame(t));
  EXPECT_LT(distance(result.box, true_box(kSeen + 7)), 6);
}

// Neither an object that leaves the image nor a false match may lead the box out of it.
TEST_P(Interrupted, KeepsTheCentreOfItsBoxInTheImage) {
  const cv::Mat wide = draw_frame(0);
  AnyTracker tracker = running();
  const cv::Rect2d box = true_box(kSeen);
  for (int t = 1; t <= 60; ++t) {
    cv::Mat image;
    const cv::Matx23d camera(1, 0, -6.0 * t, 0, 1, -5.0 * t);  // pans away
    cv::warpAffine(draw_frame(kSeen), image, camera, wide.size(), cv::INTER_LINEAR, cv::BORDER_REFLECT);
    ASSERT_TRUE(in_image(tracker.update(image), image)) << t << " from " << box;
  }
}

// Nor may an image that is suddenly small, whatever it shows.
TEST_P(Interrupted, KeepsTheCentreOfItsBoxInASmallImage) {
  for (const cv::Size size : {cv::Size(40, 30), {9, 200}, {8, 8}, {1, 1}})
    for (const bool blank : {false, true}) {
      SCOPED_TRACE(::testing::Message() << size << (blank ? ", blank" : ""));
      AnyTracker tracker = running();
      cv::Mat image(size, CV_8UC3, cv::Scalar::all(90));
      if (!blank) cv::resize(draw_frame(kSeen), image, size, 0, 0, cv::INTER_AREA);
      for (int i = 0; i < 3; ++i) ASSERT_TRUE(in_image(tracker.update(image), image)) << i;
    }
}

// Nothing moves, and there is no color to tell the object from its surroundings.
// In color and gray, of every depth; with and without an object that differs from its surroundings; in the
// middle of the image and ten pixels from its corner, so that what surrounds the object is partly outside.
TEST_P(Interrupted, KeepsItsBoxOnAStillImage) {
  const cv::Rect2d middle = true_box(0), corner(10, 10, middle.width, middle.height);
  const cv::Mat plain = noise({320, 240}, 15, 20, 200, 5), square = draw_frame(0);
  const cv::Rect rest(cv::Point(middle.tl() - corner.tl()), cv::Point(320, 240));
  for (const auto& [color, box] :
       {std::pair(plain, middle), {square, middle}, {plain(rest), corner}, {square(rest), corner}}) {
    cv::Mat gray, gray16, gray_float;
    cv::cvtColor(color, gray, cv::COLOR_BGR2GRAY);
    gray.convertTo(gray16, CV_16U, 257);
    gray.convertTo(gray_float, CV_32F, 1 / 255.0);
    for (const cv::Mat& image : {color, gray, gray16, gray_float}) {
      // Gray levels alone are alike in other places of such a texture.
      if (image.channels() == 1 && GetParam() == "dpt+color_histogram") continue;
      AnyTracker tracker = make_tracker(GetParam());
      tracker.init(image, box);
      TrackResult result;
      for (int i = 0; i < 60; ++i) {
        result = tracker.update(image);
        EXPECT_FALSE(result.interrupted) << i;
      }
      EXPECT_GT(tools::overlap(result.box, box), 0.75)
          << cv::typeToString(image.type()) << ' ' << result.box << " from " << box;
      EXPECT_FALSE(result.lost) << cv::typeToString(image.type());
    }
  }
}

TEST_P(Interrupted, StartsOnlyWhereThereIsSomethingToFollow) {
  cv::Mat faint = testing::gray_noise(draw_frame(0), 0.3, 1),
          far = cv::Mat(240, 320, CV_8UC3, cv::Scalar::all(60));
  far.colRange(200, 320).setTo(cv::Scalar::all(180));  // beyond the object's surroundings
  AnyTracker tracker = running();
  for (const cv::Mat& image :
       {cv::Mat(240, 320, CV_8UC3, cv::Scalar::all(0)), cv::Mat(240, 320, CV_8UC1, cv::Scalar::all(128)),
        cv::Mat(240, 320, CV_8UC3, cv::Scalar(255, 0, 0)), faint, far}) {
    try {
      tracker.init(image, true_box(0));
      FAIL() << "started";
    } catch (const std::invalid_argument& e) {
      EXPECT_STREQ(
          e.what(),
          "the start box and its surroundings have one gray level or color: there is nothing to follow");
    }
  }
  EXPECT_LT(distance(tracker.update(draw_frame(kSeen + 1)).box, true_box(kSeen + 1)), 5);  // as before
  // A flat object in flat surroundings is something, also if only the color differs.
  cv::Mat flat(240, 320, CV_8UC3, cv::Scalar(0, 0, 150));
  flat(cv::Rect(true_box(0))).setTo(cv::Scalar(0, 76, 0));  // of the same gray level
  EXPECT_NO_THROW(tracker.init(flat, true_box(0)));
}

INSTANTIATE_TEST_SUITE_P(All, Interrupted, ::testing::ValuesIn(trackers()), [](const auto& instance) {
  std::string name = instance.param;
  std::replace(name.begin(), name.end(), '+', '_');
  return name;
});

TEST(ShowsScene, NeitherOneLevelNorNoise) {
  const cv::Mat scene = draw_frame(0);
  EXPECT_TRUE(shows_scene(Frame(scene)));
  EXPECT_TRUE(shows_scene(Frame(testing::inverted(scene))));
  EXPECT_TRUE(shows_scene(Frame(scene.col(7))));
  EXPECT_FALSE(shows_scene(Frame(cv::Mat(1, 1, CV_8UC1, cv::Scalar(7)))));
  for (const int level : {0, 128, 255}) {
    cv::Mat blank(240, 320, CV_8UC3, cv::Scalar::all(level));
    EXPECT_FALSE(shows_scene(Frame(blank))) << level;
  }
  for (const double deviation : {2.0, 20.0, 60.0})
    EXPECT_FALSE(shows_scene(Frame(testing::gray_noise(scene, deviation, 1)))) << deviation;
}

// Real sequences in which frames without the scene replace some frames or are inserted.
class InterruptedSequence : public ::testing::TestWithParam<std::tuple<std::string, std::string>> {};

TEST_P(InterruptedSequence, IsTrackedAsWellAsWithoutTheInterruption) {
  const std::string name = std::get<0>(GetParam()), description = std::get<1>(GetParam());
  const fs::path folder = fs::path(ASTERISM_SEQUENCES) / name;
  if (!fs::exists(folder / "groundtruth.txt"))
    GTEST_SKIP() << "no sequence " << name << " in " << ASTERISM_SEQUENCES
                 << " (configure with -DASTERISM_SEQUENCES=FOLDER to name another)";
  constexpr int kFrames = 100, kAt = 30;
  tools::ImageSource source = tools::ImageSource::open(folder.string());
  const auto truth = tools::read_ground_truth(folder / "groundtruth.txt");
  std::vector<cv::Mat> images;
  for (cv::Mat image; static_cast<int>(images.size()) < kFrames && source.next(image);)
    images.push_back(image.clone());
  ASSERT_EQ(images.size(), kFrames);

  // Average overlap of the uninterrupted frames: of the video itself, or with `replaced` of its frames
  // replaced and `inserted` ones before them.
  const auto average = [&](const testing::Interruption* kind, int replaced, int inserted) {
    AnyTracker tracker = make_tracker(description);
    tracker.init(images[0], truth[0]->box());
    double sum = 0;
    int count = 0;
    for (int t = 1; t < kFrames; ++t) {
      const cv::Mat& image = images[static_cast<std::size_t>(t)];
      if (t == kAt)
        for (int i = 0; i < inserted; ++i) tracker.update(kind->show(image, i, inserted));
      if (t >= kAt && t < kAt + replaced) {
        tracker.update(kind->show(image, t - kAt, replaced));
        continue;
      }
      sum += tools::overlap(tracker.update(image).box, truth[static_cast<std::size_t>(t)]->box());
      ++count;
    }
    return sum / count;
  };
  const double whole = average(nullptr, 0, 0);
  for (const testing::Interruption& kind : testing::interruptions()) {
    EXPECT_GT(average(&kind, 3, 0), whole - 0.06) << kind.name << ", without " << whole;
    if (kind.blind) {
      EXPECT_GT(average(&kind, 0, 30), whole - 0.02) << kind.name << ", without " << whole;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Development, InterruptedSequence,
                         ::testing::Combine(::testing::Values("woman", "bicycle", "Crossing"),
                                            ::testing::Values("dpt", "kcf")),
                         [](const auto& instance) {
                           return std::get<0>(instance.param) + "_" + std::get<1>(instance.param);
                         });

// The first image of a real sequence, over and over, in color and gray.
class StillSequence : public ::testing::TestWithParam<std::tuple<std::string, std::string>> {};

TEST_P(StillSequence, KeepsItsBox) {
  const auto& [name, description] = GetParam();
  const fs::path folder = fs::path(ASTERISM_SEQUENCES) / name;
  if (!fs::exists(folder / "groundtruth.txt"))
    GTEST_SKIP() << "no sequence " << name << " in " << ASTERISM_SEQUENCES
                 << " (configure with -DASTERISM_SEQUENCES=FOLDER to name another)";
  cv::Mat color, gray;
  ASSERT_TRUE(tools::ImageSource::open(folder.string()).next(color));
  cv::cvtColor(color, gray, cv::COLOR_BGR2GRAY);
  const cv::Rect2d box = tools::read_ground_truth(folder / "groundtruth.txt")[0]->equal_area_box();
  for (const cv::Mat& image : {color, gray}) {
    AnyTracker tracker = make_tracker(description);
    tracker.init(image, box);
    TrackResult result;
    for (int i = 0; i < 60; ++i) result = tracker.update(image);
    EXPECT_GT(tools::overlap(result.box, box), 0.75)
        << cv::typeToString(image.type()) << ' ' << result.box << " from " << box;
  }
}

const auto still_name = [](const auto& instance) {
  std::string test = std::get<0>(instance.param) + "_" + std::get<1>(instance.param);
  std::replace_if(
      test.begin(), test.end(), [](char c) { return c == '-' || c == '+'; }, '_');
  return test;
};

INSTANTIATE_TEST_SUITE_P(Development, StillSequence,
                         ::testing::Combine(::testing::Values("bicycle", "davis-bus", "Crossing"),
                                            ::testing::Values("dpt", "dpt_plus", "coarse", "kcf", "kalman")),
                         still_name);

#ifdef ASTERISM_TEST_JSON
INSTANTIATE_TEST_SUITE_P(Parts, StillSequence,
                         ::testing::Combine(::testing::Values("bicycle", "davis-bus", "car"),
                                            ::testing::Values("dpt+mosse", "dpt+template", "dpt+flow",
                                                              "dpt+color_histogram", "dpt+keypoints",
                                                              "dpt+spatial_reliability", "dpt+strcf",
                                                              "dpt+superpixels")),
                         still_name);
#endif

// lgt loses the ends of objects as elongated as that of Crossing, as docs/trackers.md says.
INSTANTIATE_TEST_SUITE_P(Lgt, StillSequence,
                         ::testing::Combine(::testing::Values("bicycle", "davis-bus", "car", "Girl"),
                                            ::testing::Values("lgt")),
                         still_name);

}  // namespace
}  // namespace asterism
