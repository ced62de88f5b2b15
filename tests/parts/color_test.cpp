#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/parts/models/color.hpp>
#include <cmath>
#include <limits>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace {

using asterism::box_around;
using asterism::centre_of;
using asterism::ColorModel;
using asterism::ColorOptions;
using asterism::Frame;
using asterism::Point2;
using asterism::Segmentation;
using asterism::Size2;
using Histogram = std::array<float, ColorModel::kBins>;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Colors with well separated hues, as BGR.
const cv::Scalar kRed(0, 0, 255), kGreen(0, 255, 0), kBlue(255, 0, 0), kYellow(0, 255, 255);

std::size_t bin_of(const cv::Scalar& color) {
  cv::Mat hsv;
  cv::cvtColor(cv::Mat(1, 1, CV_8UC3, color), hsv, cv::COLOR_BGR2HSV_FULL);
  const cv::Vec3b v = hsv.at<cv::Vec3b>(0, 0);
  return std::size_t(v[0] / 16) * 256 + std::size_t(v[1] / 16) * 16 + std::size_t(v[2] / 16);
}

double mass(const Histogram& histogram) { return std::accumulate(histogram.begin(), histogram.end(), 0.0); }

cv::Mat painted(cv::Size size, const cv::Scalar& background, const cv::Rect& where, const cv::Scalar& color) {
  cv::Mat image(size, CV_8UC3, background);
  image(where & cv::Rect({}, size)).setTo(color);
  return image;
}

/// Noise of one channel, smooth enough to look like a texture.
cv::Mat texture(cv::Size size, double low, double high, std::uint64_t seed) {
  cv::Mat map(size, CV_8UC1);
  cv::RNG random(seed);
  random.fill(map, cv::RNG::UNIFORM, low, high);
  return map;
}

/// A red-orange textured rectangle on a green-blue textured background.
cv::Mat textured(cv::Size size, const cv::Rect& where) {
  const cv::Mat background[] = {texture(size, 60, 200, 1), texture(size, 90, 255, 2),
                                texture(size, 0, 40, 3)};
  const cv::Mat object[] = {texture(size, 0, 40, 4), texture(size, 20, 80, 5), texture(size, 140, 255, 6)};
  cv::Mat image, foreground;
  cv::merge(background, 3, image);
  cv::merge(object, 3, foreground);
  foreground(where).copyTo(image(where));
  return image;
}

void expect_unit_interval(const cv::Mat& posterior) {
  EXPECT_TRUE(std::all_of(posterior.begin<float>(), posterior.end<float>(),
                          [](float v) { return v >= 0 && v <= 1; }));
}

// ---------------------------------------------------------------------------------------------- histograms

TEST(ColorTest, HistogramsOfATinyImageCountedByHand) {
  // 5 x 5 image: the box is the inner 3 x 3; enlarged by 5 / 3 it is the whole image, so the background is
  // the border of 16 pixels.
  cv::Mat image = painted({5, 5}, kGreen, {1, 1, 3, 3}, kRed);
  image.at<cv::Vec3b>(2, 2) = {255, 0, 0};
  image.at<cv::Vec3b>(0, 4) = {0, 255, 255};
  ColorOptions options;
  options.surrounding = 5.0 / 3;
  ColorModel model(options);
  model.init(Frame(image), {1, 1, 3, 3});
  ASSERT_TRUE(model.enabled());
  EXPECT_FLOAT_EQ(model.foreground()[bin_of(kRed)], 8.0f / 9);
  EXPECT_FLOAT_EQ(model.foreground()[bin_of(kBlue)], 1.0f / 9);
  EXPECT_FLOAT_EQ(model.background()[bin_of(kGreen)], 15.0f / 16);
  EXPECT_FLOAT_EQ(model.background()[bin_of(kYellow)], 1.0f / 16);
  EXPECT_NEAR(mass(model.foreground()), 1, 1e-6);
  EXPECT_NEAR(mass(model.background()), 1, 1e-6);
}

