// The perturbations of made_video: a start that is slightly different, and images that are.
#include "made_videos.hpp"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <stdexcept>
#include <utility>

namespace asterism::bench {
namespace {

// Five frames of noise, which JPEG cannot keep, of an odd size; the object moves to the right.
Video noise() {
  Video video;
  cv::RNG random(3);
  for (int t = 0; t < 5; ++t) {
    cv::Mat image(41, 63, CV_8UC3);
    random.fill(image, cv::RNG::UNIFORM, 0, 256);
    video.push_back({image, cv::Rect2d(10 + t, 12, 20, 8)});
  }
  return video;
}

double difference(const cv::Mat& a, const cv::Mat& b) {
  return cv::norm(a, b, cv::NORM_L1) / static_cast<double>(a.total());
}

TEST(MadeVideos, TheStartBoxMovesByOnePixel) {
  const Video video = noise();
  const std::pair<const char*, cv::Point2d> steps[] = {
      {"left", {-1, 0}}, {"right", {1, 0}}, {"up", {0, -1}}, {"down", {0, 1}}};
  for (const auto& [kind, step] : steps) {
    const Video made = made_video(kind, video, {}, 60);
    ASSERT_EQ(made.size(), video.size());
    EXPECT_EQ(*made[0].truth, cv::Rect2d(cv::Point2d(10, 12) + step, cv::Size2d(20, 8))) << kind;
    for (std::size_t t = 0; t < video.size(); ++t) {
      if (t > 0) {
        EXPECT_EQ(*made[t].truth, *video[t].truth) << kind;
      }
      EXPECT_EQ(difference(made[t].image, video[t].image), 0) << kind;
    }
  }
  EXPECT_EQ(*video[0].truth, cv::Rect2d(10, 12, 20, 8)) << "the sequence itself has changed";
}

TEST(MadeVideos, ImagesAreCompressedAgain) {
  const Video video = noise(), fine = made_video("jpeg-95", video, {}, 60),
              coarse = made_video("jpeg-85", video, {}, 60);
  ASSERT_EQ(fine.size(), video.size());
  ASSERT_EQ(coarse.size(), video.size());
  const Video untouched = noise();
  for (std::size_t t = 0; t < video.size(); ++t) {
    ASSERT_EQ(fine[t].image.size(), video[t].image.size());
    ASSERT_EQ(fine[t].image.type(), CV_8UC3);
    EXPECT_EQ(*fine[t].truth, *video[t].truth);
    EXPECT_GT(difference(fine[t].image, video[t].image), 1);
    EXPECT_GT(difference(coarse[t].image, video[t].image), difference(fine[t].image, video[t].image));
    EXPECT_EQ(difference(video[t].image, untouched[t].image), 0) << "the sequence itself has changed";
  }
}

TEST(MadeVideos, OnlyKnownKinds) {
  for (const char* const kind : {"pass", "covered", "left", "jpeg-85"}) EXPECT_NO_THROW(check_kind(kind));
  for (const char* const kind : {"", "jpeg", "jpeg-84", "pass, covered", "lef"})
    EXPECT_THROW(check_kind(kind), std::invalid_argument) << kind;
}

}  // namespace
}  // namespace asterism::bench
