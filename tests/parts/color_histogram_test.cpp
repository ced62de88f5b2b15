#include <gtest/gtest.h>

#include <asterism/parts/models/color_histogram.hpp>
#include <asterism/testing/part_axioms.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace asterism {
namespace {

using Space = ColorHistogramOptions::Space;
using testing::shifted;
using testing::texture;

class ColorHistograms : public ::testing::TestWithParam<Space> {
 protected:
  static ColorHistogram part() {
    ColorHistogramOptions options;
    options.space = GetParam();
    return ColorHistogram(options);
  }
};

// With fewer bins, neighbouring boxes of one texture are more alike.
TEST_P(ColorHistograms, FulfilThePartAxioms) {
  const double tolerance = GetParam() == Space::Rgb ? 0.5 : GetParam() == Space::Hsv ? 1 : 4;
  testing::check_part_axioms(part(), tolerance);
}
TEST_P(ColorHistograms, WithstandFaults) { testing::check_part_faults(part()); }

// At unit scale, compared with OpenCV's histograms and their distance, the square root of 1 - rho.
TEST_P(ColorHistograms, EqualCompareHist) {
  const cv::Mat image = texture(120, 160);
  const Frame frame(image);
  // Converts each window separately, as the part does: the last bit of OpenCV's hue depends on the position
  // in the row.
  const auto window = [&](const cv::Rect& box) {
    cv::Mat pixels = (GetParam() == Space::Gray ? frame.gray() : image)(box).clone();
    if (GetParam() == Space::Hsv) cv::cvtColor(pixels, pixels, cv::COLOR_BGR2HSV_FULL);
    return pixels;
  };
  const auto histogram = [](const cv::Mat& pixels) {
    const int channels[] = {0, 1, 2}, sizes[] = {16, 16, 16};
    const float range[] = {0, 256};
    const float* ranges[] = {range, range, range};
    cv::Mat result;
    cv::calcHist(&pixels, 1, channels, {}, result, pixels.channels(), sizes, ranges);
    return result;
  };
  ColorHistogram model = part();
  model.init(frame, {80, 58}, {21, 17});
  const cv::Mat learned = histogram(window({70, 50, 21, 17}));
  ASSERT_EQ(learned.total(), static_cast<std::size_t>(model.histogram().size()));
  for (Eigen::Index b = 0; b < model.histogram().size(); ++b)
    ASSERT_NEAR(learned.ptr<float>()[b] / (21 * 17), model.histogram()(b), 1e-6);

  model.localize(frame, {75, 60});
  const auto& values = model.response().values;
  const int reach = static_cast<int>(values.rows() / 2);
  const cv::Mat search = window({65 - reach, 52 - reach, 21 + 2 * reach, 17 + 2 * reach});
  for (int r = 0; r <= 2 * reach; r += 3)
    for (int c = 0; c <= 2 * reach; ++c) {
      const double distance =
          cv::compareHist(learned, histogram(search({c, r, 21, 17})), cv::HISTCMP_BHATTACHARYYA);
      ASSERT_NEAR(values(r, c), 1 - distance * distance, 3e-4);
    }
}

TEST_P(ColorHistograms, FindAShiftedTexture) {
  const cv::Mat image = texture(240, 320);
  ColorHistogram model = part();
  model.init(Frame(image), {160, 120}, {24, 20});
  for (const auto& [dx, dy] : {std::pair{1, 0}, {-3, 2}, {9, 11}}) {
    const Evidence evidence = model.localize(Frame(shifted(image, dx, dy)), {160, 120});
    EXPECT_LT((evidence.position - Point2(160 + dx, 120 + dy)).norm(), 0.5) << dx << ", " << dy;
    EXPECT_GT(evidence.peak, 0.99);
  }
}

INSTANTIATE_TEST_SUITE_P(All, ColorHistograms, ::testing::Values(Space::Gray, Space::Rgb, Space::Hsv));

TEST(ColorHistogram, DoesNotCareForTheArrangement) {
  const cv::Mat image = texture(120, 160);
  cv::Mat turned = image.clone();
  const cv::Rect box(70, 50, 21, 21);
  cv::rotate(image(box), turned(box), cv::ROTATE_90_CLOCKWISE);
  ColorHistogram part;
  part.init(Frame(image), {80, 60}, {21, 21});
  const Evidence evidence = part.localize(Frame(turned), {83, 58});
  EXPECT_GT(evidence.peak, 0.99);
  EXPECT_LT((evidence.position - Point2(80, 60)).norm(), 0.3);
}

// A red box in a wide red region is found where the search starts: certain across the region, uncertain along
// it.
TEST(ColorHistogram, StaysOnAPlateau) {
  cv::Mat image(200, 200, CV_8UC3, cv::Scalar(90, 120, 60));
  cv::rectangle(image, {0, 90}, {199, 109}, cv::Scalar(20, 30, 220), cv::FILLED);
  const Frame frame(image);
  ColorHistogram part;
  part.init(frame, {100, 99.5}, {20, 20});
  for (const double x : {100.0, 80.0}) {
    const Evidence evidence = part.localize(frame, {x, 99.5});
    EXPECT_NEAR(evidence.position.x(), x, 0.1);
    EXPECT_NEAR(evidence.position.y(), 99.5, 0.1);
    EXPECT_GT(evidence.covariance(0, 0), 10 * evidence.covariance(1, 1));
  }
}

// A target that has not moved is where it was, also if its surroundings differ from side to side.
TEST(ColorHistogram, StaysWhereItHasLearned) {
  for (const bool crosses : {false, true}) {
    cv::Mat image(200, 200, CV_8UC3);
    for (int y = 0; y < image.rows; ++y)
      for (int x = 0; x < image.cols; ++x)
        image.at<cv::Vec3b>(y, x) =
            (x / 8 + (crosses ? y / 8 : 0)) % 2 == 0 ? cv::Vec3b(190, 65, 95) : cv::Vec3b(60, 195, 30);
    const Frame frame(image);
    for (const Point2& centre : {Point2(94.5, 94.5), Point2(89.7, 94.2), Point2(97, 101.3)}) {
      ColorHistogram part;
      part.init(frame, centre, {30, 28});
      EXPECT_LT((part.localize(frame, centre).position - centre).norm(), 0.02) << centre.transpose();
    }
  }
}

TEST(ColorHistogram, AveragesWhatItSees) {
  const cv::Mat image = texture(120, 160), other = texture(120, 160, 7);
  const Frame frame(image), later(other);
  const Point2 centre(80, 60);
  ColorHistogramOptions options;
  options.learning_rate = 0.25;
  ColorHistogram part(options), first(options), second(options);
  first.init(frame, centre, {21, 17});
  second.init(later, centre, {21, 17});
  part.init(frame, centre, {21, 17});
  part.adapt(later, centre);
  const Eigen::ArrayXf expected = 0.75f * first.histogram() + 0.25f * second.histogram();
  EXPECT_LT((part.histogram() - expected).abs().maxCoeff(), 1e-6);
  EXPECT_NEAR(part.histogram().sum(), 1, 1e-5);
}

TEST(ColorHistogram, ForeignColorsAreALowPeak) {
  const cv::Mat image(120, 160, CV_8UC3, cv::Scalar(90, 120, 60)), other = texture(120, 160);
  ColorHistogram part;
  part.init(Frame(other), {80, 60}, {21, 17});
  const Evidence evidence = part.localize(Frame(image), {80, 60});
  EXPECT_LT(evidence.peak, 0.1);
  EXPECT_LT((evidence.position - Point2(80, 60)).norm(), 1e-9) << "the same everywhere says nothing";
}

TEST(ColorHistogram, RefusesBadOptions) {
  const auto refused = [](auto change) {
    ColorHistogramOptions options;
    change(options);
    EXPECT_THROW(ColorHistogram{options}, std::invalid_argument);
  };
  refused([](ColorHistogramOptions& o) { o.bins = 1; });
  refused([](ColorHistogramOptions& o) { o.bins = 65; });
  refused([](ColorHistogramOptions& o) { o.sharpness = 0; });
  refused([](ColorHistogramOptions& o) { o.learning_rate = 2; });
  refused([](ColorHistogramOptions& o) { o.window.padding = std::nan(""); });
  refused([](ColorHistogramOptions& o) { o.window.min_template_side = 0; });
  refused([](ColorHistogramOptions& o) { o.window.max_template_side = 10; });
}

}  // namespace
}  // namespace asterism