TEST(ColorTest, BoxesCoverPixelCentres) {
  // The box 1.6 .. 3.6 covers pixels 2 and 3 on both axes; the box 1.4 .. 3.4 covers 1 and 2.
  const Frame frame(painted({6, 6}, kGreen, {2, 2, 2, 2}, kRed));
  ColorModel model;
  model.init(frame, {1.6, 1.6, 2, 2});
  EXPECT_FLOAT_EQ(model.foreground()[bin_of(kRed)], 1);
  model.init(frame, {1.4, 1.4, 2, 2});
  EXPECT_FLOAT_EQ(model.foreground()[bin_of(kRed)], 0.25f);
}

TEST(ColorTest, PixelsOutsideTheImageAreNotCounted) {
  // Half of the box is outside the image; all of it inside is red.
  const Frame frame(painted({40, 40}, kGreen, {0, 0, 10, 10}, kRed));
  ColorModel model;
  model.init(frame, {-10, -10, 20, 20});
  ASSERT_TRUE(model.enabled());
  EXPECT_FLOAT_EQ(model.foreground()[bin_of(kRed)], 1);
  EXPECT_FLOAT_EQ(model.background()[bin_of(kGreen)], 1);
  EXPECT_NEAR(mass(model.background()), 1, 1e-6);
}

TEST(ColorTest, LargeBoxesAreSampled) {
  const cv::Rect box(200, 150, 700, 500);
  cv::Mat image = painted({1200, 900}, kGreen, box, kRed);
  image(cv::Rect(200, 150, 350, 500)).setTo(kYellow);
  ColorModel model;
  model.init(Frame(image), box);
  EXPECT_NEAR(mass(model.foreground()), 1, 1e-5);
  EXPECT_NEAR(mass(model.background()), 1, 1e-5);
  EXPECT_NEAR(model.foreground()[bin_of(kRed)], 0.5, 0.01);
  EXPECT_FLOAT_EQ(model.background()[bin_of(kGreen)], 1);
}

TEST(ColorTest, AdaptIsTheAutoregressiveModel) {
  const Frame first(painted({60, 60}, kGreen, {20, 20, 20, 20}, kRed));
  cv::Mat image = painted({60, 60}, kBlue, {20, 20, 20, 20}, kRed);
  image(cv::Rect(20, 20, 10, 20)).setTo(kYellow);
  ColorOptions options;
  options.histogram_rate = 0.2;
  ColorModel model(options);
  model.init(first, {20, 20, 20, 20});
  model.adapt(Frame(image), {20, 20, 20, 20});
  EXPECT_NEAR(model.foreground()[bin_of(kRed)], 0.9, 1e-6);
  EXPECT_NEAR(model.foreground()[bin_of(kYellow)], 0.1, 1e-6);
  EXPECT_NEAR(model.background()[bin_of(kGreen)], 0.8, 1e-6);
  EXPECT_NEAR(model.background()[bin_of(kBlue)], 0.2, 1e-6);
  for (int i = 0; i < 300; ++i) model.adapt(Frame(image), {20, 20, 20, 20});
  EXPECT_NEAR(mass(model.foreground()), 1, 1e-5);
  EXPECT_NEAR(model.foreground()[bin_of(kRed)], 0.5, 1e-5);
  EXPECT_EQ(model.background()[bin_of(kGreen)], 0);  // forgotten, not a denormal number
}

TEST(ColorTest, AdaptLeavesWhatItCannotSee) {
  const Frame frame(painted({60, 60}, kGreen, {20, 20, 20, 20}, kRed));
  ColorModel model;
  model.init(frame, {20, 20, 20, 20});
  const Histogram foreground = model.foreground(), background = model.background();
  model.adapt(frame, {500, 500, 20, 20});
  EXPECT_EQ(model.foreground(), foreground);
  EXPECT_EQ(model.background(), background);
  // The box covers the frame: there is a foreground but no background.
  model.adapt(frame, {0, 0, 60, 60});
  EXPECT_NE(model.foreground(), foreground);
  EXPECT_EQ(model.background(), background);
  EXPECT_TRUE(model.enabled());
}

