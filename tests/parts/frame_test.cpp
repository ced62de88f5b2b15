#include <gtest/gtest.h>

#include <asterism/parts/concept/frame.hpp>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <stdexcept>
#include <string>

namespace {

using asterism::box_around;
using asterism::centre_of;
using asterism::first_frame;
using asterism::Frame;
using asterism::PixelRange;
using asterism::Point2;
using asterism::Size2;
using asterism::suggested_range;

bool equal(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() && cv::norm(a, b, cv::NORM_INF) == 0;
}

cv::Mat colors() {
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
  const cv::Mat bgr = colors();
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
  cv::cvtColor(colors(), bgra, cv::COLOR_BGR2BGRA);
  bgra.at<cv::Vec4b>(0, 0)[3] = 0;
  EXPECT_TRUE(equal(Frame(bgra).bgr(), colors()));
}

TEST(FrameTest, SixteenBitAndFloatKeepFullScale) {
  const Frame reference(colors());
  cv::Mat wide, real;
  colors().convertTo(wide, CV_16U, 257);
  colors().convertTo(real, CV_32F, 1.0 / 255);
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
  const cv::Mat image = (cv::Mat_<float>(1, 3) << -0.5f, 0.5f, 1.5f);
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

// One line per kind of pixels: how colors() in 8 bits is converted, whether Frame accepts it, in general and
// as a first frame, and the range that is suggested.
struct Kind {
  const char* name;
  int depth;
  double scale, shift;  // applied to the 8-bit values
  bool taken, taken_at_start;
  std::optional<PixelRange> suggested, right;  // `right` restores the 8-bit values
};

void PrintTo(const Kind& kind, std::ostream* out) { *out << kind.name; }

class PixelKinds : public testing::TestWithParam<Kind> {};

TEST_P(PixelKinds, AreTakenOrRefusedAndScaled) {
  const Kind& kind = GetParam();
  cv::Mat reference = colors();  // contains both ends of the range
  reference.at<cv::Vec3b>(0, 0) = {0, 0, 0};
  reference.at<cv::Vec3b>(4, 6) = {255, 255, 255};
  for (const int channels : {1, 3, 4}) {
    SCOPED_TRACE(channels);
    cv::Mat expected, image;
    cv::cvtColor(reference, expected, cv::COLOR_BGR2GRAY);
    if (channels != 1) expected = reference;
    expected.convertTo(image, kind.depth, kind.scale, kind.shift);
    // An opaque alpha is the largest value of the type: it must not affect the range of the colors.
    if (channels == 4) {
      cv::cvtColor(image, image, cv::COLOR_BGR2BGRA);
      cv::Mat alpha(image.size(), kind.depth, cv::Scalar(kind.depth == CV_32F ? 1 : 65535));
      cv::insertChannel(alpha, image, 3);
    }
    if (kind.taken)
      EXPECT_NO_THROW(Frame{image});
    else
      EXPECT_THROW(Frame{image}, std::invalid_argument);
    if (kind.taken_at_start)
      EXPECT_NO_THROW(first_frame(image));
    else
      EXPECT_THROW(first_frame(image), std::invalid_argument);
    const std::optional<PixelRange> suggested = suggested_range(image);
    ASSERT_EQ(suggested.has_value(), kind.suggested.has_value());
    if (suggested) {
      EXPECT_NEAR(suggested->black, kind.suggested->black, 1e-6);
      EXPECT_FLOAT_EQ(float(suggested->white), float(kind.suggested->white));
    }
    const Frame frame(image, kind.right);
    EXPECT_LE(cv::norm(channels == 1 ? frame.gray() : frame.bgr(), expected, cv::NORM_INF),
              kind.scale == 0.5 ? 1 : 0);
  }
}

const std::optional<PixelRange> kNone;
INSTANTIATE_TEST_SUITE_P(
    Frame, PixelKinds,
    testing::Values(
        Kind{"EightBit", CV_8U, 1, 0, true, true, kNone, kNone},
        Kind{"EightBitWithAWindow", CV_8U, 0.5, 20, true, true, kNone, PixelRange{20, 147.5}},
        Kind{"SixteenBit", CV_16U, 257, 0, true, true, kNone, kNone},
        Kind{"EightBitInSixteen", CV_16U, 1, 0, true, false, PixelRange::of_bits(8), PixelRange::of_bits(8)},
        Kind{"TenBitInSixteen", CV_16U, 1023.0 / 255, 0, true, true, PixelRange::of_bits(10),
             PixelRange::of_bits(10)},
        Kind{"TwelveBitInSixteen", CV_16U, 4095.0 / 255, 0, true, true, PixelRange::of_bits(12),
             PixelRange::of_bits(12)},
        Kind{"FourteenBitInSixteen", CV_16U, 16383.0 / 255, 0, true, true, PixelRange::of_bits(14),
             PixelRange::of_bits(14)},
        Kind{"ThermalInSixteen", CV_16U, 2, 7000, true, true, PixelRange::of_bits(14),
             PixelRange{7000, 7510}},
        Kind{"Float", CV_32F, 1.0 / 255, 0, true, true, kNone, kNone},
        Kind{"FloatThatOvershoots", CV_32F, 1.2 / 255, -0.1, true, true, kNone, PixelRange{-0.1, 1.1}},
        Kind{"FloatFromEightBit", CV_32F, 1, 0, false, false, PixelRange::of_bits(8), PixelRange::of_bits(8)},
        Kind{"FloatFromTwelveBit", CV_32F, 4095.0 / 255, 0, false, false, PixelRange::of_bits(12),
             PixelRange::of_bits(12)},
        Kind{"FloatFromSixteenBit", CV_32F, 257, 0, false, false, PixelRange::of_bits(16),
             PixelRange::of_bits(16)},
        Kind{"FloatAroundZero", CV_32F, 2.0 / 255, -1, false, false, PixelRange{-1, 1}, PixelRange{-1, 1}},
        Kind{"FloatOfEightInSixteen", CV_32F, 1.0 / 65535, 0, true, false, PixelRange{0, 255.0 / 65535},
             PixelRange{0, 255.0 / 65535}},
        Kind{"FloatFarOut", CV_32F, 1e30 / 255, 0, false, false, PixelRange{0, 1e30}, PixelRange{0, 1e30}}),
    [](const auto& instance) { return std::string(instance.param.name); });

TEST(FrameTest, ARangeClipsWhatIsBeyondIt) {
  const cv::Mat wide = (cv::Mat_<std::uint16_t>(1, 5) << 0, 1000, 1500, 2000, 65535);
  cv::Mat real;
  wide.convertTo(real, CV_32F);
  for (const cv::Mat& image : {wide, real}) {
    const Frame frame(image, PixelRange::of_window(1500, 1000));
    EXPECT_EQ(frame.gray().at<uchar>(0, 0), 0);
    EXPECT_EQ(frame.gray().at<uchar>(0, 1), 0);
    EXPECT_NEAR(frame.gray().at<uchar>(0, 2), 127.5, 0.5);
    EXPECT_EQ(frame.gray().at<uchar>(0, 3), 255);
    EXPECT_EQ(frame.gray().at<uchar>(0, 4), 255);
    EXPECT_EQ(Frame(image, PixelRange{-1e30, 1e-20}).gray().at<uchar>(0, 4), 255);
    EXPECT_EQ(Frame(image, PixelRange{0, 1e30}).gray().at<uchar>(0, 4), 0);
    const double inf = std::numeric_limits<double>::infinity(), nan = std::nan("");
    for (const PixelRange& bad :
         {PixelRange{1, 1}, {2, 1}, {0, nan}, {nan, 1}, {0, inf}, {-inf, 0}, {0, 1e-7}})
      EXPECT_THROW(Frame(image, bad), std::invalid_argument) << bad.black << " to " << bad.white;
  }
}

// Later frames may be black, with the sensor's noise; a first frame may not, as a black image has no range.
TEST(FrameTest, ABlackSixteenBitFrameIsTaken) {
  EXPECT_NO_THROW(Frame{cv::Mat(4, 4, CV_16UC1, cv::Scalar(90))});
  EXPECT_NO_THROW(first_frame(cv::Mat(4, 4, CV_16UC1, cv::Scalar(0))));
  EXPECT_FALSE(suggested_range(cv::Mat(4, 4, CV_16UC1, cv::Scalar(0))));
  EXPECT_FALSE(suggested_range(cv::Mat(4, 4, CV_64FC1, cv::Scalar(9))));
  EXPECT_FALSE(suggested_range(cv::Mat(4, 4, CV_32FC1, cv::Scalar(std::nan("")))));
}

TEST(FrameTest, SaysWhyItRefuses) {
  cv::Mat real;
  colors().convertTo(real, CV_32F);
  const auto reason = [](const cv::Mat& image) {
    try {
      first_frame(image);
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_NE(reason(real).find("float pixels must be in [0, 1] and are in ["), std::string::npos)
      << reason(real);
  cv::Mat narrow;
  colors().convertTo(narrow, CV_16U);
  EXPECT_NE(reason(narrow).find("at most 255"), std::string::npos) << reason(narrow);
  real.convertTo(real, CV_64F);
  EXPECT_NE(reason(real).find("8 or 16 bit unsigned or float"), std::string::npos) << reason(real);
}

TEST(FrameTest, ColorNeedsOnePixelThatHasIt) {
  cv::Mat image(40, 30, CV_8UC3, cv::Scalar::all(90));
  EXPECT_FALSE(Frame(image).has_color());
  image.at<cv::Vec3b>(39, 29)[2] = 91;
  EXPECT_TRUE(Frame(image).has_color());
  // A view of a larger image: the pixels beside it do not count.
  EXPECT_FALSE(Frame(image.colRange(0, 29)).has_color());
  EXPECT_FALSE(Frame(cv::Mat(4, 4, CV_8UC1, cv::Scalar(9))).has_color());
}

}  // namespace
