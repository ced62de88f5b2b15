// Trackers that search the whole frame for an object that they have lost.

#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/trackers/around/object_search.hpp>
#include <asterism/trackers/around/redetecting.hpp>
#include <asterism/trackers/tracker/tracker.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>

#include "moving_square.hpp"
#include "same_results.hpp"

namespace asterism {
namespace {

constexpr int kLeaves = 15, kReturns = 45, kEnds = 65;
const cv::Rect kElsewhere(250, 180, 48, 40);

double overlap(const cv::Rect2d& a, const cv::Rect2d& b) {
  const double common = (a & b).area();
  return common / (a.area() + b.area() - common);
}

cv::Mat scene() { return noise({320, 240}, 15, 20, 90, 1); }

// The background with an object of another texture, which `seed` selects; 2 is the object's own.
cv::Mat scene_with(const cv::Rect& box, std::uint64_t seed) {
  cv::Mat image = scene();
  noise(box.size(), 5, 100, 255, seed).copyTo(image(box));
  return image;
}

// The object leaves and, from kReturns on, is in another place.
cv::Mat frame_of(int t) {
  return t < kLeaves ? draw_frame(t) : t < kReturns ? scene() : scene_with(kElsewhere, 2);
}

AnyTracker started(const std::string& description) {
  AnyTracker tracker = make_tracker(description);
  tracker.init(draw_frame(0), true_box(0));
  return tracker;
}

std::string with_search(const std::string& name) { return name + R"({"redetect": true})"; }

TEST(ObjectSearch, FindsTheObjectAnywhere) {
  ObjectSearch search;
  BoxJudge judge;
  search.init(Frame(draw_frame(0)), true_box(0));
  judge.init(Frame(draw_frame(0)), true_box(0));
  for (const cv::Rect& box : {kElsewhere, cv::Rect(3, 2, 48, 40), cv::Rect(131, 77, 48, 40)}) {
    const cv::Mat image = scene_with(box, 2);
    const ObjectSearch::Found found = search.find(Frame(image), {48, 40}, judge);
    EXPECT_GT(found.probability, 0.99);
    EXPECT_GT(overlap(found.box, box), 0.75) << found.box;
    // The size that is asked for may differ from the true one.
    EXPECT_GT(overlap(search.find(Frame(image), {40, 34}, judge).box, box), 0.6);
  }
  EXPECT_LT(search.find(Frame(scene()), {48, 40}, judge).probability, 0.5);
  EXPECT_LT(search.find(Frame(scene_with(kElsewhere, 7)), {48, 40}, judge).probability,
            RedetectingTracker::kAccept);
}

// An object that is large or small against the frame, and frames without contrast.
TEST(ObjectSearch, TakesAnySize) {
  ObjectSearch search;
  BoxJudge judge;
  search.init(Frame(draw_frame(0)), true_box(0));
  judge.init(Frame(draw_frame(0)), true_box(0));
  const cv::Mat image = draw_frame(1);
  for (const Size2& size : {Size2(1, 1), Size2(3, 300), Size2(1000, 1000), Size2(1e-3, 1e5), Size2(5, 4)}) {
    const ObjectSearch::Found found = search.find(Frame(image), size, judge);
    EXPECT_GE(found.probability, 0);
    EXPECT_LE(found.probability, 1);
    EXPECT_TRUE(std::isfinite(found.box.x + found.box.y + found.box.width + found.box.height));
  }
  EXPECT_EQ(search.find(Frame(image), {1000, 1000}, judge).probability, 0);
  EXPECT_EQ(search.find(Frame(image), {0.01, 0.01}, judge).probability, 0);
  const cv::Mat flat(240, 320, CV_8UC1, cv::Scalar(90));
  EXPECT_LT(search.find(Frame(flat), {48, 40}, judge).probability, 0.5);
}

#ifdef ASTERISM_TEST_JSON
class Redetecting : public ::testing::TestWithParam<std::string> {};

TEST_P(Redetecting, FindsAnObjectThatComesBackElsewhere) {
  AnyTracker with = started(with_search(GetParam())), without = started(GetParam());
  TrackResult found, not_found;
  for (int t = 1; t < kEnds; ++t) {
    found = with.update(frame_of(t)), not_found = without.update(frame_of(t));
    if (t < kLeaves) {
      EXPECT_EQ(found.box, not_found.box) << t;
      EXPECT_FALSE(found.lost) << t;
    }
    if (t == kReturns - 1) {
      EXPECT_TRUE(found.lost);
      EXPECT_LT(found.probability.value(), 0.5);
    }
    if (t >= kReturns + 2) {
      EXPECT_GT(overlap(found.box, kElsewhere), 0.6) << t << ' ' << found.box;
    }
  }
  EXPECT_FALSE(found.lost);
  EXPECT_GT(found.probability.value(), 0.5);
  EXPECT_LT(overlap(not_found.box, kElsewhere), 0.1);
}

// Nothing is taken for the object, neither the background nor another object: the boxes are those of the
// tracker in it.
TEST_P(Redetecting, TakesNothingElse) {
  for (const bool other : {false, true}) {
    AnyTracker with = started(with_search(GetParam())), without = started(GetParam());
    for (int t = 1; t < kEnds; ++t) {
      const cv::Mat image = t < kLeaves ? draw_frame(t) : other ? scene_with(kElsewhere, 7) : scene();
      const TrackResult result = with.update(image);
      EXPECT_EQ(result.box, without.update(image).box) << t;
      if (t >= kLeaves + 25) {
        EXPECT_TRUE(result.lost) << t;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Trackers, Redetecting, ::testing::Values("dpt_plus", "dpt", "kcf"));

// Without the option, and with false, a tracker is what it was.
TEST(Redetect, IsOffByDefault) {
  AnyTracker plain = started("dpt_plus"), off = started(R"(dpt_plus{"redetect": false})");
  EXPECT_EQ(plain.target<RedetectingTracker>(), nullptr);
  EXPECT_EQ(off.target<RedetectingTracker>(), nullptr);
  EXPECT_NE(started(with_search("dpt_plus")).target<RedetectingTracker>(), nullptr);
  for (int t = 1; t < kEnds; ++t) expect_same(off.update(frame_of(t)), plain.update(frame_of(t)));
}

// As long as the box looks like the object, the result is the tracker's, of which only `lost` and
// `probability` are the search's own.
TEST(Redetect, ChangesNothingWhileTheObjectIsThere) {
  for (const std::string name : {"dpt_plus", "lgt", R"(kalman)"}) {
    AnyTracker with = started(with_search(name)), without = started(name);
    for (int t = 1; t < 40; ++t) expect_same(with.update(draw_frame(t)), without.update(draw_frame(t)));
  }
}

TEST(Redetect, IsOneOfTheOptions) {
  for (const std::string& name : tracker_names()) {
    EXPECT_NE(tracker_options(name).find(R"("redetect": false)"), std::string::npos) << name;
    const std::string listed = tracker_options(with_search(name));
    EXPECT_NE(listed.find(R"("redetect": true)"), std::string::npos) << name;
    EXPECT_EQ(tracker_options(listed), listed);
    EXPECT_NE(make_tracker(listed).target<RedetectingTracker>(), nullptr);
  }
  EXPECT_NE(tracker_options("dpt+mosse").find(R"("redetect": false)"), std::string::npos);
}

TEST(Redetect, RefusesWrongValues) {
  const auto refusal = [](const std::string& description) -> std::string {
    try {
      make_tracker(description);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "taken";
  };
  EXPECT_EQ(refusal(R"(dpt_plus{"redetect": 1})"),
            "dpt_plus: option 'redetect' must be true or false, not 1");
  EXPECT_EQ(refusal(R"(kcf{"redetect": "yes"})"),
            R"(kcf: option 'redetect' must be true or false, not "yes")");
  EXPECT_EQ(refusal(R"({"tracker": "lgt", "redetect": null})"),
            "lgt: option 'redetect' must be true or false, not null");
  EXPECT_EQ(refusal(R"(dpt{"redetect": true, "spring_rate": 2})"),
            "DptOptions: spring_rate must be in [0, 1], is 2");
  EXPECT_NE(refusal(R"(dpt{"redetekt": true})").find("unknown option 'redetekt'"), std::string::npos);
}
#endif

// A tracker that is restored, or copied, goes on bit for bit, also where it has lost the object.
TEST(Redetect, IsSavedAndCopied) {
  const auto make = [] { return AnyTracker(RedetectingTracker(make_tracker("kcf"))); };
  AnyTracker tracker = make(), restored = make();
  tracker.init(draw_frame(0), true_box(0));
  for (int t = 1; t < kReturns - 5; ++t) tracker.update(frame_of(t));
  restored.restore(tracker.save());
  AnyTracker copy = tracker;
  EXPECT_EQ(copy.save(), tracker.save());
  for (int t = kReturns - 5; t < kReturns + 5; ++t) {
    const TrackResult expected = tracker.update(frame_of(t));
    expect_same(restored.update(frame_of(t)), expected);
    expect_same(copy.update(frame_of(t)), expected);
  }
  AnyTracker other = make_tracker("kcf");
  EXPECT_THROW(other.restore(tracker.save()), std::exception);
}

TEST(Redetect, NeedsAStart) {
  RedetectingTracker tracker(make_tracker("kcf"));
  EXPECT_THROW(tracker.update(draw_frame(0)), std::logic_error);
  EXPECT_THROW(tracker.init(draw_frame(0), cv::Rect2d(-90, 0, 20, 20)), std::invalid_argument);
}

}  // namespace
}  // namespace asterism
