#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <map>
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

/// The lower half above the upper one.
inline cv::Mat rolled(const cv::Mat& clean) {
  cv::Mat result;
  cv::vconcat(clean.rowRange(clean.rows / 2, clean.rows), clean.rowRange(0, clean.rows / 2), result);
  return result;
}

/// The frame twice, one above the other, each of half its height.
inline cv::Mat doubled(const cv::Mat& clean) {
  cv::Mat upper, lower, result;
  cv::resize(clean, upper, {clean.cols, clean.rows / 2}, 0, 0, cv::INTER_AREA);
  cv::resize(clean, lower, {clean.cols, clean.rows - upper.rows}, 0, 0, cv::INTER_AREA);
  cv::vconcat(upper, lower, result);
  return result;
}

/// A station's logo over the middle of the frame.
inline cv::Mat with_logo(const cv::Mat& clean) {
  cv::Mat result = clean.clone();
  const cv::Point middle(clean.cols / 2, clean.rows / 2);
  const int radius = std::min(clean.rows, clean.cols) / 4;
  cv::circle(result, middle, radius, {180, 60, 20}, cv::FILLED);
  cv::circle(result, middle, 3 * radius / 4, {255, 255, 255}, cv::FILLED);
  const cv::Point corner(radius / 2, radius / 6);
  cv::rectangle(result, middle - corner, middle + corner, {40, 40, 200}, cv::FILLED);
  return result;
}

/// The rows from `row` on repeat it, as where a decoder lost the rest of a frame.
inline cv::Mat smeared(const cv::Mat& clean, int row) {
  cv::Mat result = clean.clone();
  cv::repeat(clean.row(row), clean.rows - row, 1, result.rowRange(row, clean.rows));
  return result;
}

/// Black bars at the top and the bottom, each of an eighth of the height.
inline cv::Mat letterboxed(const cv::Mat& clean) {
  cv::Mat result = clean.clone();
  const int bar = clean.rows / 8;
  result.rowRange(0, bar).setTo(cv::Scalar::all(0));
  result.rowRange(clean.rows - bar, clean.rows).setTo(cv::Scalar::all(0));
  return result;
}

inline cv::Mat inverted(const cv::Mat& clean) {
  cv::Mat result;
  cv::bitwise_not(clean, result);
  return result;
}

/// Frame i of another video, in which the camera moves; the seed says which video.
inline cv::Mat other_video(const cv::Mat& like, int i, std::uint64_t seed) {
  static std::map<std::uint64_t, cv::Mat> scenes;
  cv::Mat& scene = scenes[seed];
  if (scene.rows != like.rows + 120 || scene.cols != like.cols + 120 || scene.type() != like.type()) {
    scene = cv::Mat(like.rows + 120, like.cols + 120, like.type());
    cv::RNG(seed).fill(scene, cv::RNG::UNIFORM, 0, 255);
    cv::GaussianBlur(scene, scene, {95, 95}, 0);
    cv::normalize(scene, scene, 0, 255, cv::NORM_MINMAX);
  }
  return scene(cv::Rect({2 * (i % 60), i % 60}, like.size())).clone();
}

/// All kinds that are tested; add new ones here.
inline std::vector<Interruption> interruptions() {
  const auto of_scene = [](cv::Mat (*change)(const cv::Mat&)) {
    return [change](const cv::Mat& clean, int, int) { return change(clean); };
  };
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
      {"inverted", of_scene(inverted), false},
      {"rolled", of_scene(rolled), false},
      {"doubled", of_scene(doubled), false},
      {"logo", of_scene(with_logo), false},
      {"smear", [](const cv::Mat& clean, int, int) { return smeared(clean, clean.rows / 4); }, false},
      {"letterbox", of_scene(letterboxed), false},
      {"other_video", [](const cv::Mat& clean, int i, int) { return other_video(clean, i, 11); }, false},
  };
}

}  // namespace asterism::testing
