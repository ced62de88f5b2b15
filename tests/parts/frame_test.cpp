#include <gtest/gtest.h>

#include <asterism/parts/frame.hpp>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace {

using asterism::box_around;
using asterism::centre_of;
using asterism::Frame;
using asterism::Point2;
using asterism::Size2;

bool equal(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() && cv::norm(a, b, cv::NORM_INF) == 0;
}

cv::Mat colours() {
  cv::Mat image(5, 7, CV_8UC3);
  cv::RNG random(7);
  random.fill(image, cv::RNG::UNIFORM, 0, 256);
  return image;
}

TEST(FrameTest, BoxAndCentreAreInverse) {
  const cv::Rect2d one_pixel(3, 4, 1, 1);
  EXPECT_EQ(centre_of(one_pixel), Point2(3, 4));
  const cv::Rect2d box(10.25, -3.5, 17, 8.5);
  const cv::Rect2d back = box_around(centre_of(box), Size2(box.width, box.height));
  EXPECT_EQ(back, box);
}

TEST(FrameTest, EightBitIsNotCopied) {
  const cv::Mat bgr = colours();
  const Frame frame(bgr);
  EXPECT_EQ(frame.bgr().data, bgr.data);
  cv::Mat gray;
  cv::cvtColor(bgr, gray, cv::COLOR_BGR2GRAY);
  EXPECT_TRUE(equal(frame.gray(), gray));
  const Frame gray_frame(gray);
  EXPECT_EQ(gray_frame.gray().data, gray.data);
  EXPECT_TRUE(gray_frame.bgr().empty());
  EXPECT_EQ(gray_frame.size(), cv::Size(7, 5));
}

TEST(FrameTest, AlphaIsDropped) {
  cv::Mat bgra;
  cv::cvtColor(colours(), bgra, cv::COLOR_BGR2BGRA);
  bgra.at<cv::Vec4b>(0, 0)[3] = 0;
  EXPECT_TRUE(equal(Frame(bgra).bgr(), colours()));
}

TEST(FrameTest, SixteenBitAndFloatKeepFullScale) {
  const Frame reference(colours());
  cv::Mat wide, real;
  colours().convertTo(wide, CV_16U, 257);
  colours().convertTo(real, CV_32F, 1.0 / 255);
  EXPECT_TRUE(equal(Frame(wide).bgr(), reference.bgr()));
  EXPECT_TRUE(equal(Frame(wide).gray(), reference.gray()));
  EXPECT_TRUE(equal(Frame(real).bgr(), reference.bgr()));
  cv::Mat gray16, gray32;
  reference.gray().convertTo(gray16, CV_16U, 257);
  reference.gray().convertTo(gray32, CV_32F, 1.0 / 255);
  EXPECT_TRUE(equal(Frame(gray16).gray(), reference.gray()));
  EXPECT_TRUE(equal(Frame(gray32).gray(), reference.gray()));
}

TEST(FrameTest, FloatSaturates) {
  const cv::Mat image = (cv::Mat_<float>(1, 3) << -0.5f, 0.5f, 1e30f);
  const Frame frame(image);
  EXPECT_EQ(frame.gray().at<uchar>(0, 0), 0);
  EXPECT_NEAR(frame.gray().at<uchar>(0, 1), 127.5, 0.5);
  EXPECT_EQ(frame.gray().at<uchar>(0, 2), 255);
}

TEST(FrameTest, RefusesBadImages) {
  EXPECT_THROW(Frame{cv::Mat()}, std::invalid_argument);
  EXPECT_THROW(Frame{cv::Mat(4, 4, CV_8UC2)}, std::invalid_argument);
  EXPECT_THROW(Frame{cv::Mat(4, 4, CV_64FC1)}, std::invalid_argument);
  EXPECT_THROW(Frame{cv::Mat(4, 4, CV_8SC3)}, std::invalid_argument);
  EXPECT_THROW(Frame{cv::Mat({3, 4, 5}, CV_8UC1)}, std::invalid_argument);
  using Limits = std::numeric_limits<float>;
  for (const float bad : {Limits::quiet_NaN(), Limits::infinity(), -Limits::infinity()}) {
    cv::Mat image(6, 6, CV_32FC3, cv::Scalar::all(0.5));
    image.at<cv::Vec3f>(5, 4)[2] = bad;
    EXPECT_THROW(Frame{image}, std::invalid_argument) << bad;
    EXPECT_THROW(Frame{image.colRange(2, 5)}, std::invalid_argument) << bad;
    EXPECT_NO_THROW(Frame{image.colRange(0, 4)}) << bad;
  }
}

TEST(FrameTest, ColourNeedsOnePixelThatHasIt) {
  cv::Mat image(40, 30, CV_8UC3, cv::Scalar::all(90));
  EXPECT_FALSE(Frame(image).has_colour());
  image.at<cv::Vec3b>(39, 29)[2] = 91;
  EXPECT_TRUE(Frame(image).has_colour());
  // A view of a larger image: the pixels beside it do not count.
  EXPECT_FALSE(Frame(image.colRange(0, 29)).has_colour());
  EXPECT_FALSE(Frame(cv::Mat(4, 4, CV_8UC1, cv::Scalar(9))).has_colour());
}

}  // namespace
