#pragma once

#include <asterism/parts/concept/option_text.hpp>
#include <asterism/parts/concept/response.hpp>
#include <asterism/parts/concept/state.hpp>
#include <asterism/parts/concept/template_window.hpp>
#include <asterism/parts/features/cell_channels.hpp>
#include <asterism/parts/features/fft.hpp>
#include <asterism/parts/features/fhog.hpp>
#include <asterism/parts/features/patch.hpp>
#include <asterism/parts/models/color.hpp>
#include <memory>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of MaskedRegression; the defaults are those of Lukezic et al. (CVPR 2017).
struct MaskedRegressionOptions {
  /// Weight lambda of the filter's energy, > 0.
  double lambda = 0.05;
  /// Rounds of `solve`, in [0, 1000]; with 0 the ridge regression is only cut to the mask.
  int iterations = 4;
  /// Rounds of `refine`, in [0, 1000].
  int refining_iterations = 2;
  /// Penalty mu of the constraint in the first round, > 0.
  double penalty = 5;
  /// Factor beta by which the penalty grows from round to round, >= 1.
  double penalty_growth = 3;
  /// Upper bound of the penalty, >= penalty, at most 1e6.
  double max_penalty = 20;
};

/// Ridge regression of a label y on all circular shifts of images f_t, by a filter h that is zero outside a
/// mask m:
///
///     min sum_t w_t |f_t * h - y|^2 + lambda |h|^2   with   h = m h
///
/// where * is the circular correlation, by the alternating direction method of multipliers (Lukezic et al.,
/// CVPR 2017, Sec. 3.1): the regression is diagonal in the Fourier domain, the constraint in the image. All
/// spectra are half ones, as RealFft2's.
class ASTERISM_API MaskedRegression {
 public:
  MaskedRegression() = default;
  /// rows, cols > 0 and multiples of four. Throws std::invalid_argument for these and for options out of
  /// range.
  MaskedRegression(int rows, int cols, const MaskedRegressionOptions& options = {});

  /// cross: sum_t w_t F_t conj(Y); energy: sum_t w_t |F_t|^2; mask: rows x cols values, 0 or 1 -> filter: the
  /// spectrum H, for which F conj(H) is the response; dual: that of the constraint. Does not allocate by
  /// itself.
  void solve(const std::complex<float>* cross, const float* energy, const float* mask,
             std::complex<float>* filter, std::complex<float>* dual);
  /// The same from filter and dual of a problem that differs little, with the largest penalty.
  void refine(const std::complex<float>* cross, const float* energy, const float* mask,
              std::complex<float>* filter, std::complex<float>* dual);

 private:
  void load(const float* energy);
  // Rounds on filter_ and dual_.
  void iterate(const std::complex<float>* cross, const float* mask, int iterations, double penalty);
  // filter_ := that of the map within the mask.
  void constrain(const float* mask);

  MaskedRegressionOptions options_;
  RealFft2 fft_;
  Eigen::Index bins_ = 0;
  Eigen::ArrayXf energy_, filter_, free_, dual_;  // spectra, real and imaginary parts in turn
  Eigen::ArrayXf plane_;
};

/// Options of SpatialReliability; where no other source is named, the defaults are those of Lukezic et al.
/// (CVPR 2017).
struct SpatialReliabilityOptions {
  /// The regression by which the filters are learned.
  MaskedRegressionOptions regression;
  /// Rate of the running averages of the samples' spectra and their energy, in [0, 1]. The paper averages the
  /// filters themselves, at this rate.
  double learning_rate = 0.02;
  /// Rate of the running average of the channels' weights, in [0, 1].
  double weight_rate = 0.02;
  /// Standard deviation of the Gaussian label [cells], > 0.
  double label_sigma = 1;
  /// HOG cell [template pixels], >= 1.
  int cell_size = 4;
  /// Use eleven more channels: the share of a cell that has each of the basic colors, black to yellow. The
  /// paper uses learned color names (van de Weijer et al. 2009) instead. Zero in frames of one channel.
  bool color_channels = false;
  /// Use the channels of HOG and the gray level.
  bool hog_channels = true;
  /// Use the channels of a network's layer, too (DnnChannels): a file that OpenCV's dnn module reads, whose
  /// input is BGR, 0 to 255, of any size. None by default.
  OptionText network;
  /// The name of that layer; the last one by default.
  OptionText layer;
  /// The search window: padding in [0, 100], sides in [cell_size, 1024]. With padding 3 and 32 px it is 128
  /// px, where the FFT is fastest. The paper allows 50 px, and takes smaller cells for small targets.
  TemplateWindow window = {.padding = 3, .min_template_side = 32, .max_template_side = 32};
  /// Constrain the filter to the segmented target; otherwise, and for gray video, to its box.
  bool segmentation = true;
  /// Least area of the segmented target, as a fraction of the box's area; if it is smaller, the filter is
  /// constrained to the box. 0.05 in the paper.
  double min_mask_area = 0.3;
  /// Greatest area of the segmented target, likewise. The paper has no such bound.
  double max_mask_area = 1.5;
  /// The color model that segments the target; its random field starts from the spatial prior.
  ColorOptions color = [] {
    ColorOptions result;
    result.histogram_rate = 0.04;
    result.surrounding = 2;
    return result;
  }();
  /// Weight each channel by its response to the target when learned; otherwise all channels alike.
  bool channel_weights = true;
};

