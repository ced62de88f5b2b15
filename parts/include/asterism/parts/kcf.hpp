#pragma once

#include <asterism/parts/fft.hpp>
#include <asterism/parts/fhog.hpp>
#include <asterism/parts/response.hpp>

namespace asterism::inline ASTERISM_ABI {

/// The kernel kappa(z, z') of a correlation filter; c is the multi-channel circular correlation, n its number
/// of elements (channels x rows x cols).
struct Kernel {
  enum class Type {
    Gaussian,    ///< exp(-max(0, |z|^2 + |z'|^2 - 2 c) / (n sigma^2))
    Polynomial,  ///< (c / n + offset)^exponent
    Linear       ///< c / n
  };
  Type type = Type::Gaussian;
  double sigma = 0.5;
  double offset = 1;
  double exponent = 9;
};

/// Options of Kcf; the defaults are those of Henriques et al. (PAMI 2015) for HOG features, as the paper's
/// Sec. 3.1 asks for.
struct KcfOptions {
  Kernel kernel;
  /// Regularisation lambda of the ridge regression (Eq. kcf_cost), > 0.
  double lambda = 1e-4;
  /// Rate of the autoregressive model update (Sec. 2.1), in [0, 1].
  double learning_rate = 0.02;
  /// Standard deviation of the Gaussian label phi, as a fraction of the target's geometric mean side, > 0.
  double label_sigma = 0.1;
  /// HOG cell [template pixels].
  int cell_size = 4;
  /// The search window adds this much around the target, >= 0: `padding` x each side if `proportional_window`
  /// (Henriques), else `padding` x the geometric mean of the sides on both axes, which gives elongated
  /// targets room across. Equal for square targets.
  double padding = 1.5;
  bool proportional_window = false;
  /// Small and large targets: the window is resampled so that the geometric mean of the target's sides in the
  /// template is in this range [template pixels]. Between the two the image is used as it is.
  double min_template_side = 40;
  double max_template_side = 80;
  /// Update of the model. The paper (Sec. 2.1): numerator and denominator of A apart; otherwise A itself is
  /// interpolated (Henriques).
  bool separate_update = true;
  /// Refine the response's maximum below the cell grid.
  bool sub_pixel = true;
};

/// Kernelised correlation filter on HOG and gray channels (Henriques et al., PAMI 2015; the paper's
/// Sec. 2.1). A PartModel; copies are independent.
///
/// 31 fHOG channels and the gray level, all on the cell grid and under a Hann window, feed one kernel.
/// Spectra of features are single precision; the kernel's spectrum and A are double, since the spectrum's DC
/// is about 1e3 and single precision would err by as much as lambda.
class Kcf {
 public:
  static constexpr int kChannels = Fhog::kChannels + 1;

  /// Throws std::invalid_argument for options out of range.
  explicit Kcf(const KcfOptions& options = {});

  /// Learn a target of `size` [px] at `centre` [px].
  void init(const Frame& frame, const Point2& centre, const Size2& size);
  /// Search the window around a position. Keeps the response map for `response` and `similarity_at`.
  Evidence localize(const Frame& frame, const Point2& around);
  /// Update the model with the appearance at a position: template, numerator and denominator.
  void adapt(const Frame& frame, const Point2& at);

  double similarity_at(const Point2& position) const { return response_.at(position); }
  /// The response map of the last `localize` (Eq. kcf_prob_response).
  const ResponseMap& response() const { return response_; }

  /// The target's size in the image [px], and that of its search window.
  const Size2& size() const { return size_; }
  Size2 window() const { return scale_.cwiseProduct(Size2(cols_, rows_)) * options_.cell_size; }
  /// Let the target have another size in the image from now on: the window is stretched alike, the template
  /// stays.
  void resize(const Size2& size);

  const KcfOptions& options() const { return options_; }

 private:
  using Plane = Eigen::ArrayXd;
  using Spectrum = Eigen::ArrayXcd;

  // Windowed features of the patch around `centre` -> their spectra in `sample_`; returns their squared norm.
  double transform_patch(const Frame& frame, const Point2& centre);
  // Kernel correlation of two spectra with all circular shifts (k^{xz}) -> its spectrum in
  // `kernel_spectrum_`.
  void correlate(const Eigen::ArrayXcf& z, double z_norm, const Eigen::ArrayXcf& x, double x_norm);
  // Train on the sample in `sample_` and blend with `rate` (1: forget everything before).
  void train(double sample_norm, double rate);

  KcfOptions options_;
  Size2 size_ = Size2::Zero(), initial_size_ = Size2::Zero();
  Size2 scale_ = Size2::Ones(), initial_scale_ = Size2::Ones();  // image pixels a template pixel
  int rows_ = 0, cols_ = 0;                                      // cells

  Fhog fhog_;
  RealFft2<float> feature_fft_;  // all channels at once
  RealFft2<double> plane_fft_;   // one map

  Eigen::ArrayXf hann_;         // one plane of the cosine window
  Spectrum label_;              // Phi
  Eigen::ArrayXcf template_;    // z, the spectra of its channels
  double template_norm_ = 0;    // |z|^2
  Spectrum numerator_, alpha_;  // of A, and A
  Plane denominator_;           // real: spectrum of a symmetric map
  ResponseMap response_;

  // Buffers of localize and adapt, sized by init.
  cv::Mat patch_, cell_means_;
  Eigen::ArrayXf features_;
  Eigen::ArrayXcf sample_, cross_float_;
  Spectrum kernel_spectrum_;
  Plane plane_;
};

}  // namespace asterism::inline ASTERISM_ABI
