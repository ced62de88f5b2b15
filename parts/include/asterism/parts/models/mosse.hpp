#pragma once

#include <asterism/parts/concept/response.hpp>
#include <asterism/parts/concept/state.hpp>
#include <asterism/parts/concept/template_window.hpp>
#include <asterism/parts/features/fft.hpp>
#include <asterism/parts/features/patch.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of Mosse; the defaults are those of Bolme et al. (CVPR 2010) where it states them.
struct MosseOptions {
  /// Rate eta of the running average of numerator and denominator, in [0, 1].
  double learning_rate = 0.125;
  /// Standard deviation of the Gaussian label [template pixels], in [1e-3, 1e3].
  double label_sigma = 2;
  /// Added to the energy spectrum of patches of norm 1, epsilon in [1e-30, 1e30].
  double regularisation = 1e-4;
  /// The first filter is trained on the target and this many random affine images of it, in [0, 100].
  int perturbations = 8;
  /// The entries of their matrices differ from the identity's by up to this, in [0, 0.99].
  double perturbation = 0.05;
  /// The search window: padding in [0, 100], sides in [16, 1024].
  TemplateWindow window = {.padding = 1, .min_template_side = 24, .max_template_side = 32};
};

/// The minimum output sum of squared error filter on gray levels (Bolme et al., CVPR 2010), the fastest part.
/// A PartModel; copies are independent.
///
/// With F the spectrum of a preprocessed patch (logarithm, mean 0, norm 1, Hann window) and G that of the
/// label, the filter is H* = A / (B + epsilon), A and B running averages of G F* and F F*. The response at
/// all displacements is the inverse transform of F H*. The window's taper pulls a displaced target towards
/// the window's middle by a few hundredths of its displacement; searched again around where it was found, the
/// error is gone.
class ASTERISM_API Mosse {
 public:
  /// Throws std::invalid_argument for options out of range.
  explicit Mosse(const MosseOptions& options = {});

  /// Learn a target of `size` [px] at `centre` [px]. The perturbations are the same in every call.
  void init(const Frame& frame, const Point2& centre, const Size2& size);
  /// Search the window around a position. The peak is the filter's response; the covariance is that of the
  /// displacements whose response the noise, measured beside the peak, may have put below the maximum.
  Evidence localize(const Frame& frame, const Point2& around);
  /// Update numerator and denominator with the appearance at a position.
  void adapt(const Frame& frame, const Point2& at);

  double similarity_at(const Point2& position) const { return response_.at(position); }
  /// The response map of the last `localize`.
  const ResponseMap& response() const { return response_; }
  /// Peak to sidelobe ratio of the last `localize`: the maximum above the mean of the response outside 11 x
  /// 11 template pixels around it, in its standard deviations. 20 to 60 is a match, below about 7 the target
  /// is occluded (Bolme et al.); 0 without any response.
  double psr() const { return psr_; }

  /// Visits what has been learned, for save_state, but not the response of the last `localize`.
  void visit_state(StateArchive& archive);

  const MosseOptions& options() const { return options_; }

 private:
  using Spectrum = Eigen::ArrayXcf;

  void prepare(const Size2& size);  // all that follows from the target's size
  // Spectrum F of a patch of the template's size, in `spectrum_`.
  void transform(const cv::Mat& patch);
  // The patch around `centre`, in `patch_`.
  void sample(const Frame& frame, const Point2& centre);
  // Blends the sample in `spectrum_` into numerator and denominator.
  void learn(double rate);
  void update_filter() {
    filter_ = numerator_ / (denominator_ + static_cast<float>(options_.regularisation));
  }

  MosseOptions options_;
  Size2 size_ = Size2::Zero();  // of the target
  double spacing_ = 1;          // image pixels a template pixel
  int rows_ = 0, cols_ = 0;
  RealFft2 fft_;
  Eigen::ArrayXf hann_;  // the cosine window
  Spectrum label_;       // G
  Spectrum numerator_;   // A
  Eigen::ArrayXf denominator_;
  Spectrum filter_;  // H*
  ResponseMap response_, likelihood_;
  double psr_ = 0;

  // Buffers of localize and adapt, sized by init.
  Scratch patch_;
  Eigen::ArrayXf plane_;
  Spectrum spectrum_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
