#pragma once

#include <asterism/parts/concept/part_model.hpp>
#include <asterism/parts/concept/state.hpp>
#include <asterism/parts/concept/template_window.hpp>
#include <asterism/trackers/constellation/object_window.hpp>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of PointFlow.
struct PointFlowOptions {
  /// Largest forward-backward error of a point that counts [template pixels], > 0.
  double max_error = 1;
  /// Side of the Lucas-Kanade window, also that of the patch that is compared [template pixels, odd, in
  /// [3, 101]], and number of halvings of the image, in [0, 16].
  int lk_window = 11;
  int lk_levels = 4;
  /// The window about the object: padding in (0, 100], sides in [8, 1024].
  TemplateWindow window = {.padding = 2, .min_template_side = 48, .max_template_side = 128};
};

/// Many points of one object, each followed from frame to frame by pyramidal Lucas-Kanade and back (Kalal,
/// Mikolajczyk and Matas, ICPR 2010): one run for all of them, where Flow is a part by itself.
class ASTERISM_API PointFlow {
 public:
  /// Throws std::invalid_argument for options out of range.
  explicit PointFlow(const PointFlowOptions& options = {});

  /// Follow from this frame on, in the window of an object of `size` [px] at `centre` [px].
  void learn(const Frame& frame, const Point2& centre, const Size2& size);
  /// Where points of the learned frame (2 x N) [px] are in this one. The peak is the normalised
  /// cross-correlation of the patches there and here, 0 where that is negative and for a point that was not
  /// found, whose position is as given; the covariance that of Lucas-Kanade and of the forward-backward
  /// error.
  std::vector<Evidence> follow(const Frame& frame, const Eigen::Ref<const Eigen::Matrix2Xd>& points) const;

  /// The window of the last frame.
  const ObjectWindow& window() const { return window_; }

  /// Saves or takes over what `learn` learned, of the same centre and size.
  void visit_state(StateArchive& archive, const Point2& centre, const Size2& size);

 private:
  // What follows from centre and size.
  ObjectWindow window_of(const Point2& centre, const Size2& size) const;
  std::vector<cv::Mat> pyramid(const cv::Mat& window) const;

  PointFlowOptions options_;
  ObjectWindow window_;
  std::vector<cv::Mat> learned_;  // pyramid; never written again: copies share it
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