TEST(ColorTest, InitMayBeCalledAgain) {
  const Frame red(painted({60, 60}, kGreen, {20, 20, 20, 20}, kRed));
  const Frame blue(painted({60, 60}, kYellow, {20, 20, 20, 20}, kBlue));
  ColorModel model, fresh;
  model.init(red, {20, 20, 20, 20});
  model.adapt(red, {20, 20, 20, 20});
  model.init(blue, {20, 20, 20, 20});
  fresh.init(blue, {20, 20, 20, 20});
  EXPECT_EQ(model.foreground(), fresh.foreground());
  EXPECT_EQ(model.background(), fresh.background());
}

// ------------------------------------------------------------------------------------------------- being off

void expect_off(ColorModel& model, const Frame& frame) {
  const Segmentation segmentation = model.segment(frame, {0, 0, 50, 50}, {20, 20});
  EXPECT_FALSE(segmentation.informative);
  EXPECT_TRUE(segmentation.posterior.empty());
  EXPECT_EQ(segmentation.at({20, 20}), 0);
  EXPECT_EQ(segmentation.foreground_fraction({10, 10, 20, 20}), 0);
  EXPECT_EQ(model.probability(segmentation, {20, 20}), 1);
}

TEST(ColorTest, OffWithoutColor) {
  const Frame gray(cv::Mat(60, 60, CV_8UC1, cv::Scalar(80)));
  const Frame three_equal(painted({60, 60}, cv::Scalar::all(80), {20, 20, 20, 20}, cv::Scalar::all(200)));
  const Frame color(painted({60, 60}, kGreen, {20, 20, 20, 20}, kRed));
  for (const Frame* frame : {&gray, &three_equal}) {
    ColorModel model;
    expect_off(model, *frame);  // before init
    model.init(*frame, {20, 20, 20, 20});
    EXPECT_FALSE(model.enabled());
    EXPECT_EQ(mass(model.foreground()), 0);
    model.adapt(color, {20, 20, 20, 20});
    EXPECT_FALSE(model.enabled());
    expect_off(model, color);

    // A model with color is off only while frames have none.
    model.init(color, {20, 20, 20, 20});
    const Histogram before = model.foreground();
    expect_off(model, *frame);
    model.adapt(*frame, {20, 20, 20, 20});
    EXPECT_EQ(model.foreground(), before);
    EXPECT_TRUE(model.segment(color, {0, 0, 60, 60}, {20, 20}).informative);

    // It is off again after init without color.
    model.init(*frame, {20, 20, 20, 20});
    EXPECT_FALSE(model.enabled());
  }
}

TEST(ColorTest, OffWithoutBackgroundOrForeground) {
  const Frame frame(painted({50, 50}, kGreen, {20, 20, 20, 20}, kRed));
  ColorModel model;
  for (const cv::Rect2d& box : {cv::Rect2d(0, 0, 50, 50), cv::Rect2d(-10, -10, 80, 80),
                                cv::Rect2d(100, 100, 20, 20), cv::Rect2d(-1e308, -1e308, 1.7e308, 1.7e308)}) {
    model.init(frame, box);
    EXPECT_FALSE(model.enabled()) << box;
    EXPECT_EQ(mass(model.foreground()) + mass(model.background()), 0) << box;
    expect_off(model, frame);
  }
}

// ---------------------------------------------------------------------------------------------- segmentation

TEST(ColorTest, SegmentsAColoredRectangle) {
  const cv::Rect object(70, 60, 60, 50);
  const Frame frame(textured({240, 200}, object));
  ColorModel model;
  model.init(frame, object);
  const cv::Rect2d region = box_around(centre_of(object), {150, 130});
  const Segmentation segmentation = model.segment(frame, region, {60, 50});
  EXPECT_TRUE(segmentation.informative);
  expect_unit_interval(segmentation.posterior);
  EXPECT_NEAR(double(segmentation.posterior.total()), 1000, 60);
  EXPECT_NEAR(segmentation.posterior.cols * segmentation.spacing.x(), region.width, 1e-9);
  EXPECT_NEAR(segmentation.posterior.rows * segmentation.spacing.y(), region.height, 1e-9);
  // The field softens the edge by its radius of two cells.
  const double margin = 2 * segmentation.spacing.maxCoeff();
  int inside = 0, outside = 0, wrong = 0;
  for (int y = 30; y < 140; ++y) {
    for (int x = 30; x < 165; ++x) {
      const double dx = std::max(object.x - 0.5 - x, x - (object.br().x - 0.5));
      const double dy = std::max(object.y - 0.5 - y, y - (object.br().y - 0.5));
      const double distance = std::max(dx, dy), p = segmentation.at({x, y});
      if (distance < -margin) {
        ++inside;
        wrong += !(p > 0.9);
      } else if (distance > margin) {
        ++outside;
        wrong += !(p < 0.1);
      }
    }
  }
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(inside, 1000);
  EXPECT_GT(outside, 5000);
  EXPECT_GT(segmentation.foreground_fraction(object), 0.9);
  EXPECT_LT(segmentation.foreground_fraction({20, 20, 30, 30}), 0.05);
  EXPECT_NEAR(model.probability(segmentation, centre_of(object)), 1, 0.01);
  EXPECT_NEAR(model.probability(segmentation, {30, 30}), 0.1, 0.01);
}

