#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/parts/models/flow.hpp>
#include <asterism/testing/part_axioms.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <vector>

namespace asterism {
namespace {

using testing::displaced;
using testing::texture;

TEST(Flow, FulfilsThePartAxioms) { testing::check_part_axioms(Flow()); }
TEST(Flow, WithstandsFaults) { testing::check_part_faults(Flow()); }

TEST(Flow, FindsAShiftedTexture) {
  const cv::Mat image = texture(240, 320);
  Flow part;
  part.init(Frame(image), {160, 120}, {48, 40});
  for (const auto& [dx, dy] : {std::pair{1.0, 0.0}, {-3, 2}, {5, -7}, {0.5, 0.25}, {-4.3, 2.6}}) {
    const cv::Mat moved = displaced(image, dx, dy);
    const Evidence evidence = part.localize(Frame(moved), {160, 120});
    EXPECT_LT((evidence.position - Point2(160 + dx, 120 + dy)).norm(), 0.05) << dx << ", " << dy;
    EXPECT_GT(evidence.peak, 0.9);
    EXPECT_LT(evidence.covariance.trace(), 0.1);
  }
}

// Compared with OpenCV's own optical flow on the whole images at points of the target: the median of their
// displacements.
TEST(Flow, IsTheMedianOfOpenCvsFlow) {
  const cv::Mat image = texture(240, 320);
  cv::Mat turned;
  cv::warpAffine(image, turned, cv::Matx23d(0.999, -0.04, 7.2, 0.04, 0.999, -3.7), image.size(),
                 cv::INTER_CUBIC);
  cv::Mat first, second;
  cv::cvtColor(image, first, cv::COLOR_BGR2GRAY);
  cv::cvtColor(turned, second, cv::COLOR_BGR2GRAY);
  std::vector<cv::Point2f> points, moved;
  for (float y = 102; y <= 138; y += 4)
    for (float x = 138; x <= 182; x += 4) points.emplace_back(x, y);
  std::vector<uchar> found;
  cv::calcOpticalFlowPyrLK(first, second, points, moved, found, cv::noArray());
  std::vector<double> dx, dy;
  for (std::size_t i = 0; i < points.size(); ++i) {
    ASSERT_TRUE(found[i]);
    dx.push_back(static_cast<double>(moved[i].x - points[i].x));
    dy.push_back(static_cast<double>(moved[i].y - points[i].y));
  }
  std::sort(dx.begin(), dx.end());
  std::sort(dy.begin(), dy.end());
  const Point2 expected = Point2(160, 120) + Point2(dx[dx.size() / 2], dy[dy.size() / 2]);

  Flow part;
  part.init(Frame(image), {160, 120}, {48, 40});
  const Evidence evidence = part.localize(Frame(turned), {160, 120});
  EXPECT_LT((evidence.position - expected).norm(), 0.4);  // other points: motion differs by 0.16 px per 4 px
  EXPECT_GT((evidence.position - Point2(160, 120)).norm(), 1.5);
}

// A target that is stretched about its centre stays in place; the scatter of its points equals their motion.
TEST(Flow, ScatterMeasuresDeformation) {
  const cv::Mat image = texture(240, 320);
  cv::Mat stretched;
  cv::warpAffine(image, stretched, cv::Matx23d(1.1, 0, -16, 0, 1, 0), image.size(), cv::INTER_CUBIC);
  Flow part;
  part.init(Frame(image), {160, 120}, {60, 60});
  const Evidence evidence = part.localize(Frame(stretched), {160, 120});
  EXPECT_LT((evidence.position - Point2(160, 120)).norm(), 0.3);
  // Variance of 0.1 x for x uniform over 60 px.
  EXPECT_NEAR(evidence.covariance(0, 0), 0.01 * 60 * 60 / 12, 1.5);
  EXPECT_LT(evidence.covariance(1, 1), 0.1);
}

TEST(Flow, OcclusionIsALowPeak) {
  const cv::Mat image = texture(240, 320), other = texture(240, 320, 7);
  cv::Mat half = image.clone();
  other(cv::Rect(160, 0, 160, 240)).copyTo(half(cv::Rect(160, 0, 160, 240)));
  Flow part;
  part.init(Frame(image), {160, 120}, {48, 40});
  const Evidence seen = part.localize(Frame(half), {160, 120});
  EXPECT_LT((seen.position - Point2(160, 120)).norm(), 0.2) << "the visible half is enough";
  EXPECT_NEAR(seen.peak, 0.5, 0.15);
  const Evidence hidden = part.localize(Frame(other), {160, 120});
  EXPECT_LT(hidden.peak, 0.2);
  EXPECT_GT(hidden.covariance.trace(), 10 * seen.covariance.trace());
}

TEST(Flow, FollowsFromTheLastAppearance) {
  const cv::Mat image = texture(240, 320), other = texture(240, 320, 7);
  const Frame frame(image), later(other);
  Flow part;
  part.init(frame, {160, 120}, {48, 40});
  const Flow before = part;
  part.adapt(later, {150, 110});
  const Evidence evidence = part.localize(later, {152, 109});
  EXPECT_LT((evidence.position - Point2(150, 110)).norm(), 0.05);
  EXPECT_GT(evidence.peak, 0.95);
  Flow copy = before;
  EXPECT_GT(copy.localize(frame, {160, 120}).peak, 0.95) << "a copy keeps what it has learned";
}

TEST(Flow, SaysNothingWithoutTexture) {
  const Frame flat(cv::Mat(240, 320, CV_8UC1, cv::Scalar(77)));
  Flow part;
  part.init(flat, {160, 120}, {48, 40});
  const Evidence evidence = part.localize(flat, {161, 120});
  EXPECT_EQ(evidence.peak, 0);
  EXPECT_EQ(evidence.position, Point2(161, 120));
  EXPECT_GT(evidence.covariance.trace(), 500);
  EXPECT_EQ(part.similarity_at({161, 120}), 0);
}

TEST(Flow, ForgetsItsResponseWhereItStartsAnew) {
  const Frame frame(texture(240, 320));
  Flow part;
  part.init(frame, {160, 120}, {48, 40});
  part.localize(frame, {160, 120});
  EXPECT_GT(part.similarity_at({160, 120}), 0);
  part.init(frame, {160, 120}, {48, 40});
  EXPECT_EQ(part.similarity_at({160, 120}), 0);
}

TEST(Flow, RefusesBadOptions) {
  const auto refused = [](auto change) {
    FlowOptions options;
    change(options);
    EXPECT_THROW(Flow{options}, std::invalid_argument);
  };
  refused([](FlowOptions& o) { o.grid = 1; });
  refused([](FlowOptions& o) { o.max_error = 0; });
  refused([](FlowOptions& o) { o.grid = 1001; });
  refused([](FlowOptions& o) { o.lk_window = 4; });
  refused([](FlowOptions& o) { o.lk_window = 10001; });
  refused([](FlowOptions& o) { o.lk_levels = -1; });
  refused([](FlowOptions& o) { o.lk_levels = 17; });
  refused([](FlowOptions& o) { o.window.padding = 0; });
  refused([](FlowOptions& o) { o.window.min_template_side = 4; });
  refused([](FlowOptions& o) { o.window.max_template_side = 10; });
}

}  // namespace
}  // namespace asterism
