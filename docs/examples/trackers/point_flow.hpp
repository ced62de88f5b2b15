#pragma once

// Many points of one object, each followed to the next frame by pyramidal Lucas-Kanade and back (Kalal,
// Mikolajczyk and Matas, ICPR 2010), all at once in a window resampled to the object's scale.

#include <algorithm>
#include <asterism/parts/concept/part_model.hpp>
#include <asterism/trackers/constellation/object_window.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <vector>

class PointFlow {
 public:
  explicit PointFlow(const asterism::TemplateWindow& window) : options_(window) {}

  /// Makes this the frame to follow points from, in the window of an object of `size` [px] at `centre` [px].
  void learn(const asterism::Frame& frame, const asterism::Point2& centre, const asterism::Size2& size) {
    window_ = {centre, size, options_};
    learned_ = pyramid(window_.sample(frame));
  }

  /// The positions in this frame of points of the learned frame (2 x N) [px]. The peak is the normalised
  /// cross-correlation of the patches in both, or 0 if that is negative; for a point that is not found the
  /// peak is 0 and the position as given.
  std::vector<asterism::Evidence> follow(const asterism::Frame& frame, const Eigen::Matrix2Xd& points) const {
    const auto count = static_cast<std::size_t>(points.cols());
    std::vector<asterism::Evidence> result(count);
    if (count == 0) return result;
    const cv::Mat patch = window_.sample(frame);
    const std::vector<cv::Mat> seen = pyramid(patch);
    std::vector<cv::Point2f> from(count), forward, back;
    for (std::size_t i = 0; i < count; ++i)
      from[i] = window_.to_window(points.col(static_cast<Eigen::Index>(i)));
    std::vector<uchar> found, returned;
    cv::calcOpticalFlowPyrLK(learned_, seen, from, forward, found, {}, {kSide, kSide}, kLevels);
    cv::calcOpticalFlowPyrLK(seen, learned_, forward, back, returned, {}, {kSide, kSide}, kLevels);

    const cv::Rect2f inside({0, 0}, cv::Size2f(window_.grid()));
    for (std::size_t i = 0; i < count; ++i) {
      result[i].position = points.col(static_cast<Eigen::Index>(i));
      const double error = cv::norm(back[i] - from[i]);
      if (!found[i] || !returned[i] || error > kMaxError || !inside.contains(forward[i])) continue;
      const double variance = kConvergence * kConvergence + error * error;
      result[i].position = window_.to_image(forward[i]);
      result[i].covariance = window_.spacing() * window_.spacing() * variance * Eigen::Matrix2d::Identity();
      result[i].peak = std::max(0.0, correlation(learned_[0], from[i], patch, forward[i]));
    }
    return result;
  }

  /// The window of the last frame.
  const asterism::ObjectWindow& window() const { return window_; }

 private:
  static constexpr int kSide = 11, kLevels = 4;  // of Lucas-Kanade's window [window pixels]; halvings
  static constexpr double kMaxError = 1;         // forward-backward [window pixels]
  static constexpr double kConvergence = 0.3;    // deviation of a converged position [window pixels]

  static std::vector<cv::Mat> pyramid(const cv::Mat& window) {
    std::vector<cv::Mat> levels;
    cv::buildOpticalFlowPyramid(window, levels, {kSide, kSide}, kLevels);
    return levels;
  }
  // Normalised cross-correlation of the patches around two points, 0 if one is flat.
  static double correlation(const cv::Mat& a, const cv::Point2f& at, const cv::Mat& b,
                            const cv::Point2f& bt) {
    cv::Mat p, q;
    cv::getRectSubPix(a, {kSide, kSide}, at, p, CV_32F);
    cv::getRectSubPix(b, {kSide, kSide}, bt, q, CV_32F);
    p -= cv::mean(p), q -= cv::mean(q);
    const double product = cv::norm(p) * cv::norm(q);
    return product > 0 ? p.dot(q) / product : 0;
  }

  asterism::TemplateWindow options_;
  asterism::ObjectWindow window_;
  std::vector<cv::Mat> learned_;  // pyramid
};
