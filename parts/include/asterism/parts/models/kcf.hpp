#pragma once

#include <asterism/parts/concept/response.hpp>
#include <asterism/parts/concept/state.hpp>
#include <asterism/parts/concept/template_window.hpp>
#include <asterism/parts/features/aligned.hpp>
#include <asterism/parts/features/cell_spectra.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The kernel kappa(z, z') of a correlation filter; c is the multi-channel circular correlation, n its number
/// of elements (channels x rows x cols).
struct Kernel {
  /// Which function of c.
  enum class Type {
    Gaussian,    ///< exp(-max(0, |z|^2 + |z'|^2 - 2 c) / (n sigma^2))
    Polynomial,  ///< (c / n + offset)^exponent
    Linear       ///< c / n
  };
  Type type = Type::Gaussian;  ///< which function of c
  double sigma = 0.5;          ///< bandwidth of Gaussian, > 0
  double offset = 1;           ///< of Polynomial; offset^exponent must be at most 1e6
  double exponent = 9;         ///< of Polynomial, a whole number, in [1, 100]
};

/// The channels of a cell that a Kcf uses; all feed one kernel.
using KcfFeatures = CellFeatures;

/// Options of Kcf; the defaults are those of Henriques et al. (PAMI 2015) for HOG features, as the paper's
/// Sec. 3.1 asks for.
struct KcfOptions {
  /// The channels of a cell.
  KcfFeatures features = {};
  /// The kernel of the ridge regression.
  Kernel kernel = {};
  /// Regularisation lambda of the ridge regression (the paper's Eq. 1), > 0.
  double lambda = 1e-4;
  /// Rate of the autoregressive model update (Sec. 2.1), in [0, 1].
  double learning_rate = 0.02;
  /// Standard deviation of the Gaussian label phi, as a fraction of the target's geometric mean side, > 0.
  double label_sigma = 0.1;
  /// HOG cell [template pixels]. A window has no more than 256 cells on each axis.
  int cell_size = 4;
  /// The search window: padding in [0, 100], sides in [cell_size, 1024].
  TemplateWindow window = {.padding = 1.5, .min_template_side = 40, .max_template_side = 64};
  /// Pad each axis in proportion to that side (Henriques) instead of both axes in proportion to the geometric
  /// mean of the sides, which gives elongated targets room across. Equal for square targets.
  bool proportional_window = false;
  /// Update numerator and denominator of A separately (the paper, Sec. 2.1); otherwise interpolate A itself
  /// (Henriques).
  bool separate_update = true;
  /// Refine the response's maximum below the cell grid.
  bool sub_pixel = true;
};

/// Kernelised correlation filter on HOG, gray or color channels (Henriques et al., PAMI 2015; the paper's
/// Sec. 2.1). A PartModel; copies are independent.
///
/// The channels, all on the cell grid and under a Hann window, feed one kernel. All transforms are single
/// precision and the library's own (docs/correlation-filters.md). The kernel's map is near one, or near
/// offset^exponent, everywhere: only its deviation from that is transformed, and the spectrum's DC, about
/// 1e3, is added in double precision, where single precision would err by as much as lambda. A is double.
///
/// Once it has been initialised, `localize` and `adapt` do not allocate, except for color channels. One
/// object is for one thread at a time, different ones are independent.
class ASTERISM_API Kcf {
 public:
  /// Throws std::invalid_argument for options out of range.
  explicit Kcf(const KcfOptions& options = {});

  /// Learn a target of `size` [px] at `centre` [px].
  void init(const Frame& frame, const Point2& centre, const Size2& size);
  /// Search the window around a position. Keeps the response map for `response` and `similarity_at`.
  Evidence localize(const Frame& frame, const Point2& around);
  /// Update the model with the appearance at a position: template, numerator and denominator.
  void adapt(const Frame& frame, const Point2& at);

  double similarity_at(const Point2& position) const { return response_.at(position); }
  /// The response map of the last `localize` (the paper's Eq. 3).
  const ResponseMap& response() const { return response_; }

  /// The target's size in the image [px], and that of its search window.
  const Size2& size() const { return size_; }
  Size2 window() const {
    return scale_.cwiseProduct(Size2(sample_.cols(), sample_.rows())) * options_.cell_size;
  }
  /// Let the target have another size in the image from now on: the window is stretched alike, the template
  /// stays.
  void resize(const Size2& size);

  /// Visits what has been learned, for save_state, but not the response of the last `localize`.
  void visit_state(StateArchive& archive);

  const KcfOptions& options() const { return options_; }

 private:
  using Plan = CellSpectra::Plan;

  // All that follows from the target's size in the first frame: what `init` makes, except the model.
  void prepare(const Size2& size);
  // The cross spectrum in `split_` -> the spectrum of the kernel's map k^{xz} less `kernel_base_`. norms: of
  // z and x.
  void map_kernel(double norms);
  // Train on the sample in `sample_` and blend with `rate` (1: forget everything before).
  void train(double sample_norm, double rate);

  KcfOptions options_;
  double kernel_base_ = 0;  // of c = 0, or 0: about what the kernel's map is everywhere
  Size2 size_ = Size2::Zero(), initial_size_ = Size2::Zero();
  Size2 scale_ = Size2::Ones(), initial_scale_ = Size2::Ones();  // image pixels a template pixel
  CellSpectra sample_;  // the windowed features of the last window, and their spectra

  // Spectra of real symmetric maps are real: those of the label, the kernel's autocorrelation, and so A.
  Eigen::ArrayXd label_;                            // Phi
  AlignedFloats template_;                          // z, the spectra of its channels
  double template_norm_ = 0;                        // |z|^2
  Eigen::ArrayXd numerator_, denominator_, alpha_;  // of A, and A
  Eigen::ArrayXf alpha_float_;
  ResponseMap response_;

  // Buffers of localize and adapt, sized by init; part_kernels.hpp has their layout.
  AlignedFloats split_, plane_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
