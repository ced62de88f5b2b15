#pragma once

#include <array>
#include <asterism/parts/concept/frame.hpp>
#include <asterism/parts/concept/state.hpp>
#include <asterism/parts/features/mrf.hpp>
#include <asterism/parts/features/patch.hpp>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of ColorModel, with the paper's values (Sec. 3.1) as defaults.
struct ColorOptions {
  /// Rate of the histograms' autoregressive update, alpha_hist in Eq. 21, in [0, 1].
  double histogram_rate = 0.05;
  /// The background histogram's region is the box enlarged by this factor, without the box: alpha_sur, > 1.
  double surrounding = 1.6;
  /// Prior probability of the foreground in Bayes' rule, in (0, 1). The paper leaves it open.
  double foreground_prior = 0.5;
  /// Bounds of (foreground pixels) / (box area) between which the segmentation is informative: alpha_min and
  /// alpha_max in Eq. 6.
  double min_area_ratio = 0.2;
  double max_area_ratio = 2.0;
  /// Weight of the uniform component when the segmentation is informative: alpha_col in Eq. 6.
  double uniform_weight = 0.1;
  /// The Markov random field that smooths the posterior; `enabled = false` leaves the raw posterior.
  MrfOptions mrf;
};

/// The foreground posterior p(f | x, y) of a region of the image, on a grid of about 1000 cells (fewer where
/// the region has fewer pixels).
struct ASTERISM_API Segmentation {
  /// CV_32FC1, posterior in [0, 1]; 0 where the cell's centre is outside the image. Empty where the model is
  /// off or the frame has no color; then `informative` is false, `at` and `foreground_fraction` are 0
  /// everywhere.
  cv::Mat posterior;
  /// Image position of the centre of posterior(0, 0) and the spacing of the grid [px].
  Point2 origin = Point2::Zero();
  Size2 spacing = Size2::Ones();
  /// Eq. 6: the number of foreground pixels is plausible for the box.
  bool informative = false;

  /// Bilinear interpolation of the posterior at an image position; in the outer half of the border's cells
  /// the value of their centres; 0 outside the grid's cells and for a position that is not finite.
  double at(const Point2& position) const;
  /// Fraction of the cells whose centres lie in a box (in image pixels; covering the pixels x .. x + width -
  /// 1) that have a posterior above one half. The grid is continued by cells of posterior 0. A box too small
  /// for any centre gets the cell nearest to its own centre. 0 for a box that is not finite and positive.
  double foreground_fraction(const cv::Rect2d& box) const;
};

/// The paper's global color model C_t (Sec. 2.2): foreground and background HSV histograms of 16 x 16 x 16
/// bins (hue, saturation, value, the last running fastest; hue has 256 steps a turn).
///
/// All pixels of a box weigh the same. The group's later code lets the weight fall towards the corners (an
/// Epanechnikov kernel); on the development sequences, learned along the ground truth, this left the
/// posterior's centre of mass as far from the object's and covered less of it.
///
/// Boxes cover the pixels x .. x + width - 1 (as `centre_of`); pixels outside the image are never counted. At
/// most about 10000 pixels are read for a histogram: larger regions are sampled on a regular grid. All boxes
/// and regions must be finite and of positive size, std::invalid_argument otherwise.
class ASTERISM_API ColorModel {
 public:
  /// Bins of a histogram, of each channel and in all.
  static constexpr int kBinsPerChannel = 16;
  static constexpr int kBins = kBinsPerChannel * kBinsPerChannel * kBinsPerChannel;

  /// Throws std::invalid_argument for options out of range.
  explicit ColorModel(const ColorOptions& options = {});

  /// Learn both histograms, each of sum 1, from the box and its surrounding. The model is off (`enabled()` is
  /// false, the histograms zero, every segmentation uninformative) where the frame has no color, the box
  /// covers it without a background, or the box is outside.
  void init(const Frame& frame, const cv::Rect2d& box);
  /// Autoregressive update of the histograms (Eq. 21); nothing where the model is off or
  /// the frame has no color. A histogram whose region has no pixel in the image stays. Bins that have
  /// decayed to less than 1e-12 are emptied.
  void adapt(const Frame& frame, const cv::Rect2d& box);
  /// Whether there is a color model: the first frame had color.
  bool enabled() const { return enabled_; }

  /// Segment `region` of the frame: histogram backprojection by Bayes' rule (mean posterior of up to 6 x 6
  /// pixels a cell), regularised by the Markov random field, and the informativeness test: the foreground of
  /// the whole region, in pixels, against the area of `box_size`. Colors that neither histogram has seen get
  /// the prior, so the posterior is defined everywhere. Its memory is used again by a later call once nobody
  /// holds it any more: calls for regions of one size take none from the heap.
  Segmentation segment(const Frame& frame, const cv::Rect2d& region, const Size2& box_size);

  /// Eq. 5: p(f) (1 - alpha_col) + alpha_col, alpha_col being 1, and so the result, where
  /// uninformative.
  double probability(const Segmentation& segmentation, const Point2& position) const;

  /// Visits what has been learned, for save_state.
  void visit_state(StateArchive& archive);

  const ColorOptions& options() const { return options_; }
  /// The histograms, each of sum 1.
  const std::array<float, kBins>& foreground() const { return foreground_; }
  const std::array<float, kBins>& background() const { return background_; }

 private:
  using Histogram = std::array<float, kBins>;
  // Cells of one axis of a segmentation's grid.
  struct Axis {
    int cells = 1;
    double origin = 0, spacing = 1;
    std::vector<int> pixel, cell;  // sampled pixels, in order, and their cells
    std::vector<int> count;        // samples of each cell; 0 where its centre is outside the image
    cv::Range valid;               // the cells whose centres are in the image

    void place(double begin, double length, double scale, int limit);
  };

  // HSV histogram, of sum 1, of the pixels in `region` but not in `hole`. False, and nothing done, without a
  // pixel.
  bool collect(const cv::Mat& bgr, const cv::Rect& region, const cv::Rect& hole, Histogram& histogram);
  // `samples_` in HSV.
  const std::vector<cv::Vec3b>& samples_in_hsv();

  ColorOptions options_;
  Histogram foreground_{}, background_{};
  bool enabled_ = false;

  // Overwritten by each call.
  std::vector<cv::Vec3b> samples_, hsv_;
  Axis x_axis_, y_axis_;
  MrfWorkspace mrf_;
  Scratch posterior_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
