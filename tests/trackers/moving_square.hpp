#pragma once

// A scene that every tracker can follow: a bright textured square that moves over a dim texture.

#include <cstdint>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace asterism {

inline cv::Mat noise(cv::Size size, int blur, double low, double high, std::uint64_t seed) {
  cv::Mat image(size, CV_8UC3);
  cv::RNG random(seed);
  random.fill(image, cv::RNG::UNIFORM, 0, 255);
  cv::GaussianBlur(image, image, {blur, blur}, 0);
  cv::normalize(image, image, low, high, cv::NORM_MINMAX);
  return image;
}

/// The object's box; frames count from 0.
inline cv::Rect2d true_box(int frame) { return {60.0 + 3 * frame, 50.0 + frame, 48, 40}; }

/// Draws a frame. `blur`: side of the Gaussian that smooths the square's texture [px], odd.
inline cv::Mat draw_frame(int frame, int blur = 5) {
  static const cv::Mat background = noise({320, 240}, 15, 20, 90, 1);
  cv::Mat image = background.clone();
  noise({48, 40}, blur, 100, 255, 2).copyTo(image(cv::Rect(true_box(frame))));
  return image;
}

}  // namespace asterism
