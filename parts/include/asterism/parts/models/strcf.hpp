#pragma once

#include <asterism/parts/concept/response.hpp>
#include <asterism/parts/concept/state.hpp>
#include <asterism/parts/concept/template_window.hpp>
#include <asterism/parts/features/aligned.hpp>
#include <asterism/parts/features/cell_spectra.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of Strcf; the defaults are those of Li et al. (CVPR 2018) and of their published program, except
/// for the color channels.
struct StrcfOptions {
  /// The channels. Li et al. use the gray level, fHOG and, in color video, ten learned color names; a and b
  /// of CIE Lab replace the color names here.
  CellFeatures features = {.hog = true, .gray = true, .color = true};
  /// Weight mu of the difference from the filter of the frame before, in [0, 1e6]. The first frame has none.
  double temporal_weight = 15;
  /// The spatial weight w of the filter's cells on the target, in [0, 1e6].
  double target_weight = 1e-3;
  /// The spatial weight w of all other cells, which are background, in [0, 1e6].
  double background_weight = 1e5;
  /// Rounds of the alternating direction method of multipliers in a frame, in [1, 100].
  int admm_iterations = 2;
  /// Penalty gamma of the first round, in [1e-6, 1e6].
  double penalty = 1;
  /// Factor by which the penalty grows from round to round, in [1, 1e6].
  double penalty_growth = 10;
  /// Upper bound of the penalty after the first round, in [1e-6, 1e6]. The published bound is less than the
  /// first penalty, so later rounds bind less.
  double max_penalty = 0.1;
  /// Standard deviation of the Gaussian label y, as a fraction of the target's geometric mean side, > 0.
  double label_sigma = 1.0 / 16;
  /// HOG cell [template pixels]. A window has no more than 256 cells on each axis.
  int cell_size = 4;
  /// The search window: padding in [0, 100], sides in [cell_size, 1024].
  TemplateWindow window = {.padding = 4, .min_template_side = 30, .max_template_side = 40};
  /// Refine the response's maximum below the cell grid.
  bool sub_pixel = true;
};

/// The spatial-temporal regularised correlation filter (Li, Tian, Zuo, Zhang, Yang, *Learning
/// spatial-temporal regularized correlation filters for visual tracking*, CVPR 2018). A PartModel, meant for
/// the root of a tracker; copies are independent.
///
/// With x_d the channels of the window's T cells under a Hann window, y a Gaussian label and * the circular
/// correlation, the filters f_d of a frame minimise
///
///     1/(2T) |sum_d f_d * x_d - y|^2 + 1/2 sum_d |w f_d|^2 + mu/2 sum_d |f_d - f_d^prev|^2
///
/// (the mean over the T shifts is how the published weights are meant). The spatial weight
/// w is next to nothing on the target and next to infinite elsewhere: the window can be several times as
/// large as the target and train the filter with much background. The temporal term takes the place of a
/// running average: a frame changes the filter as little as it has to. No sample is kept.
///
/// A few rounds of the alternating direction method of multipliers, with f = g, multiplier h and penalty
/// gamma, take f bin by bin in closed form, g cell by cell, and h += gamma (f - g):
///
///     (x x^H + T (gamma + mu) I) f = x y + T (gamma g - h + mu f^prev),  g = (gamma f + h) / (w^2 + gamma)
///
/// The filter is f after the last round, which is only nearly zero outside the target. So few rounds from
/// zero fit the label only in part: the response is divided by what it was for the samples (`fit`), so that
/// the peak is about 1 for a perfect match.
///
/// Once it has been initialised, `localize` and `adapt` do not allocate, except for color channels. One
/// object is for one thread at a time, different ones are independent.
class ASTERISM_API Strcf {
 public:
  /// Throws std::invalid_argument for options out of range.
  explicit Strcf(const StrcfOptions& options = {});

  /// Learn a target of `size` [px] at `centre` [px].
  void init(const Frame& frame, const Point2& centre, const Size2& size);
  /// Search the window around a position. Keeps the response map for `response` and `similarity_at`. A window
  /// of one gray level and color has no response.
  Evidence localize(const Frame& frame, const Point2& around);
  /// Update the filter with the appearance at a position. A window of one gray level and color teaches
  /// nothing.
  void adapt(const Frame& frame, const Point2& at);

  double similarity_at(const Point2& position) const { return response_.at(position); }
  /// The response map of the last `localize`.
  const ResponseMap& response() const { return response_; }

  /// The target's size in the image [px], and that of its search window.
  const Size2& size() const { return size_; }
  Size2 window() const {
    return scale_.cwiseProduct(Size2(sample_.cols(), sample_.rows())) * options_.cell_size;
  }
  /// Let the target have another size in the image from now on: the window is stretched alike, the template
  /// stays.
  void resize(const Size2& size);

  /// Number of channels of a cell.
  int channels() const { return sample_.channels(); }
  /// A channel's filter over the window's cells, rows x cols, row-major, for drawings and tests: its
  /// correlation with the sample is the response, except for the division by `fit`. Needs an `init` before;
  /// throws std::invalid_argument for a channel out of range.
  Eigen::Array<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> filter(int channel) const;
  /// The divisor of the responses: the response to a sample that was learned, at zero shift. A larger
  /// one takes its place at once; towards smaller ones it decays at the rate 1 / (1 + mu). Where it is not
  /// positive there is no response.
  double fit() const { return fit_; }

  /// Visits what has been learned, for save_state, but not the response of the last `localize`.
  void visit_state(StateArchive& archive);

  const StrcfOptions& options() const { return options_; }

 private:
  using Plan = CellSpectra::Plan;

  // All that follows from the target's size in the first frame: what `init` makes, except the model.
  void prepare(const Size2& size);
  // 1 / (w^2 + penalty), cell by cell, in `constraint_`.
  void weigh_cells(double penalty);
  // The filter of the sample in `sample_`, near `previous_` with weight `temporal`; returns the sample's
  // response to it.
  double regress(double temporal);

  StrcfOptions options_;
  Size2 size_ = Size2::Zero(), initial_size_ = Size2::Zero();
  Size2 scale_ = Size2::Ones(), initial_scale_ = Size2::Ones();  // image pixels a template pixel
  CellSpectra sample_;   // x, the windowed features of the last window, and their spectra
  AlignedFloats label_;  // y, whose spectrum is real
  // The target's cells are those from first to end.
  int first_row_ = 0, end_row_ = 0, first_col_ = 0, end_col_ = 0;
  AlignedFloats filter_, previous_;  // f, and that of the frame before
  double fit_ = 0;
  ResponseMap response_;

  // Buffers of localize and adapt, sized by init; part_kernels.hpp has their layout.
  AlignedFloats constrained_, multiplier_;  // g and h
  AlignedFloats constraint_, split_, plane_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
