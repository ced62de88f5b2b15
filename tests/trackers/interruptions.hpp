#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

namespace asterism::testing {

/// A kind of interruption: `show` gives the image in place of frame i of n.
struct Interruption {
  std::string name;
  std::function<cv::Mat(const cv::Mat& clean, int i, int n)> show;
  bool blind;  ///< shows nothing of the scene, nor anything like an object
};

inline cv::Mat of_one_color(const cv::Mat& like, const cv::Scalar& color) {
  return cv::Mat(like.size(), like.type(), color);
}

/// Gaussian noise about gray, different in each frame.
inline cv::Mat gray_noise(const cv::Mat& like, double deviation, int seed) {
  cv::Mat wide(like.size(), CV_MAKETYPE(CV_32F, like.channels())), result;
  cv::RNG(static_cast<std::uint64_t>(seed) + 7).fill(wide, cv::RNG::NORMAL, 128, deviation);
  wide.convertTo(result, like.type());
  return result;
}

/// Eight color bars over a ramp and a grid.
inline cv::Mat test_card(const cv::Mat& like) {
  cv::Mat card(like.size(), CV_8UC3);
  for (int y = 0; y < card.rows; ++y)
    for (int x = 0; x < card.cols; ++x) {
      const int bar = 8 * x / card.cols;
      cv::Vec3b color(bar & 1 ? 0 : 191, bar & 4 ? 0 : 191, bar & 2 ? 0 : 191);
      if (3 * y > 2 * card.rows) color = cv::Vec3b::all(static_cast<std::uint8_t>(255 * x / card.cols));
      if (x % 40 == 0 || y % 40 == 0) color = cv::Vec3b::all(255);
      card.at<cv::Vec3b>(y, x) = color;
    }
  if (like.channels() == 1) cv::cvtColor(card, card, cv::COLOR_BGR2GRAY);
  return card;
}

inline cv::Mat scaled(const cv::Mat& clean, double gain, double offset = 0) {
  cv::Mat result;
  clean.convertTo(result, clean.type(), gain, offset);
  return result;
}

/// A frame whose part `missing`, which a decoder did not receive, is gray.
inline cv::Mat with_gray(const cv::Mat& clean, const cv::Rect& missing) {
  cv::Mat result = clean.clone();
  result(missing & cv::Rect({}, clean.size())).setTo(cv::Scalar::all(128));
  return result;
}

/// All kinds that are tested; add new ones here.
inline std::vector<Interruption> interruptions() {
  const auto one_color = [](const cv::Scalar& color) {
    return [color](const cv::Mat& clean, int, int) { return of_one_color(clean, color); };
  };
  const auto noise = [](double deviation) {
    return [deviation](const cv::Mat& clean, int i, int) { return gray_noise(clean, deviation, i); };
  };
  return {
      {"gray", one_color(cv::Scalar::all(128)), true},
      {"black", one_color(cv::Scalar::all(0)), true},
      {"white", one_color(cv::Scalar::all(255)), true},
      {"blue", one_color(cv::Scalar(255, 0, 0)), true},
      {"faint_noise", noise(2), true},
      {"noise", noise(20), true},
      {"strong_noise", noise(60), true},
      {"test_card", [](const cv::Mat& clean, int, int) { return test_card(clean); }, false},
      {"fade_to_black_and_back",
       [](const cv::Mat& clean, int i, int n) {
         return scaled(clean, std::abs(2.0 * i / std::max(1, n - 1) - 1));
       },
       false},
      {"flash", [](const cv::Mat& clean, int, int) { return scaled(clean, 4, 60); }, false},
      {"gray_lower_half",
       [](const cv::Mat& clean, int, int) {
         return with_gray(clean, {0, clean.rows / 2, clean.cols, clean.rows});
       },
       false},
      {"gray_left_half",
       [](const cv::Mat& clean, int, int) {
         return with_gray(clean, {0, 0, clean.cols / 2, clean.rows});
       },
       false},
  };
}

}  // namespace asterism::testing
