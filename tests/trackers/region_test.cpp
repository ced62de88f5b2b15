// Regions of the object at the start, and the box that is tracked.

#include <gtest/gtest.h>

#include <asterism/trackers/tracker/multi_tracker.hpp>
#include <asterism/trackers/tracker/region.hpp>
#include <asterism/trackers/tracker/tracker.hpp>
#include <cmath>
#include <limits>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <random>
#include <stdexcept>

#include "moving_square.hpp"

namespace asterism {
namespace {

void expect_near(const cv::Rect2d& a, const cv::Rect2d& b, double tolerance) {
  EXPECT_NEAR(a.x, b.x, tolerance);
  EXPECT_NEAR(a.y, b.y, tolerance);
  EXPECT_NEAR(a.width, b.width, tolerance);
  EXPECT_NEAR(a.height, b.height, tolerance);
}

TEST(Region, OfARectangleTheEqualAreaBoxIsTheRectangle) {
  const cv::Rect2d box(3.25, -7, 12, 1e-3);
  EXPECT_EQ(Region::rectangle(box).equal_area_box(), box);
  const Region corners = Region::polygon({{3, 4}, {13, 4}, {13, 9}, {3, 9}});
  expect_near(corners.equal_area_box(), {3, 4, 10, 5}, 1e-12);
}

TEST(Region, OfATurnedBoxItHasTheSameAreaAndCentre) {
  for (const float angle : {0.0f, 30.0f, 45.0f, 200.0f}) {
    const Region region = Region::rotated({{50, 60}, {40, 10}, angle});
    const cv::Rect2d box = region.equal_area_box();
    EXPECT_NEAR(box.area(), 400, 1e-3) << angle;
    EXPECT_NEAR(box.x + box.width / 2, 50, 1e-4) << angle;
    EXPECT_NEAR(box.y + box.height / 2, 60, 1e-4) << angle;
    EXPECT_NEAR(box.width / box.height, region.box().width / region.box().height, 1e-6) << angle;
  }
}

// Compares any polygon with the pixels of its convex hull, drawn large. The order of the corners does not
// matter, so a self-crossing quadrilateral has the area of its hull.
TEST(Region, OfAnyPolygonItIsThatOfTheHullsPixels) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> coordinate(100, 900);
  for (int i = 0; i < 20; ++i) {
    std::vector<cv::Point2d> points;
    std::vector<cv::Point> whole;
    for (int p = 0; p < 4; ++p) {
      whole.emplace_back(static_cast<int>(coordinate(random)), static_cast<int>(coordinate(random)));
      points.push_back(whole.back());
    }
    std::vector<cv::Point> hull;
    cv::convexHull(whole, hull);
    cv::Mat drawn = cv::Mat::zeros(1000, 1000, CV_8U);
    cv::fillConvexPoly(drawn, hull, 255);
    const cv::Rect2d by_pixels = Region::mask(drawn).equal_area_box(),
                     by_corners = Region::polygon(points).equal_area_box();
    expect_near(by_corners, by_pixels, 4);
    std::swap(points[0], points[1]);
    expect_near(Region::polygon(points).equal_area_box(), by_corners, 1e-9);
  }
}

TEST(Region, FarFromTheOriginNothingIsLost) {
  std::vector<cv::Point2d> points = {{0, 10}, {20, 0}, {30, 20}, {10, 30}};
  const cv::Rect2d near = Region::polygon(points).equal_area_box();
  for (cv::Point2d& p : points) p += {1e7, -1e7};
  expect_near(Region::polygon(points).equal_area_box(), near + cv::Point2d(1e7, -1e7), 1e-6);
}

TEST(Region, CornersOnALineHaveTheirBoundingBox) {
  const Region line = Region::polygon({{0, 0}, {10, 5}, {20, 10}});
  EXPECT_EQ(line.equal_area_box(), line.box());
  const Region point = Region::polygon({{1, 2}, {1, 2}, {1, 2}});
  EXPECT_EQ(point.equal_area_box(), cv::Rect2d(1, 2, 0, 0));
  // Without a limit the box of a sliver would be a hundredth of a pixel wide.
  const cv::Rect2d sliver = Region::polygon({{0, 0}, {100, 2}, {100, 2.001}, {0, 0.001}}).equal_area_box();
  EXPECT_GE(std::min(sliver.width, sliver.height), 1);
  const double infinity = std::numeric_limits<double>::infinity();
  EXPECT_THROW(Region::polygon({{0, 0}, {std::nan(""), 0}, {5, 5}}), std::invalid_argument);
  EXPECT_THROW(make_tracker("kcf").init(draw_frame(0), Region::polygon({{0, 0}, {infinity, 0}, {5, 5}})),
               std::invalid_argument);
}

TEST(Region, MasksAreRefusedWithAReason) {
  EXPECT_THROW(Region::mask(cv::Mat::zeros(5, 5, CV_8U)), std::invalid_argument);
  EXPECT_THROW(Region::mask(cv::Mat::ones(5, 5, CV_32F)), std::invalid_argument);
  EXPECT_THROW(Region::mask(cv::Mat()), std::invalid_argument);
  cv::Mat mask = cv::Mat::zeros(20, 30, CV_8U);
  mask(cv::Rect(4, 6, 10, 5)) = 1;
  expect_near(Region::mask(mask).box(), {4, 6, 10, 5}, 1e-12);
}

// All kinds of trackers start on a region, by image and by frame, as on its box.
TEST(Region, TrackersStartOnIt) {
  const Region region = Region::rotated({{130, 100}, {60, 40}, 30});
  const cv::Mat first = draw_frame(0), second = draw_frame(1);
  for (const std::string name : {"dpt", "kalman", "lgt"}) {
    AnyTracker of_box = make_tracker(name), of_image = make_tracker(name), of_frame = make_tracker(name);
    of_box.init(first, region.equal_area_box());
    of_image.init(first, region);
    of_frame.init(Frame(first), region);
    MultiTracker several;
    several.add(1, make_tracker(name), first, region);
    const cv::Rect2d expected = of_box.update(second).box;
    EXPECT_EQ(of_image.update(second).box, expected) << name;
    EXPECT_EQ(of_frame.update(second).box, expected) << name;
    EXPECT_EQ(several.update(second).at(0).result.box, expected) << name;
  }
}

}  // namespace
}  // namespace asterism
