#pragma once

#include <asterism/parts/concept/response.hpp>
#include <asterism/parts/concept/state.hpp>
#include <asterism/parts/concept/template_window.hpp>
#include <asterism/parts/features/patch.hpp>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of Flow.
struct FlowOptions {
  /// Points on each side of the grid on the target, in [2, 100]; 10 x 10 points in Kalal et al.
  int grid = 10;
  /// Largest forward-backward error of a point that counts [template pixels], > 0.
  double max_error = 1;
  /// Side of the Lucas-Kanade window [template pixels], odd and in [3, 101], and the number of halvings of
  /// the image, in [0, 16].
  int lk_window = 11;
  int lk_levels = 3;
  /// The search window: padding in (0, 100], sides in [8, 1024].
  TemplateWindow window = {.padding = 1.5, .min_template_side = 32, .max_template_side = 64};
};

/// Median flow (Kalal, Mikolajczyk and Matas, ICPR 2010): a grid of points, each followed by pyramidal
/// Lucas-Kanade to where the target is searched, and back. A PartModel; copies are independent.
///
/// The displacement is the median, an axis each, over the better half of the points whose forward-backward
/// error is small enough; the peak the share of those points in all. It follows from one `adapt` to the next:
/// that replaces the image that the target is followed from, so what it learns is the last appearance alone.
/// Without any such point the peak is 0, the position that of the search and the covariance the window's.
class ASTERISM_API Flow {
 public:
  /// Throws std::invalid_argument for options out of range.
  explicit Flow(const FlowOptions& options = {});

  /// Follow a target of `size` [px] from `centre` [px].
  void init(const Frame& frame, const Point2& centre, const Size2& size);
  /// Follow it to this frame, starting at a position. The covariance is the scatter of the points about the
  /// median and that of their forward-backward errors.
  Evidence localize(const Frame& frame, const Point2& around);
  /// Follow the target at a position in this frame from now on.
  void adapt(const Frame& frame, const Point2& at);

  double similarity_at(const Point2& position) const { return response_.at(position); }

  /// Visits what has been learned, for save_state.
  void visit_state(StateArchive& archive);

  const FlowOptions& options() const { return options_; }

 private:
  using Pyramid = std::vector<cv::Mat>;

  Size2 window() const { return spacing_ * Size2(cols_, rows_); }
  // What follows from the size.
  void prepare(const Size2& size);
  Pyramid sample(const Frame& frame, const Point2& centre);
  Pyramid pyramid(const cv::Mat& window) const;

  FlowOptions options_;
  Size2 size_ = Size2::Zero();       // of the target [px], 0 before init
  double spacing_ = 1;               // image pixels a template pixel
  int rows_ = 0, cols_ = 0;          // of the search window [template pixels]
  std::vector<cv::Point2f> points_;  // of the grid, in the window
  Pyramid learned_;                  // never written again: copies share it
  ResponsePeak response_;

  Scratch patch_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
