#pragma once

#include <Eigen/Core>
#include <asterism/parts/concept/state.hpp>
#include <asterism/parts/features/fhog.hpp>
#include <asterism/parts/features/patch.hpp>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of ScaleFilter; the defaults are those of Danelljan et al. (BMVC 2014).
struct ScaleFilterOptions {
  /// Number of sizes that are compared, odd and in [3, 101].
  int scales = 33;
  /// Factor between neighbouring sizes, > 1; step^scales must be at most 1e6.
  double step = 1.02;
  /// Standard deviation of the Gaussian label [steps], as a fraction of sqrt(scales), > 0.
  double label_sigma = 0.25;
  /// Regularisation lambda of the ridge regression, > 0.
  double lambda = 0.01;
  /// Rate of the running average of numerator and denominator, in [0, 1].
  double learning_rate = 0.025;
  /// HOG cell [template pixels], >= 1.
  int cell_size = 4;
  /// Larger targets are resampled to about this area [template px^2], in [1, 4096] cell_size^2.
  double max_template_area = 512;
};

/// The one-dimensional scale filter of DSST (Danelljan et al., BMVC 2014): how much larger or smaller has the
/// target become? Not a PartModel: it needs a position from one, and gives a size. Copies are independent.
///
/// Patches of `scales` sizes about one centre are resampled to one template; each fHOG feature of it is then
/// a signal over the logarithm of size, under a Hann window. With F_d the spectra of the signals and G that
/// of the label, the filter is H_d* = A_d* / (B + lambda), A_d and B running averages of G* F_d and sum_d
/// |F_d|^2; the response at all sizes is the inverse transform of sum_d H_d* Z_d. As G is the same for all,
/// A_d = G* (average of F_d), and all sums over d are of products of signals: no signal is transformed by
/// itself. Once initialised, `localize` and `adapt` do not allocate (except for targets below the template's
/// size when they grow).
///
///     x = part.localize(frame, x).position;
///     size *= scale.localize(frame, x);
///     part.resize(size);  // where the part has a size to follow, as Kcf and SpatialReliability
///     part.adapt(frame, x);
///     scale.adapt(frame, x, size);
///
/// Sizes are not bounded: a caller that knows limits clamps what it multiplies.
class ASTERISM_API ScaleFilter {
 public:
  /// Throws std::invalid_argument for options out of range.
  explicit ScaleFilter(const ScaleFilterOptions& options = {});

  /// Learn a target of `size` [px] at `centre` [px]. Both must be finite and the size positive, here and in
  /// `adapt`, or std::invalid_argument is thrown.
  void init(const Frame& frame, const Point2& centre, const Size2& size);
  /// The factor by which the target at `centre` differs from `size()`, between the steps by a parabola; 1
  /// where no size has any response. Needs an `init` before; throws std::invalid_argument for a centre that
  /// is not finite.
  double localize(const Frame& frame, const Point2& centre);
  /// Update numerator and denominator with the target at a position and of a size.
  void adapt(const Frame& frame, const Point2& centre, const Size2& size);

  /// The size last learned [px].
  const Size2& size() const { return size_; }
  /// The response of the last `localize` at each size, `step`^(i - scales / 2) x `size()` at i.
  const Eigen::ArrayXf& response() const { return response_; }
  /// Its maximum, about 1 for the same target, >= 0.
  double peak() const { return peak_; }
  /// The variance of the factor's logarithm: second moment of the response about the factor, negative
  /// responses counting as 0, and of the steps' quantisation. That of all sizes where there is no response.
  double log_variance() const { return log_variance_; }

  /// Visits what has been learned, for save_state, but not the response of the last `localize`.
  void visit_state(StateArchive& archive);

  const ScaleFilterOptions& options() const { return options_; }

 private:
  void prepare(const Size2& size);  // all that follows from the target's first size
  // The windowed features of the patches about `centre`, the middle one of `size`, in `sample_`.
  void compute_features(const Frame& frame, const Point2& centre, const Size2& size);
  // A patch of CV_32FC1 from the middle `fraction` of the source, bilinear.
  void sample(const cv::Mat& source, double fraction, cv::Mat& patch);
  // Blends the sample into template and energy.
  void learn(double rate);
  // Circular cross-correlation over the sizes of signals and those in `sample_`, summed over the features, in
  // `correlation_`.
  void correlate(const Eigen::MatrixXf& first);

  ScaleFilterOptions options_;
  Size2 size_ = Size2::Zero(), initial_size_ = Size2::Zero();
  Fhog fhog_;
  cv::Size grid_;                    // template pixels
  Eigen::ArrayXf hann_;              // over the sizes
  Eigen::MatrixXd cosines_, sines_;  // of 2 pi k i / scales: bins of half a spectrum x sizes
  Eigen::VectorXd label_;            // G, real
  Eigen::MatrixXf template_;         // average of the signals, features x sizes
  Eigen::VectorXd energy_;           // B
  Eigen::ArrayXf response_;
  double peak_ = 0, log_variance_ = 0;

  // Buffers of localize and adapt, sized by init.
  struct Tap {
    int pixel;  // and the next one, which has the weight
    float weight;
  };
  PatchSampler sampler_;
  Scratch source_, patch_;
  std::vector<Tap> taps_;
  Eigen::ArrayXf hog_;
  Eigen::MatrixXf sample_, gram_;
  Eigen::VectorXd correlation_, real_, imaginary_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