TEST(ColorTest, RawPosteriorIsBayesRule) {
  // Red is half of the foreground and a quarter of the background; green occurs only in the background; blue
  // is unseen.
  cv::Mat image = painted({60, 60}, kGreen, {20, 20, 20, 20}, kYellow);
  image(cv::Rect(20, 20, 10, 20)).setTo(kRed);
  ColorOptions options;
  options.surrounding = 2;
  options.mrf.enabled = false;
  options.foreground_prior = 0.4;
  ColorModel model(options);
  image(cv::Rect(10, 10, 40, 10)).rowRange(0, 5).setTo(kRed);
  image(cv::Rect(10, 40, 40, 10)).rowRange(0, 2).setTo(kRed);
  image(cv::Rect(10, 40, 20, 3)).rowRange(2, 3).setTo(kRed);
  model.init(Frame(image), {20, 20, 20, 20});
  ASSERT_FLOAT_EQ(model.foreground()[bin_of(kRed)], 0.5f);
  ASSERT_FLOAT_EQ(model.background()[bin_of(kRed)], 0.25f);

  const auto posterior = [&](const cv::Scalar& color) {
    const cv::Mat flat(20, 20, CV_8UC3, color);
    const Segmentation segmentation = model.segment(Frame(flat), {0, 0, 20, 20}, {20, 20});
    double low = 0, high = 0;
    cv::minMaxLoc(segmentation.posterior, &low, &high);
    EXPECT_EQ(low, high);
    return low;
  };
  EXPECT_NEAR(posterior(kRed), 0.4 * 0.5 / (0.4 * 0.5 + 0.6 * 0.25), 1e-6);
  EXPECT_EQ(posterior(kGreen), 0);
  EXPECT_EQ(posterior(kYellow), 1);
  EXPECT_NEAR(posterior(kBlue), 0.4, 1e-6);
}

TEST(ColorTest, CellsAverageThePosteriorNotTheColor) {
  // A fine checkerboard of red and yellow; their mean, orange, is background.
  const auto board = [](cv::Mat image) {
    for (int y = 0; y < image.rows; ++y) {
      for (int x = 0; x < image.cols; ++x) {
        image.at<cv::Vec3b>(y, x) = (x + y) % 2 == 0 ? cv::Vec3b(0, 0, 255) : cv::Vec3b(0, 255, 255);
      }
    }
  };
  cv::Mat image(300, 300, CV_8UC3, cv::Scalar(0, 127, 255));
  board(image(cv::Rect(100, 100, 100, 100)));
  ColorOptions options;
  options.mrf.enabled = false;
  ColorModel model(options);
  model.init(Frame(image), {100, 100, 100, 100});
  const Segmentation segmentation = model.segment(Frame(image), {0, 0, 300, 300}, {100, 100});
  EXPECT_NEAR(segmentation.at({150, 150}), 1, 1e-6);
  EXPECT_NEAR(segmentation.at({50, 50}), 0, 1e-6);
}

