#include <gtest/gtest.h>

#include <asterism/parts/models/superpixels.hpp>
#include <asterism/testing/part_axioms.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace asterism {
namespace {

using testing::displaced;
using testing::shifted;
using testing::texture;

Eigen::ArrayX3f lab_of(const cv::Mat& bgr) {
  cv::Mat pixels;
  bgr.convertTo(pixels, CV_32F, 1.0 / 255);
  cv::cvtColor(pixels, pixels, cv::COLOR_BGR2Lab);
  pixels = pixels.clone();
  return Eigen::Map<const Eigen::Array<float, Eigen::Dynamic, 3, Eigen::RowMajor>>(
      pixels.ptr<float>(), static_cast<Eigen::Index>(pixels.total()), 3);
}

// Every piece is connected, and its area and color are correct.
void expect_sound(const SuperpixelMap& map, const Eigen::ArrayX3f& colors) {
  ASSERT_EQ(map.labels.size(), static_cast<std::size_t>(map.cols * map.rows));
  ASSERT_EQ(map.areas.size(), map.colors.rows());
  std::vector<int> area(static_cast<std::size_t>(map.areas.size()), 0);
  Eigen::ArrayX3d sum = Eigen::ArrayX3d::Zero(map.areas.size(), 3);
  for (std::size_t i = 0; i < map.labels.size(); ++i) {
    const int label = map.labels[i];
    ASSERT_TRUE(label >= 0 && label < map.areas.size());
    ++area[static_cast<std::size_t>(label)];
    sum.row(label) += colors.row(static_cast<Eigen::Index>(i)).cast<double>();
  }
  const cv::Mat labels(map.rows, map.cols, CV_32S, const_cast<int*>(map.labels.data()));
  for (Eigen::Index k = 0; k < map.areas.size(); ++k) {
    const int pixels = area[static_cast<std::size_t>(k)];
    ASSERT_GT(pixels, 0);
    EXPECT_EQ(map.areas(k), static_cast<float>(pixels));
    EXPECT_LT((map.colors.row(k).cast<double>() - sum.row(k) / pixels).abs().maxCoeff(), 1e-3);
    cv::Mat piece;
    EXPECT_EQ(cv::connectedComponents(labels == static_cast<int>(k), piece, 4), 2) << "one, and the rest";
  }
}

TEST(Slic, CoversTheImageWithPieces) {
  for (const cv::Size& size : {cv::Size(100, 80), cv::Size(97, 61), cv::Size(30, 4), cv::Size(3, 50)}) {
    const Eigen::ArrayX3f colors = lab_of(texture(size.height, size.width));
    for (const int side : {2, 5, 8}) {
      SCOPED_TRACE(std::to_string(size.width) + " wide, side " + std::to_string(side));
      const SuperpixelMap map = slic(colors, size.width, {.side = side});
      expect_sound(map, colors);
      const double expected = static_cast<double>(size.area()) / (side * side);
      EXPECT_LT(static_cast<double>(map.areas.size()), 1.5 * expected + 4);
      EXPECT_GT(static_cast<double>(map.areas.size()), 0.6 * expected - 2);
    }
  }
}

TEST(Slic, IsAGridWhereThereIsNothing) {
  const SuperpixelMap map = slic(Eigen::ArrayX3f::Constant(60 * 40, 3, 7), 60, {.side = 10});
  ASSERT_EQ(map.areas.size(), 24);
  EXPECT_GT(map.areas.minCoeff(), 70);
  EXPECT_LT(map.areas.maxCoeff(), 130);
  EXPECT_TRUE((map.colors == 7).all());
}

// The edge runs through the middle of the grid's cells.
TEST(Slic, KeepsToEdges) {
  cv::Mat image(40, 60, CV_8UC3, cv::Scalar(40, 160, 60));
  image.colRange(33, 60).setTo(cv::Scalar(200, 60, 50));
  const Eigen::ArrayX3f colors = lab_of(image);
  const SuperpixelMap map = slic(colors, 60, {.side = 8});
  for (Eigen::Index i = 0; i < colors.rows(); ++i)
    EXPECT_LT((map.colors.row(map.labels[static_cast<std::size_t>(i)]) - colors.row(i)).abs().maxCoeff(),
              1e-2);
}

TEST(Slic, TakesASinglePixelAndRefusesWhatIsNoImage) {
  const Eigen::ArrayX3f one = Eigen::ArrayX3f::Constant(1, 3, 5);
  const SuperpixelMap map = slic(one, 1);
  EXPECT_EQ(map.labels, std::vector{0});
  EXPECT_EQ(map.areas(0), 1);
  EXPECT_THROW(slic(Eigen::ArrayX3f(0, 3), 1), std::invalid_argument);
  EXPECT_THROW(slic(Eigen::ArrayX3f::Zero(7, 3), 2), std::invalid_argument);
  EXPECT_THROW(slic(one, 0), std::invalid_argument);
}

// Products of its side lengths exceed 32 bits.
TEST(Slic, TakesALongImage) {
  const int cols = 70'000;
  const SuperpixelMap map = slic(Eigen::ArrayX3f::Zero(2 * cols, 3), cols, {.side = 2, .iterations = 1});
  EXPECT_EQ(map.areas.size(), cols / 2);
  for (int i = 0; i < 2 * cols; ++i)
    ASSERT_NEAR(map.labels[static_cast<std::size_t>(i)], i % cols / 2, 1) << i;
}

TEST(Superpixels, FulfilThePartAxioms) { testing::check_part_axioms(Superpixels()); }
TEST(Superpixels, WithstandFaults) { testing::check_part_faults(Superpixels()); }

TEST(Superpixels, FindAShiftedTexture) {
  const cv::Mat image = texture(240, 320);
  Superpixels part;
  part.init(Frame(image), {160, 120}, {48, 40});
  EXPECT_GT(part.size(), 20);
  for (const auto& [dx, dy] : {std::pair{0.0, 0.0}, {1, 0}, {-3, 2}, {9, 11}, {0.5, 0.25}, {-4.3, 2.6}}) {
    const Evidence evidence = part.localize(Frame(displaced(image, dx, dy)), {160, 120});
    EXPECT_LT((evidence.position - Point2(160 + dx, 120 + dy)).norm(), 0.5) << dx << ", " << dy;
    EXPECT_GT(evidence.peak, 0.6);
    EXPECT_LT(evidence.peak, 1.1);
  }
}

TEST(Superpixels, RespondWithOneToTheTargetAsLearned) {
  const Frame frame(texture(240, 320));
  Superpixels part;
  part.init(frame, {160, 120}, {40, 40});
  const Evidence evidence = part.localize(frame, {160, 120});
  EXPECT_NEAR(evidence.peak, 1, 1e-3);
  EXPECT_NEAR(part.similarity_at(evidence.position), evidence.peak, 0.05);
  EXPECT_LT(part.similarity_at(evidence.position + Point2(15, 0)), 0.7 * evidence.peak);
}

// Red over blue on green, without texture: only the layout distinguishes the target.
TEST(Superpixels, FindTwoColoredHalves) {
  const auto scene = [](int x, int y) {
    cv::Mat image(160, 200, CV_8UC3, cv::Scalar(60, 140, 70));
    image(cv::Rect(x - 18, y - 18, 36, 18)).setTo(cv::Scalar(40, 50, 200));
    image(cv::Rect(x - 18, y, 36, 18)).setTo(cv::Scalar(190, 80, 50));
    return image;
  };
  Superpixels part;
  part.init(Frame(scene(100, 80)), {99.5, 79.5}, {36, 36});
  for (const auto& [dx, dy] : {std::pair{0, 0}, {3, -2}, {-9, 7}}) {
    const Evidence evidence = part.localize(Frame(scene(100 + dx, 80 + dy)), {99.5, 79.5});
    EXPECT_LT((evidence.position - Point2(99.5 + dx, 79.5 + dy)).norm(), 0.1) << dx << ", " << dy;
    EXPECT_NEAR(evidence.peak, 1, 0.1);
  }
}

TEST(Superpixels, FindATargetThatIsHalfCovered) {
  const cv::Mat image = texture(240, 320);
  cv::Mat half = image.clone();
  half(cv::Rect(160, 0, 160, 240)).setTo(cv::Scalar(128, 128, 128));
  Superpixels part;
  part.init(Frame(image), {160, 120}, {48, 40});
  const Evidence whole = part.localize(Frame(image), {160, 120});
  for (const auto& [dx, dy] : {std::pair{0, 0}, {5, -4}}) {
    const Evidence seen = part.localize(Frame(shifted(half, dx, dy)), {160, 120});
    EXPECT_LT((seen.position - Point2(160 + dx, 120 + dy)).norm(), 1) << dx << ", " << dy;
    EXPECT_LT(seen.peak, 0.75 * whole.peak);
    EXPECT_GT(seen.peak, 0.2);
    EXPECT_GT(seen.covariance.trace(), whole.covariance.trace());
  }
}

// The target changes from red to yellow over 30 frames and has only one color at a time.
TEST(Superpixels, AdaptFollowsASlowChangeOfColor) {
  const auto scene = [](double share) {
    cv::Mat image(160, 200, CV_8UC3, cv::Scalar(120, 110, 60));
    image(cv::Rect(90, 70, 20, 20)).setTo(cv::Scalar(40, 40 + 160 * share, 210));
    return image;
  };
  Superpixels adapted;
  adapted.init(Frame(scene(0)), {99.5, 79.5}, {20, 20});
  Superpixels fixed = adapted;
  for (int t = 1; t <= 40; ++t) {
    const Frame frame(scene(std::min(1.0, t / 30.0)));
    const Evidence evidence = adapted.localize(frame, {97, 81});
    EXPECT_LT((evidence.position - Point2(99.5, 79.5)).norm(), 0.5) << t;
    adapted.adapt(frame, evidence.position);
  }
  const Frame last(scene(1));
  EXPECT_GT(adapted.localize(last, {97, 81}).peak, 0.6);
  EXPECT_LT(fixed.localize(last, {97, 81}).peak, 0.3);
}

TEST(Superpixels, AdaptAtRateOneIsInit) {
  const Frame frame(texture(240, 320)), later(texture(240, 320, 7));
  SuperpixelsOptions options;
  options.learning_rate = 1;
  Superpixels adapted(options), anew(options);
  adapted.init(frame, {160, 120}, {48, 40});
  adapted.adapt(later, {160, 120});
  anew.init(later, {160, 120}, {48, 40});
  const Evidence expected = anew.localize(later, {163, 118}), evidence = adapted.localize(later, {163, 118});
  EXPECT_LT((evidence.position - expected.position).norm(), 1e-2);
  EXPECT_NEAR(evidence.peak, expected.peak, 1e-3);
}

TEST(Superpixels, SayNothingWithoutColors) {
  const cv::Mat image = texture(240, 320);
  const Frame frame(image), flat(cv::Mat(240, 320, CV_8UC3, cv::Scalar(77, 20, 90)));
  Superpixels part;
  for (const auto& [learned, seen] : {std::pair{&flat, &flat}, {&frame, &flat}}) {
    part.init(*learned, {160, 120}, {48, 40});
    const Evidence evidence = part.localize(*seen, {161, 120});
    EXPECT_EQ(evidence.peak, 0);
    EXPECT_LT((evidence.position - Point2(161, 120)).norm(), 1e-9);
    EXPECT_GT(evidence.covariance.trace(), 500);
    EXPECT_EQ(part.similarity_at({161, 120}), 0);
  }
}

TEST(Superpixels, TakeGrayVideo) {
  cv::Mat gray;
  cv::cvtColor(texture(240, 320), gray, cv::COLOR_BGR2GRAY);
  Superpixels part;
  part.init(Frame(gray), {160, 120}, {48, 40});
  for (const auto& [dx, dy] : {std::pair{0, 0}, {6, -3}}) {
    const Evidence evidence = part.localize(Frame(shifted(gray, dx, dy)), {160, 120});
    EXPECT_LT((evidence.position - Point2(160 + dx, 120 + dy)).norm(), 1) << dx << ", " << dy;
  }
}

TEST(Superpixels, RefuseBadOptions) {
  const auto refused = [](auto change) {
    SuperpixelsOptions options;
    change(options);
    EXPECT_THROW(Superpixels{options}, std::invalid_argument);
  };
  refused([](SuperpixelsOptions& o) { o.slic.side = 1; });
  refused([](SuperpixelsOptions& o) { o.slic.side = 1025; });
  refused([](SuperpixelsOptions& o) { o.slic.compactness = 0; });
  refused([](SuperpixelsOptions& o) { o.slic.iterations = 0; });
  refused([](SuperpixelsOptions& o) { o.color_sigma = 0; });
  refused([](SuperpixelsOptions& o) { o.confidence_weight = -1; });
  refused([](SuperpixelsOptions& o) { o.confidence_weight = HUGE_VAL; });
  refused([](SuperpixelsOptions& o) { o.sharpness = std::nan(""); });
  refused([](SuperpixelsOptions& o) { o.learning_rate = 1.1; });
  refused([](SuperpixelsOptions& o) { o.window.padding = 0; });
  refused([](SuperpixelsOptions& o) { o.window.min_template_side = 0; });
  refused([](SuperpixelsOptions& o) { o.window.max_template_side = 16; });
}

}  // namespace
}  // namespace asterism
