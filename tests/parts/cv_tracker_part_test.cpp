#include <gtest/gtest.h>

#include <asterism/parts/concept/part_options.hpp>
#include <asterism/parts/models/cv_tracker_part.hpp>
#include <asterism/testing/part_axioms.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace asterism {
namespace {

// A cv::Tracker that is simple and exact: it finds the shift at which the window's middle matches best.
class Matcher : public cv::Tracker {
 public:
  void init(cv::InputArray image, const cv::Rect& box) override {
    EXPECT_EQ(image.type(), CV_8UC3);
    box_ = box;
    image.getMat()(box).copyTo(template_);
  }
  bool update(cv::InputArray image, cv::Rect& box) override {
    cv::Mat distance;
    cv::matchTemplate(image, template_, distance, cv::TM_SQDIFF_NORMED);
    double least = 0;
    cv::Point at;
    cv::minMaxLoc(distance, &least, nullptr, &at);
    if (least > 0.05) return false;
    box_ = box = {at, box_.size()};
    return true;
  }

 private:
  cv::Mat template_;
  cv::Rect box_;
};

CvTrackerPart part(const CvTrackerPartOptions& options = {}) {
  return CvTrackerPart([] { return cv::makePtr<Matcher>(); }, options);
}

TEST(CvTrackerPart, FulfilsThePartAxioms) { testing::check_part_axioms(part()); }
TEST(CvTrackerPart, WithstandsFaults) { testing::check_part_faults(part()); }

TEST(CvTrackerPart, FindsAShiftedTexture) {
  const cv::Mat image = testing::texture(240, 320);
  CvTrackerPart tested = part();
  tested.init(Frame(image), {160, 120}, {48, 40});
  for (const auto& [dx, dy] : {std::pair{1, 0}, {-3, 2}, {5, -7}, {20, 15}}) {
    const cv::Mat moved = testing::shifted(image, dx, dy);
    const Evidence evidence = tested.localize(Frame(moved), {160, 120});
    EXPECT_LT((evidence.position - Point2(160 + dx, 120 + dy)).norm(), 1e-9) << dx << ", " << dy;
    EXPECT_EQ(evidence.peak, 1);
    EXPECT_NEAR(std::sqrt(evidence.covariance(0, 0)), 0.05 * std::sqrt(48 * 40), 1e-9);
  }
}

// In a downsampled window one pixel spans several of the image.
TEST(CvTrackerPart, LargeTargetsAreResampled) {
  const cv::Mat image = testing::texture(480, 640);
  CvTrackerPart tested = part({.window = {.padding = 1, .min_template_side = 16, .max_template_side = 32}});
  tested.init(Frame(image), {320, 240}, {160, 120});
  const Evidence evidence = tested.localize(Frame(testing::shifted(image, 12, -8)), {320, 240});
  EXPECT_LT((evidence.position - Point2(332, 232)).norm(), std::sqrt(160 * 120) / 32);
  EXPECT_EQ(evidence.peak, 1);
}

TEST(CvTrackerPart, SaysWhereTheTrackerFindsNothing) {
  CvTrackerPart tested = part();
  tested.init(Frame(testing::texture(240, 320)), {160, 120}, {48, 40});
  const Evidence evidence =
      tested.localize(Frame(cv::Mat(240, 320, CV_8UC3, cv::Scalar(9, 9, 9))), {150, 110});
  EXPECT_EQ(evidence.peak, 0);
  EXPECT_EQ(evidence.position, Point2(150, 110));
  EXPECT_TRUE(evidence.covariance.allFinite());
}

TEST(CvTrackerPart, LearnsOnlyIfAdaptive) {
  const cv::Mat first = testing::texture(240, 320, 1), other = testing::texture(240, 320, 2);
  for (const bool adaptive : {false, true}) {
    CvTrackerPart tested = part({.adaptive = adaptive});
    tested.init(Frame(first), {160, 120}, {48, 40});
    tested.adapt(Frame(other), {160, 120});
    EXPECT_EQ(tested.localize(Frame(other), {160, 120}).peak, adaptive ? 1 : 0);
    EXPECT_EQ(tested.localize(Frame(first), {160, 120}).peak, adaptive ? 0 : 1);
  }
}

TEST(CvTrackerPart, FollowsAGrownTarget) {
  const cv::Mat image = testing::texture(240, 320);
  CvTrackerPart tested = part();
  tested.init(Frame(image), {160, 120}, {48, 40});
  cv::Mat grown;  // twice as large about the target's centre
  cv::warpAffine(image, grown, cv::Matx23d(2, 0, -160, 0, 2, -120), image.size());
  tested.resize({96, 80});
  const Evidence evidence = tested.localize(Frame(grown), {163, 118});
  EXPECT_EQ(evidence.peak, 1);
  EXPECT_LT((evidence.position - Point2(160, 120)).norm(), 2);
}

TEST(CvTrackerPart, RefusesWhatItCannotUse) {
  EXPECT_THROW(CvTrackerPart(nullptr), std::invalid_argument);
  EXPECT_THROW(part({.deviation = 0}), std::invalid_argument);
  EXPECT_THROW(part({.window = {.padding = 1, .min_template_side = 64, .max_template_side = 32}}),
               std::invalid_argument);
  CvTrackerPart without([] { return cv::Ptr<cv::Tracker>(); });
  without.init(Frame(testing::texture(240, 320)), {160, 120}, {48, 40});
  EXPECT_THROW(without.localize(Frame(testing::texture(240, 320)), {160, 120}), std::runtime_error);
}

}  // namespace
}  // namespace asterism
