#include <gtest/gtest.h>

#include <asterism/parts/models/keypoints.hpp>
#include <asterism/solver/base/split_mix.hpp>
#include <asterism/testing/part_axioms.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace asterism {
namespace {

using testing::displaced;
using testing::shifted;
using testing::texture;

TEST(Keypoints, FulfilsThePartAxioms) { testing::check_part_axioms(Keypoints()); }
TEST(Keypoints, WithstandsFaults) { testing::check_part_faults(Keypoints()); }

TEST(Keypoints, FindsAShiftedTexture) {
  const cv::Mat image = texture(240, 320);
  Keypoints part;
  part.init(Frame(image), {160, 120}, {80, 70});
  ASSERT_GT(part.size(), 10);
  for (const auto& [dx, dy] : {std::pair{1.0, 0.0}, {-3, 2}, {15, -17}, {0.5, 0.25}, {-4.3, 2.6}}) {
    const cv::Mat moved = displaced(image, dx, dy);
    const Evidence evidence = part.localize(Frame(moved), {160, 120});
    // Key-points are at whole pixels; their mean for a shift by a fraction of a pixel is not exact.
    const bool whole = dx == std::round(dx) && dy == std::round(dy);
    EXPECT_LT((evidence.position - Point2(160 + dx, 120 + dy)).norm(), whole ? 0.05 : 0.3)
        << dx << ", " << dy;
    EXPECT_GT(evidence.peak, whole ? 0.8 : 0.5);
  }
}

// Key-points of a target that is stretched along x disagree along x.
TEST(Keypoints, ScatterMeasuresDeformation) {
  const cv::Mat image = texture(240, 320);
  cv::Mat stretched;
  cv::warpAffine(image, stretched, cv::Matx23d(1.15, 0, -0.15 * 160, 0, 1, 0), image.size(), cv::INTER_CUBIC);
  Keypoints part;
  part.init(Frame(image), {160, 120}, {90, 90});
  const Evidence still = part.localize(Frame(image), {160, 120});
  const Evidence evidence = part.localize(Frame(stretched), {160, 120});
  EXPECT_LT((evidence.position - Point2(160, 120)).norm(), 1.5);
  EXPECT_GT(evidence.covariance(0, 0), 1.5 * evidence.covariance(1, 1));
  EXPECT_GT(evidence.covariance(0, 0), 2 * still.covariance(0, 0));
}

TEST(Keypoints, OcclusionIsALowPeak) {
  const cv::Mat image = texture(240, 320), other = texture(240, 320, 7);
  cv::Mat half = image.clone();
  other(cv::Rect(160, 0, 160, 240)).copyTo(half(cv::Rect(160, 0, 160, 240)));
  Keypoints part;
  part.init(Frame(image), {160, 120}, {80, 70});
  const Evidence seen = part.localize(Frame(half), {160, 120});
  EXPECT_LT((seen.position - Point2(160, 120)).norm(), 0.5) << "the visible half is enough";
  EXPECT_GT(seen.peak, 0.15);
  EXPECT_LT(seen.peak, 0.6);
  const Evidence hidden = part.localize(Frame(other), {160, 120});
  EXPECT_LT(hidden.peak, 0.1);
  EXPECT_GT(hidden.covariance.trace(), 5 * seen.covariance.trace());
}

TEST(Keypoints, AdaptFollowsTheAppearanceAndDoesNotDrift) {
  const cv::Mat image = texture(240, 320);
  const auto grown = [&](double scale) {
    cv::Mat result;
    cv::warpAffine(image, result, cv::getRotationMatrix2D({160, 120}, 0, scale), image.size(),
                   cv::INTER_CUBIC, cv::BORDER_REPLICATE);
    return result;
  };
  Keypoints adapted, fixed;
  adapted.init(Frame(image), {160, 120}, {80, 70});
  fixed = adapted;
  for (int i = 1; i <= 10; ++i) adapted.adapt(Frame(grown(1 + 0.02 * i)), {160, 120});
  const cv::Mat large = grown(1.2);
  const Evidence evidence = adapted.localize(Frame(large), {160, 120});
  EXPECT_GT(evidence.peak, 1.3 * fixed.localize(Frame(large), {160, 120}).peak);
  EXPECT_LT((evidence.position - Point2(160, 120)).norm(), 2.5) << "a fifth larger, seen from one side more";

  // Although adapted repeatedly beside the target, it still finds the target.
  for (int i = 0; i < 10; ++i) fixed.adapt(Frame(image), {163, 118});
  EXPECT_LT((fixed.localize(Frame(image), {160, 120}).position - Point2(160, 120)).norm(), 0.05);
}

// A small target on a blurred texture has few key-points, and which of them are found depends on the fraction
// of a pixel at which the window is sampled. One that is not found must not be taken for another one.
TEST(Keypoints, DoNotJumpOnABlurredStillImage) {
  for (const std::uint32_t seed : {1U, 2U, 3U, 4U}) {
    const Frame frame(texture(240, 320, seed));
    for (const Point2& at : {Point2(145, 102), Point2(175, 102), Point2(145, 127), Point2(175, 127)}) {
      detail::SplitMix64 random(seed);
      const auto near = [&] {
        const double x = at.x() + 0.5 * random.symmetric(), y = at.y() + 0.5 * random.symmetric();
        return Point2(x, y);
      };
      for (const Size2& size : {Size2(40, 33), Size2(46, 38)}) {
        Keypoints part;
        part.init(frame, at, size);
        for (int i = 0; i < 20; ++i) {
          EXPECT_LT((part.localize(frame, near()).position - at).norm(), 4) << seed << ": " << at.transpose();
          part.adapt(frame, near());
        }
      }
    }
  }
}

TEST(Keypoints, SaysNothingWithoutTexture) {
  const cv::Mat image = texture(240, 320);
  const Frame frame(image), flat(cv::Mat(240, 320, CV_8UC1, cv::Scalar(77)));
  Keypoints part;
  for (const auto& [learned, seen] : {std::pair{&flat, &frame}, {&frame, &flat}}) {
    part.init(*learned, {160, 120}, {48, 40});
    const Evidence evidence = part.localize(*seen, {161, 120});
    EXPECT_EQ(evidence.peak, 0);
    EXPECT_EQ(evidence.position, Point2(161, 120));
    EXPECT_GT(evidence.covariance.trace(), 500);
    EXPECT_EQ(part.similarity_at({161, 120}), 0);
  }
}

TEST(Keypoints, ForgetsItsResponseWhereItStartsAnew) {
  const Frame frame(texture(240, 320));
  Keypoints part;
  part.init(frame, {160, 120}, {48, 40});
  part.localize(frame, {160, 120});
  EXPECT_GT(part.similarity_at({160, 120}), 0);
  part.init(frame, {160, 120}, {48, 40});
  EXPECT_EQ(part.similarity_at({160, 120}), 0);
}

TEST(Keypoints, RefusesBadOptions) {
  const auto refused = [](auto change) {
    KeypointsOptions options;
    change(options);
    EXPECT_THROW(Keypoints{options}, std::invalid_argument);
  };
  refused([](KeypointsOptions& o) { o.max_points = 0; });
  refused([](KeypointsOptions& o) { o.max_points = 1'000'001; });
  refused([](KeypointsOptions& o) { o.fast_threshold = 0; });
  refused([](KeypointsOptions& o) { o.fast_threshold = 256; });
  refused([](KeypointsOptions& o) { o.max_distance = 0; });
  refused([](KeypointsOptions& o) { o.max_ratio = 1.1; });
  refused([](KeypointsOptions& o) { o.vote_radius = 0; });
  refused([](KeypointsOptions& o) { o.vote_radius = INFINITY; });
  refused([](KeypointsOptions& o) { o.window.padding = 0; });
  refused([](KeypointsOptions& o) { o.window.min_template_side = 8; });
  refused([](KeypointsOptions& o) { o.window.max_template_side = 32; });
}

}  // namespace
}  // namespace asterism
