#pragma once

#include <asterism/parts/concept/response.hpp>
#include <asterism/parts/concept/state.hpp>
#include <asterism/parts/concept/template_window.hpp>
#include <asterism/parts/features/patch.hpp>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of ColorHistogram.
struct ColorHistogramOptions {
  /// The color spaces of a histogram.
  enum class Space {
    Gray,  ///< LGT's parts
    Rgb,   ///< Comaniciu et al. (PAMI 2003)
    Hsv    ///< hue with 256 steps a turn, as ColorModel
  };
  /// Which color space is counted. A target that was learned from a gray image is always Gray.
  Space space = Space::Rgb;
  /// Bins for each channel, in [2, 64]; 16 in LGT and in Comaniciu et al.
  int bins = 16;
  /// Sharpness lambda of the likelihood exp(-lambda d^2), > 0 (Perez et al., ECCV 2002).
  double sharpness = 20;
  /// Rate of the histogram's autoregressive update, in [0, 1]; the paper's alpha_hist.
  double learning_rate = 0.05;
  /// The search window: padding in (0, 100], sides in [1, 1024].
  TemplateWindow window = {.padding = 1.5, .min_template_side = 12, .max_template_side = 24};
};

/// Histogram of the target's box, as a part of LGT is (Cehovin et al., PAMI 2013). A PartModel; copies are
/// independent.
///
/// The response is the Bhattacharyya coefficient rho = sum_b sqrt(p_b q_b) of the learned histogram q and
/// that of the box p at every displacement of a grid of template pixels; the covariance that of the
/// likelihood exp(-lambda d^2), d^2 = 1 - rho. It does not care how the pixels are arranged: deformation and
/// rotation change little, and it locates coarsely. Among equal matches the one nearest to the window's
/// middle counts; a response that is the same everywhere says nothing, and the similarity is 0. A target that
/// stands still is found where it was learned: the sub-pixel offset of the match there is subtracted.
class ASTERISM_API ColorHistogram {
 public:
  /// The color spaces of a histogram.
  using Space = ColorHistogramOptions::Space;

  /// Throws std::invalid_argument for options out of range.
  explicit ColorHistogram(const ColorHistogramOptions& options = {});

  /// Learn a target of `size` [px] at `centre` [px].
  void init(const Frame& frame, const Point2& centre, const Size2& size);
  /// Search the window around a position. Keeps the response map for `response` and `similarity_at`.
  Evidence localize(const Frame& frame, const Point2& around);
  /// Average the histogram at a position into the model.
  void adapt(const Frame& frame, const Point2& at);

  double similarity_at(const Point2& position) const { return response_.at(position); }
  /// The response map of the last `localize`, one value a displacement.
  const ResponseMap& response() const { return response_; }
  /// The learned histogram, of sum 1; the last channel (of B, G, R or of H, S, V) runs fastest.
  const Eigen::ArrayXf& histogram() const { return histogram_; }

  /// Visits what has been learned, for save_state, but not the response of the last `localize`.
  void visit_state(StateArchive& archive);

  const ColorHistogramOptions& options() const { return options_; }

 private:
  void prepare(const Size2& size, Space space);  // all that follows from them
  // The bins of the box around `centre` and `margin` template pixels on each side, in `bins_`, row by row.
  void sample(const Frame& frame, const Point2& centre, int margin);
  void learn(const Frame& frame, const Point2& at, double rate);
  // rho at displacements of up to `reach` template pixels, of the bins with that margin.
  using Map = decltype(ResponseMap::values);
  void match(int reach, Map& values);

  ColorHistogramOptions options_;
  Size2 size_ = Size2::Zero();  // of the target
  Space space_ = Space::Rgb;
  double spacing_ = 1;                          // image pixels a template pixel
  int rows_ = 0, cols_ = 0, reach_ = 0;         // of the template; largest displacement [template pixels]
  Eigen::ArrayXf histogram_, histogram_roots_;  // q_b and its square roots
  Eigen::ArrayXf roots_;                        // sqrt(0), sqrt(1), ..
  ResponseMap response_, likelihood_;
  ResponseMap near_;              // rho beside the target as learned, one template pixel apart
  Point2 bias_ = Point2::Zero();  // of the maximum of the response there [template pixels]

  Scratch patch_;
  std::vector<int> bins_;
  Eigen::ArrayXi counts_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
