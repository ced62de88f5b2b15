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
  /// Rate of the histograms' autoregressive update, in [0, 1]; in the first frames, that of a running mean.
  double histogram_rate = 0.05;
  /// Share of the object's pixels that is assumed to move at a speed not seen before, in (0, 1).
  double novelty = 0.2;
  /// The same share of the pixels around the object, in (0, 1). It is less than `novelty`, because what
  /// suddenly moves is more likely the object.
  double background_novelty = 0.02;
  /// Prior probability of the foreground in Bayes' rule, in (0, 1).
  double foreground_prior = 0.5;
  /// The window around the object: padding in [1, 100], sides in [8, 1024].
  TemplateWindow window = {.padding = 3, .min_template_side = 16, .max_template_side = 32};
};

/// Finds pixels that move differently from the camera: histograms of the speeds of the object and of its
/// surroundings, like those of colors in ColorModel, and the foreground posterior by Bayes' rule.
///
/// Speeds come from the dense optical flow (Kroeger et al., *Fast Optical Flow using Dense Inverse Search*,
/// ECCV 2016) since the last frame, after subtracting the similarity transform that most of the surroundings
/// follow. Bins are half octaves, from 1/4 % of the object's mean side per frame upwards. If object and
/// surroundings move alike, the histograms agree, and the posterior is the prior everywhere.
class ASTERISM_API MotionModel {
 public:
  /// Bins of a histogram.
  static constexpr int kBins = 16;

  /// Throws std::invalid_argument for options out of range.
  explicit MotionModel(const MotionOptions& options = {});
  /// Whether the library was built with OpenCV's video module, which computes the flow.
  static bool available();

  /// Start on a box, which is finite and of positive size. Throws std::logic_error unless `available()`.
  void init(const Frame& frame, const cv::Rect2d& box);
  /// The posterior in the window around the last box, from the motion since the last frame that was given to
  /// `init`, `segment` or `adapt`; empty until `adapt` has learned something. Does not set `informative`.
  Segmentation segment(const Frame& frame);
  /// Learn the speeds that `segment` found in this frame: inside the object's present box, and in the box of
  /// twice its size around it. The next window is around this box.
  void adapt(const Frame& frame, const cv::Rect2d& box);

  /// Saves or restores what was learned, for an object of this last centre and size.
  void visit_state(StateArchive& archive, const Point2& centre, const Size2& size);

  const MotionOptions& options() const { return options_; }
  /// The histograms, each of sum 1 or, before anything was learned, 0.
  const std::array<double, kBins>& foreground() const { return foreground_; }
  const std::array<double, kBins>& background() const { return background_; }

 private:
  using Histogram = std::array<double, kBins>;
  // The running mean counts no more frames than this.
  static constexpr int kMostLearned = 1'000'000;
  void place(const Point2& centre, const Size2& size);
  // Image position of a pixel of the window.
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