TEST(ColorTest, InformativeWithinTheAreaRatios) {
  ColorModel model;
  const Size2 box_size(30, 30);
  model.init(Frame(painted({120, 120}, kGreen, {45, 45, 30, 30}, kRed)), {45, 45, 30, 30});
  const auto informative = [&](const cv::Rect& red) {
    return model.segment(Frame(painted({120, 120}, kGreen, red, kRed)), {0, 0, 120, 120}, box_size)
        .informative;
  };
  EXPECT_TRUE(informative({45, 45, 30, 30}));   // ratio 1
  EXPECT_FALSE(informative({45, 45, 8, 8}));    // 0.07
  EXPECT_FALSE(informative({0, 0, 0, 0}));      // 0
  EXPECT_TRUE(informative({40, 40, 20, 20}));   // 0.44
  EXPECT_TRUE(informative({30, 30, 40, 40}));   // 1.78
  EXPECT_FALSE(informative({20, 20, 50, 50}));  // 2.8
  EXPECT_FALSE(informative({0, 0, 120, 119}));  // all
  // All foreground in the region counts, not only that inside the box.
  EXPECT_FALSE(informative({0, 0, 50, 50}));
}

TEST(ColorTest, RegionsAcrossTheBorder) {
  const cv::Rect object(0, 0, 30, 40);
  const Frame frame(textured({200, 150}, object));
  ColorModel model;
  model.init(frame, object);
  const cv::Rect2d region(-50, -45.5, 120, 130);
  const Segmentation segmentation = model.segment(frame, region, {30, 40});
  EXPECT_TRUE(segmentation.informative);
  expect_unit_interval(segmentation.posterior);
  for (int row = 0; row < segmentation.posterior.rows; ++row) {
    for (int col = 0; col < segmentation.posterior.cols; ++col) {
      const double x = segmentation.origin.x() + col * segmentation.spacing.x();
      const double y = segmentation.origin.y() + row * segmentation.spacing.y();
      const float p = segmentation.posterior.at<float>(row, col);
      if (x < -0.5 || y < -0.5) {
        EXPECT_EQ(p, 0) << x << ' ' << y;
      } else if (x < 25 && y < 35) {
        // The region outside the image does not erode the object at the border.
        EXPECT_GT(p, 0.9) << x << ' ' << y;
      }
    }
  }
}

TEST(ColorTest, RegionsOutsideTinyAndExtreme) {
  const cv::Rect object(20, 20, 20, 20);
  const Frame frame(painted({60, 60}, kGreen, object, kRed));
  ColorModel model;
  model.init(frame, object);
  const auto segment = [&](const cv::Rect2d& region) { return model.segment(frame, region, {20, 20}); };

  const Segmentation outside = segment({100, 10, 40, 40});
  EXPECT_FALSE(outside.informative);
  ASSERT_FALSE(outside.posterior.empty());
  EXPECT_EQ(cv::countNonZero(outside.posterior), 0);

  const Segmentation pixel = segment({30, 30, 1, 1});
  EXPECT_EQ(pixel.posterior.size(), cv::Size(1, 1));
  EXPECT_EQ(pixel.origin, Point2(30, 30));
  EXPECT_GT(pixel.at({30, 30}), 0.9);
  EXPECT_FALSE(pixel.informative);  // one pixel of 400
  EXPECT_GT(segment({30.3, 30.2, 0.01, 0.01}).at({30.3 - 0.495, 30.2 - 0.495}), 0.9);
  EXPECT_LT(segment({3, 3, 1, 1}).at({3, 3}), 0.1);

  for (const cv::Rect2d& region :
       {cv::Rect2d(-1e6, -1e6, 2e6, 2e6), cv::Rect2d(-1e300, 30, 2e300, 1), cv::Rect2d(30, -1e8, 1, 2e8),
        cv::Rect2d(-1e308, -1e308, 1.7e308, 1.7e308), cv::Rect2d(59, 59, 1e9, 1e-9),
        cv::Rect2d(0, 5, 60, 1.6), cv::Rect2d(59.4, 59.4, 3.3, 1.7), cv::Rect2d(-0.5, -0.5, 1, 1)}) {
    const Segmentation segmentation = segment(region);
    ASSERT_FALSE(segmentation.posterior.empty()) << region;
    EXPECT_LE(segmentation.posterior.total(), 4000u) << region;
    expect_unit_interval(segmentation.posterior);
  }
}