/// Correlation filter with channel and spatial reliability (Lukezic et al., *Discriminative correlation
/// filter with channel and spatial reliability*, CVPR 2017), known as CSR-DCF and CSRT. A PartModel; copies
/// are independent.
///
/// Each of 18 contrast-sensitive fHOG channels, the gray level and, as an option, eleven basic colors has a
/// linear filter of its own, learned in a window of several times the target but zero outside the target's
/// mask. So the window may be large, and all of what it sees counts as background, without the filter
/// learning from it where the target is. The response is the weighted sum over the channels, weights such
/// that the target as learned gets 1.
class ASTERISM_API SpatialReliability {
 public:
  /// Channels of orientations.
  static constexpr int kHogChannels = 18;

  /// Throws std::invalid_argument for options out of range, if no channels are left, for a network that
  /// cannot be read or has no such layer, and for any if the library was built without OpenCV's dnn module.
  explicit SpatialReliability(const SpatialReliabilityOptions& options = {});

  /// Learn a target of `size` [px] at `centre` [px].
  void init(const Frame& frame, const Point2& centre, const Size2& size);
  /// Search the window around a position. Keeps the response map for `response` and `similarity_at`.
  Evidence localize(const Frame& frame, const Point2& around);
  /// Update histograms, mask, filters and weights with the appearance at a position.
  void adapt(const Frame& frame, const Point2& at);

  double similarity_at(const Point2& position) const { return response_.at(position); }
  /// The response map of the last `localize`.
  const ResponseMap& response() const { return response_; }

  /// The target's size in the image [px], and that of its search window.
  const Size2& size() const { return size_; }
  Size2 window() const { return scale_.cwiseProduct(Size2(cols_, rows_)) * options_.cell_size; }
  /// Let the target have another size in the image from now on: the window is stretched alike, the template
  /// stays.
  void resize(const Size2& size);

  /// The mask of the last `init` or `adapt`: 1 in the cells that the filters may use, 0 elsewhere.
  const ResponseMap& mask() const { return mask_; }
  /// Whether it is the segmented target, not the box.
  bool segmented() const { return segmented_; }
  /// Weight of each channel: HOG's, the gray level, the colors, and the network's, of those that were asked
  /// for.
  const Eigen::ArrayXf& weights() const { return weights_; }

  /// Visits what has been learned, for save_state, but not the mask and the response of the last calls.
  void visit_state(StateArchive& archive);

  const SpatialReliabilityOptions& options() const { return options_; }

 private:
  using Spectrum = Eigen::ArrayXcf;

  void prepare(const Size2& size);  // all that follows from the target's first size
  // Spectra of the windowed features of the patch around `centre`, in `sample_`.
  void transform_patch(const Frame& frame, const Point2& centre);
  // Writes the gray level of the patch's cells; returns the end of the plane.
  float* add_gray_cells(float* gray);
  void update_mask(const Frame& frame, const Point2& at);
  // The target's mask from its colors; false where there is none or it is not plausible.
  bool segment(const Frame& frame, const Point2& at);
  // Responses to spectra of all channels, weighted and summed, in `plane_`.
  void respond(const Spectrum& sample);
  // Train on the sample in `sample_`; the first one starts the averages and the filters.
  void train(bool first);

  SpatialReliabilityOptions options_;
  std::shared_ptr<const CellChannels> network_;  // copies share it, as it learns nothing
  int channels_ = 0;
  Size2 size_ = Size2::Zero(), initial_size_ = Size2::Zero();
  Size2 scale_ = Size2::Ones(), initial_scale_ = Size2::Ones();  // image pixels a template pixel
  int rows_ = 0, cols_ = 0;                                      // cells
  bool segmented_ = false;

  Fhog fhog_;
  RealFft2 channels_fft_;  // all channels at once
  RealFft2 plane_fft_;     // one map
  MaskedRegression regression_;
  ColorModel color_;

  Eigen::ArrayXf hann_;     // one plane of the cosine window
  Eigen::ArrayXf label_;    // Y, real
  Spectrum template_;       // running averages of F, ...
  Eigen::ArrayXf energy_;   // ... and |F|^2, of each channel
  Spectrum filter_, dual_;  // H of each channel, and its constraint's dual
  Eigen::ArrayXf weights_;
  Point2 bias_ = Point2::Zero();  // of the response's maximum on the target as learned [cells]
  ResponseMap mask_, response_;

  // Buffers of localize and adapt, sized by init.
  PatchSampler sampler_;
  Scratch patch_, color_patch_, network_patch_, dilated_;
  std::vector<int> cell_sums_;
  Eigen::ArrayXf features_, plane_, reliability_;
  Spectrum sample_, spectrum_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
