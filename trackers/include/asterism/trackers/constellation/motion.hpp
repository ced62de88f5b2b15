#pragma once

#include <array>
#include <asterism/parts/concept/state.hpp>
#include <asterism/parts/concept/template_window.hpp>
#include <asterism/parts/models/color.hpp>
#include <asterism/trackers/constellation/object_window.hpp>
#include <cstdint>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of MotionModel.
struct MotionOptions {
  /// Rate of the histograms' autoregressive update, in [0, 1]; that of a running mean in the first frames.
  double histogram_rate = 0.05;
  /// Share of the object's pixels, and of those around it, whose speed is none that has been seen, in (0, 1):
  /// what suddenly moves is the object rather than what is around it.
  double novelty = 0.2;
  double background_novelty = 0.02;
  /// Prior probability of the foreground in Bayes' rule, in (0, 1).
  double foreground_prior = 0.5;
  /// The window about the object: padding in [1, 100], sides in [8, 1024].
  TemplateWindow window = {.padding = 3, .min_template_side = 16, .max_template_side = 32};
};

/// What moves otherwise than the camera: histograms of the speed of the object and of what is around it, as
/// ColorModel has them of colors, and the foreground posterior by Bayes' rule.
///
/// Speeds are those of a dense optical flow (Kroeger et al., *Fast Optical Flow using Dense Inverse Search*,
/// ECCV 2016) from the frame before, less a similarity that most of what is around the object follows. They
/// are counted in half octaves from 1/4 % of the object's mean side a frame. Where object and surroundings
/// move alike the histograms agree, and the posterior is the prior everywhere.
class ASTERISM_API MotionModel {
 public:
  /// Bins of a histogram.
  static constexpr int kBins = 16;

  /// Throws std::invalid_argument for options out of range.
  explicit MotionModel(const MotionOptions& options = {});
  /// Whether the library was built with OpenCV's video, without which there is no flow.
  static bool available();

  /// Start on a box, which is finite and of positive size. Throws std::logic_error where not `available()`.
  void init(const Frame& frame, const cv::Rect2d& box);
  /// The posterior in the window around the last box, of the motion since the last frame that `init`, this
  /// function or `adapt` has seen; empty until `adapt` has learned something. `informative` is not tested.
  Segmentation segment(const Frame& frame);
  /// Learn the speeds that `segment` saw in this frame: of the box where the object is now, and of twice the
  /// box without it. The next window is around this box.
  void adapt(const Frame& frame, const cv::Rect2d& box);

  /// Saves or takes over what was learned, of the object's last centre and size.
  void visit_state(StateArchive& archive, const Point2& centre, const Size2& size);

  const MotionOptions& options() const { return options_; }
  /// The histograms, each of sum 1 or, before anything was learned, 0.
  const std::array<double, kBins>& foreground() const { return foreground_; }
  const std::array<double, kBins>& background() const { return background_; }

 private:
  using Histogram = std::array<double, kBins>;
  // Frames beyond which the running mean no longer counts.
  static constexpr int kMostLearned = 1'000'000;
  void place(const Point2& centre, const Size2& size);
  // Of a pixel of the window, in the image.
  Point2 position(int row, int col) const;
  // Posterior of each bin.
  std::array<float, kBins> posterior() const;

  MotionOptions options_;
  Point2 centre_ = Point2::Zero();
  Size2 size_ = Size2::Ones();
  ObjectWindow window_;
  cv::Mat previous_;  // the window's pixels; never written again: copies share it
  Histogram foreground_{}, background_{};
  int learned_ = 0;  // frames, at most kMostLearned

  cv::Mat_<std::uint8_t> bins_;  // of the cells of the frame that `segment` saw; never written again
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