TEST(ColorTest, ShiftsWithTheImage) {
  const cv::Rect object(40, 35, 30, 25);
  const cv::Mat image = textured({160, 140}, object);
  cv::Mat shifted(image.size(), image.type());
  image(cv::Rect(0, 0, 149, 133)).copyTo(shifted(cv::Rect(11, 7, 149, 133)));
  ColorModel a, b;
  a.init(Frame(image), object);
  b.init(Frame(shifted), object + cv::Point(11, 7));
  EXPECT_EQ(a.foreground(), b.foreground());
  EXPECT_EQ(a.background(), b.background());
  const cv::Rect2d region(20.25, 15.5, 75, 65);
  const Segmentation at_home = a.segment(Frame(image), region, {30, 25});
  const Segmentation away = b.segment(Frame(shifted), region + cv::Point2d(11, 7), {30, 25});
  EXPECT_EQ(cv::norm(at_home.posterior, away.posterior, cv::NORM_INF), 0);
  EXPECT_LT((away.origin - at_home.origin - Point2(11, 7)).norm(), 1e-9);
}

// Only memory of segmentations that nobody holds is reused.
TEST(ColorTest, WhatIsKeptStaysAsItWas) {
  const cv::Rect object(40, 35, 30, 25);
  const Frame frame(textured({160, 140}, object));
  ColorModel model;
  model.init(frame, object);
  const std::vector<cv::Rect2d> regions{{20, 15, 75, 65}, {30, 25, 75, 65}, {10, 5, 120, 40}};
  const auto alone = [&](std::size_t i) { return ColorModel(model).segment(frame, regions[i], {30, 25}); };
  std::vector<Segmentation> kept;
  for (int round = 0; round < 2; ++round)
    for (const cv::Rect2d& region : regions) {
      model.segment(frame, region, {30, 25});
      kept.push_back(model.segment(frame, region, {30, 25}));
      ColorModel copy = model;
      copy.segment(frame, regions[0], {30, 25});
    }
  for (std::size_t i = 0; i < kept.size(); ++i)
    EXPECT_EQ(cv::norm(kept[i].posterior, alone(i % regions.size()).posterior, cv::NORM_INF), 0) << i;
}

// ------------------------------------------------------------------------------------------ reading the
// result

Segmentation four_cells() {
  Segmentation segmentation;
  segmentation.posterior = (cv::Mat_<float>(2, 2) << 0.0f, 0.4f, 0.8f, 1.0f);
  segmentation.origin = {10, 20};
  segmentation.spacing = {4, 2};
  segmentation.informative = true;
  return segmentation;
}

TEST(ColorTest, InterpolatesBilinearly) {
  const Segmentation segmentation = four_cells();
  EXPECT_NEAR(segmentation.at({10, 20}), 0, 1e-6);
  EXPECT_NEAR(segmentation.at({14, 20}), 0.4, 1e-6);
  EXPECT_NEAR(segmentation.at({10, 22}), 0.8, 1e-6);
  EXPECT_NEAR(segmentation.at({14, 22}), 1, 1e-6);
  EXPECT_NEAR(segmentation.at({12, 21}), 0.55, 1e-6);
  EXPECT_NEAR(segmentation.at({11, 20}), 0.1, 1e-6);
  EXPECT_NEAR(segmentation.at({10, 20.5}), 0.2, 1e-6);
  // Half a cell around the outermost centres still belongs to the grid.
  EXPECT_NEAR(segmentation.at({15.9, 22.9}), 1, 1e-6);
  EXPECT_EQ(segmentation.at({16.1, 22}), 0);
  EXPECT_EQ(segmentation.at({14, 23.1}), 0);
  EXPECT_EQ(segmentation.at({7.9, 22}), 0);
  EXPECT_EQ(segmentation.at({kNan, 22}), 0);
  EXPECT_EQ(segmentation.at({14, kInfinity}), 0);
}

