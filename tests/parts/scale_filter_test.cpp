#include <gtest/gtest.h>

#include <asterism/parts/models/kcf.hpp>
#include <asterism/parts/models/scale_filter.hpp>
#include <asterism/testing/part_axioms.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace asterism {
namespace {

using testing::texture;

const Point2 kCentre(160, 120);

// The image enlarged by a factor about kCentre.
cv::Mat rescaled(const cv::Mat& image, double factor) {
  cv::Mat source = image, result;
  // Prevents aliasing when the image shrinks.
  if (factor < 1) cv::GaussianBlur(image, source, {}, 0.5 / factor);
  const cv::Matx23d zoom(factor, 0, (1 - factor) * kCentre.x(), 0, factor, (1 - factor) * kCentre.y());
  cv::warpAffine(source, result, zoom, image.size(), cv::INTER_CUBIC, cv::BORDER_REFLECT);
  return result;
}

TEST(ScaleFilter, RecoversKnownFactors) {
  const cv::Mat image = texture(240, 320);
  for (const Size2& size : {Size2(60, 48), Size2(40, 110)}) {
    ScaleFilter filter;
    filter.init(Frame(image), kCentre, size);
    EXPECT_NEAR(filter.localize(Frame(image), kCentre), 1, 2e-3);
    EXPECT_NEAR(filter.peak(), 1, 0.2);
    for (const double factor : {0.87, 0.95, 0.99, 1.005, 1.03, 1.1, 1.17}) {
      const double found = filter.localize(Frame(rescaled(image, factor)), kCentre);
      EXPECT_NEAR(found, factor, 0.012 * factor) << size.transpose();
      EXPECT_GT(filter.peak(), 0.3);
      EXPECT_LT(std::abs(std::log(found / factor)), std::sqrt(filter.log_variance()));
      EXPECT_LT(std::sqrt(filter.log_variance()), 0.2);
    }
    // The window over the scales suppresses the outermost ones, so they are reached in two frames.
    for (const double factor : {0.8, 1.25}) {
      ScaleFilter learning = filter;
      const cv::Mat half = rescaled(image, std::sqrt(factor));
      const double first = learning.localize(Frame(half), kCentre);
      learning.adapt(Frame(half), kCentre, first * size);
      const double second = learning.localize(Frame(rescaled(image, factor)), kCentre);
      EXPECT_NEAR(first * second, factor, 0.02 * factor) << size.transpose();
    }
  }
}

TEST(ScaleFilter, AnswersAreMultiplesOfTheSizeLastLearned) {
  const cv::Mat image = texture(240, 320), large = rescaled(image, 1.2);
  ScaleFilter filter;
  filter.init(Frame(image), kCentre, {60, 48});
  EXPECT_NEAR(filter.localize(Frame(large), kCentre), 1.2, 0.02);
  filter.adapt(Frame(large), kCentre, {72, 57.6});
  EXPECT_EQ(filter.size(), Size2(72, 57.6));
  EXPECT_NEAR(filter.localize(Frame(large), kCentre), 1, 0.01);
  EXPECT_NEAR(filter.localize(Frame(image), kCentre), 1 / 1.2, 0.02);
}

// The composition in the class documentation.
TEST(ScaleFilter, FollowsAGrowingTargetWithAPart) {
  const cv::Mat image = texture(240, 320);
  Kcf part;
  ScaleFilter scale;
  Point2 x = kCentre;
  Size2 size(48, 40);
  part.init(Frame(image), x, size);
  scale.init(Frame(image), x, size);
  for (const double rate : {1.01, 1 / 1.02}) {
    const double from = size.x() / 48;
    double truth = from;
    for (int t = 1; t <= 20; ++t) {
      truth = from * std::pow(rate, t);
      const cv::Mat next = rescaled(image, truth);
      const Frame frame(next);
      x = part.localize(frame, x).position;
      size *= scale.localize(frame, x);
      part.resize(size);
      part.adapt(frame, x);
      scale.adapt(frame, x, size);
    }
    EXPECT_NEAR(size.x() / 48, truth, 0.04 * truth);
    EXPECT_LT((x - kCentre).norm(), 1);
  }
}

TEST(ScaleFilter, LocalisingLearnsNothingAndCopiesAreIndependent) {
  const cv::Mat image = texture(240, 320), other = texture(240, 320, 7);
  const Frame frame(image), foreign(other);
  ScaleFilter filter;
  filter.init(frame, kCentre, {48, 40});
  const double before = filter.localize(frame, {163, 118});
  const Eigen::ArrayXf response = filter.response();
  filter.localize(foreign, kCentre);
  ScaleFilter copy = filter;
  copy.adapt(foreign, kCentre, {50, 50});
  EXPECT_EQ(filter.localize(frame, {163, 118}), before);
  EXPECT_TRUE((filter.response() == response).all());
  EXPECT_EQ(filter.size(), Size2(48, 40));
  copy.init(frame, kCentre, {48, 40});
  EXPECT_EQ(copy.localize(frame, {163, 118}), before);
}

TEST(ScaleFilter, WithoutTextureTheSizeStays) {
  const cv::Mat image = texture(240, 320), flat(240, 320, CV_8UC1, cv::Scalar(128));
  ScaleFilter filter;
  filter.init(Frame(image), kCentre, {48, 40});
  filter.localize(Frame(image), kCentre);
  const double certain = filter.log_variance();
  EXPECT_EQ(filter.localize(Frame(flat), kCentre), 1);
  EXPECT_EQ(filter.peak(), 0);
  EXPECT_GT(filter.log_variance(), 10 * certain);
}

TEST(ScaleFilter, WithstandsFaults) {
  const cv::Mat image = texture(120, 160), speck(1, 1, CV_8UC3, cv::Scalar(10, 200, 90));
  const Point2 centre(80, 60);
  ScaleFilter filter;
  const auto expect_sound = [&](double factor) {
    EXPECT_TRUE(std::isfinite(factor) && factor > 0);
    EXPECT_TRUE(std::isfinite(filter.peak()) && filter.peak() >= 0);
    EXPECT_TRUE(std::isfinite(filter.log_variance()) && filter.log_variance() > 0);
  };
  for (const cv::Mat& seen : {image, speck})
    for (const Size2& odd :
         {Size2(1, 1), Size2(0.01, 0.01), Size2(1, 60), Size2(300, 2), Size2(1e6, 1e6), Size2(1e9, 1)})
      for (const Point2& at : {centre, Point2(0, 0), Point2(-500, 700), Point2(1e9, -1e9)}) {
        filter.init(Frame(image), at, odd);
        expect_sound(filter.localize(Frame(seen), at));
        filter.adapt(Frame(seen), at, odd);
        expect_sound(filter.localize(Frame(image), centre));
      }

  filter.init(Frame(image), centre, {30, 24});
  const double before = filter.localize(Frame(image), centre);
  for (const double bad : {std::nan(""), HUGE_VAL, -HUGE_VAL}) {
    EXPECT_THROW(filter.localize(Frame(image), {bad, 60}), std::invalid_argument);
    EXPECT_THROW(filter.adapt(Frame(image), {80, bad}, {30, 24}), std::invalid_argument);
    EXPECT_THROW(filter.adapt(Frame(image), centre, {bad, 24}), std::invalid_argument);
    EXPECT_THROW(filter.init(Frame(image), centre, {30, bad}), std::invalid_argument);
  }
  EXPECT_THROW(filter.adapt(Frame(image), centre, {0, 24}), std::invalid_argument);
  EXPECT_EQ(filter.localize(Frame(image), centre), before);
}

TEST(ScaleFilter, RefusesBadOptions) {
  const auto refused = [](auto change) {
    ScaleFilterOptions options;
    change(options);
    EXPECT_THROW(ScaleFilter{options}, std::invalid_argument);
  };
  refused([](ScaleFilterOptions& o) { o.scales = 1; });
  refused([](ScaleFilterOptions& o) { o.scales = 32; });
  refused([](ScaleFilterOptions& o) { o.step = 1; });
  refused([](ScaleFilterOptions& o) { o.step = 1e9; });
  refused([](ScaleFilterOptions& o) { o.step = 1e300; });
  refused([](ScaleFilterOptions& o) { o.label_sigma = 0; });
  refused([](ScaleFilterOptions& o) { o.lambda = 0; });
  refused([](ScaleFilterOptions& o) { o.learning_rate = 2; });
  refused([](ScaleFilterOptions& o) { o.cell_size = 0; });
  refused([](ScaleFilterOptions& o) { o.max_template_area = 10; });
}

}  // namespace
}  // namespace asterism
