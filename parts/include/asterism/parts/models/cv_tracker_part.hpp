#pragma once

#include <asterism/parts/concept/part_options.hpp>
#include <asterism/parts/concept/response.hpp>
#include <asterism/parts/concept/template_window.hpp>
#include <asterism/solver/run/option_visitor.hpp>
#include <functional>
#include <opencv2/video/tracking.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of CvTrackerPart.
struct CvTrackerPartOptions {
  /// Standard deviation of the position on each axis, as a share of the geometric mean of the target's sides,
  /// in [1e-6, 10]: an OpenCV tracker does not tell it.
  double deviation = 0.05;
  /// Whether `adapt` replaces the appearance that the target is followed from. If not, it is that of `init`
  /// for good.
  bool adaptive = true;
  /// The window that the tracker sees: padding in (0, 100], sides in [8, 1024].
  TemplateWindow window = {.padding = 3, .min_template_side = 16, .max_template_side = 128};
};

/// A part that one of OpenCV's trackers follows (cv::Tracker: CSRT, KCF, MIL, and those with networks:
/// GOTURN, DaSiamRPN, and Nano and Vit where OpenCV has them). A PartModel and ResizableModel.
///
/// A cv::Tracker learns while it localizes, cannot be copied, and reports whole pixels. So that a part's
/// axioms hold, the part keeps the window that it learned last, and each `localize` starts a tracker on that
/// window and updates it once on the window around the position that is searched. The tracker's memory of
/// earlier frames is therefore not used. It sees BGR windows with the target in their middle.
class ASTERISM_API CvTrackerPart {
 public:
  /// Makes the tracker that `localize` uses. It may return the same object each time, which saves loading a
  /// network again, if that object's `init` forgets what it saw before; copies of the part then share it and
  /// must not be used in several threads at once.
  using Factory = std::function<cv::Ptr<cv::Tracker>()>;

  /// Throws std::invalid_argument for an empty factory and for options out of range.
  explicit CvTrackerPart(Factory create, const CvTrackerPartOptions& options = {});

  /// Follow a target of `size` [px] from `centre` [px].
  void init(const Frame& frame, const Point2& centre, const Size2& size);
  /// Peak 1 where the tracker reports the target, to a whole pixel of the window. Otherwise peak 0 at
  /// `around`, with the window's covariance. Passes on what the factory and the tracker throw, and throws
  /// std::runtime_error if the factory returns null.
  Evidence localize(const Frame& frame, const Point2& around);
  /// A Gaussian about the position of the last `localize`; see ResponsePeak.
  double similarity_at(const Point2& position) const { return response_.at(position); }
  /// Follow the target from a position in this frame from now on, if `adaptive`.
  void adapt(const Frame& frame, const Point2& at);
  /// See ResizableModel; the window that was learned keeps its pixels.
  void resize(const Size2& size);

  /// The options that the part was made with.
  const CvTrackerPartOptions& options() const { return options_; }

 private:
  Size2 window() const { return spacing_.cwiseProduct(Size2(cols_, rows_)); }
  // The window around a position, a matrix of its own.
  cv::Mat sample(const Frame& frame, const Point2& centre) const;

  Factory create_;
  CvTrackerPartOptions options_;
  Size2 size_ = Size2::Zero();     // of the target [px], 0 before init
  Size2 spacing_ = Size2::Ones();  // image pixels a window pixel
  int rows_ = 0, cols_ = 0;        // of the window
  cv::Rect target_;                // in its middle
  cv::Mat learned_;                // BGR, never written again: copies share it
  ResponsePeak response_;
};

/// The options by name.
inline void visit_options(OptionVisitor& visit, CvTrackerPartOptions& options) {
  visit("deviation", options.deviation, {1e-6, 10});
  visit("adaptive", options.adaptive);
  visit_window(visit, options.window, option_ranges::kSearchPadding, {8, option_ranges::kLongestSide});
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