TEST(ColorTest, ForegroundFractionByHand) {
  const Segmentation segmentation = four_cells();  // the lower two cells are foreground
  EXPECT_EQ(segmentation.foreground_fraction({8.5, 19.5, 8, 4}), 0.5);
  EXPECT_EQ(segmentation.foreground_fraction({9, 22, 3, 1}), 1);     // only the centre (10, 22)
  EXPECT_EQ(segmentation.foreground_fraction({9, 20, 3, 1}), 0);     // only (10, 20)
  EXPECT_EQ(segmentation.foreground_fraction({14, 20, 1, 3}), 0.5);  // (14, 20) and (14, 22)
  // No centre inside: the nearest one counts.
  EXPECT_EQ(segmentation.foreground_fraction({11, 22, 1, 1}), 1);
  EXPECT_EQ(segmentation.foreground_fraction({11, 20, 1, 1}), 0);
  // The grid is continued by cells of 0: here four of them below.
  EXPECT_NEAR(segmentation.foreground_fraction({8.5, 21.5, 8, 6}), 2.0 / 6, 1e-12);
  EXPECT_EQ(segmentation.foreground_fraction({100, 100, 20, 20}), 0);
  for (const cv::Rect2d& box :
       {cv::Rect2d(10, 20, 0, 5), cv::Rect2d(10, 20, 5, -1), cv::Rect2d(kNan, 20, 5, 5),
        cv::Rect2d(10, 20, kInfinity, 5), cv::Rect2d(1.7e308, 0, 1e308, 1e308)}) {
    EXPECT_EQ(segmentation.foreground_fraction(box), 0) << box;
  }
}

TEST(ColorTest, ProbabilityMixesTheUniformComponent) {
  Segmentation segmentation = four_cells();
  ColorOptions options;
  options.uniform_weight = 0.3;
  const ColorModel model(options);
  EXPECT_NEAR(model.probability(segmentation, {14, 20}), 0.4 * 0.7 + 0.3, 1e-6);
  EXPECT_NEAR(model.probability(segmentation, {500, 500}), 0.3, 1e-6);
  segmentation.informative = false;
  EXPECT_EQ(model.probability(segmentation, {14, 20}), 1);
}

// -------------------------------------------------------------------------------------------------- bad
// input

TEST(ColorTest, RefusesBadOptions) {
  const auto refused = [](auto set) {
    ColorOptions options;
    set(options);
    EXPECT_THROW(ColorModel{options}, std::invalid_argument);
  };
  for (const double bad : {-0.1, 1.1, kNan}) {
    refused([bad](ColorOptions& o) { o.histogram_rate = bad; });
    refused([bad](ColorOptions& o) { o.uniform_weight = bad; });
  }
  for (const double bad : {1.0, 0.5, kNan, kInfinity})
    refused([bad](ColorOptions& o) { o.surrounding = bad; });
  for (const double bad : {0.0, 1.0, kNan}) refused([bad](ColorOptions& o) { o.foreground_prior = bad; });
  for (const double bad : {-1.0, 2.5, kNan}) refused([bad](ColorOptions& o) { o.min_area_ratio = bad; });
  for (const double bad : {0.1, kNan}) refused([bad](ColorOptions& o) { o.max_area_ratio = bad; });
  refused([](ColorOptions& o) { o.mrf.max_iterations = 0; });
  refused([](ColorOptions& o) { o.mrf.neighbourhood = 0; });
}

TEST(ColorTest, RefusesBadBoxes) {
  const Frame frame(painted({60, 60}, kGreen, {20, 20, 20, 20}, kRed));
  ColorModel model;
  model.init(frame, {20, 20, 20, 20});
  const Histogram before = model.foreground();
  for (const cv::Rect2d& box :
       {cv::Rect2d(kNan, 20, 20, 20), cv::Rect2d(20, kInfinity, 20, 20), cv::Rect2d(20, 20, 0, 20),
        cv::Rect2d(20, 20, 20, -3), cv::Rect2d(20, 20, kNan, 20)}) {
    EXPECT_THROW(model.init(frame, box), std::invalid_argument);
    EXPECT_THROW(model.adapt(frame, box), std::invalid_argument);
    EXPECT_THROW(model.segment(frame, box, {20, 20}), std::invalid_argument);
  }
  EXPECT_THROW(model.segment(frame, {0, 0, 60, 60}, {0, 20}), std::invalid_argument);
  EXPECT_THROW(model.segment(frame, {0, 0, 60, 60}, {20, kNan}), std::invalid_argument);
  EXPECT_TRUE(model.enabled());
  EXPECT_EQ(model.foreground(), before);
}

}  // namespace
