// Interrupted videos: frames that show nothing, or little, of the scene.

#include <gtest/gtest.h>

#include <asterism/trackers/constellation/interruption.hpp>
#include <filesystem>

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
  // A tracker after some frames of the scene.
  static constexpr int kSeen = 8;
  AnyTracker running() const {
    AnyTracker tracker = make_tracker(GetParam());
    tracker.init(draw_frame(0), true_box(0));
    for (int t = 1; t <= kSeen; ++t) tracker.update(draw_frame(t));
    return tracker;
  }
};

TEST_P(Interrupted, KeepsItsBoxAndLearnsNothingWhereNothingIsSeen) {
  for (const testing::Interruption& kind : testing::interruptions()) {
    if (!kind.blind) continue;
    SCOPED_TRACE(kind.name);
    AnyTracker tracker = running();
    const cv::Rect2d box = tracker.update(draw_frame(kSeen + 1)).box;
    const std::vector<std::byte> learned = tracker.save();
    constexpr int kFrames = 40;
    for (int i = 0; i < kFrames; ++i) {
      const TrackResult result = tracker.update(kind.show(draw_frame(kSeen + 1), i, kFrames));
      ASSERT_EQ(result.box, box) << i;
      ASSERT_TRUE(result.lost && result.interrupted) << i;
    }
    EXPECT_EQ(tracker.save(), learned);
    for (int t = kSeen + 2; t <= kSeen + 5; ++t) {
      const TrackResult result = tracker.update(draw_frame(t));
      EXPECT_LT(distance(result.box, true_box(t)), 5) << t;
      EXPECT_FALSE(result.interrupted) << t;
    }
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

INSTANTIATE_TEST_SUITE_P(All, Interrupted, ::testing::ValuesIn(trackers()), [](const auto& instance) {
  std::string name = instance.param;
  std::replace(name.begin(), name.end(), '+', '_');
  return name;
});

// If the first frame is blank, there is nothing to compare with.
TEST(InterruptionGate, AVideoMayBeginBlank) {
  const cv::Mat blank(240, 320, CV_8UC3, cv::Scalar::all(128));
  AnyTracker tracker = make_tracker("kcf");
  tracker.init(blank, true_box(0));
  EXPECT_FALSE(tracker.update(blank).interrupted);
  EXPECT_FALSE(tracker.update(draw_frame(0)).interrupted);
  EXPECT_TRUE(tracker.update(blank).interrupted);
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

}  // namespace
}  // namespace asterism
