#pragma once

#include <asterism/parts/concept/response.hpp>
#include <asterism/parts/concept/state.hpp>
#include <asterism/parts/concept/template_window.hpp>
#include <asterism/parts/features/patch.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of Template.
struct TemplateOptions {
  /// The squared distance d^2 of a patch y and the template z, relative to the template's contrast: 0 for the
  /// same, about 2 for the unrelated.
  enum class Distance {
    Ncc,  ///< 2 (1 - NCC), the normalised cross-correlation: blind to brightness and contrast
    Ssd   ///< |y - z|^2 / |z - mean z|^2
  };
  /// Which distance is used.
  Distance distance = Distance::Ncc;
  /// Compare BGR if the target was learned in color; otherwise gray levels.
  bool color = true;
  /// Deviation of the noise in d, > 0: displacements have the likelihood exp(-d^2 / (2 sigma^2)).
  double sigma = 0.25;
  /// Rate of the template's autoregressive update, in [0, 1]; that of Kcf.
  double learning_rate = 0.02;
  /// The search window: padding in (0, 100], sides in [1, 1024].
  TemplateWindow window = {.padding = 1.5, .min_template_side = 16, .max_template_side = 48};
};

/// Template matching, the generative baseline. A PartModel; copies are independent.
///
/// The template is compared at every displacement of a grid of template pixels. The response is 1 - d^2 / 2,
/// which is the NCC itself for that distance; the covariance is that of the displacement's likelihood
/// (Nickels and Hutchinson, IVC 2002). Among equal matches the one nearest to the window's middle counts. A
/// template without contrast, or a response that is the same everywhere, says nothing: the similarity is 0.
class ASTERISM_API Template {
 public:
  /// Throws std::invalid_argument for options out of range.
  explicit Template(const TemplateOptions& options = {});

  /// Learn a target of `size` [px] at `centre` [px].
  void init(const Frame& frame, const Point2& centre, const Size2& size);
  /// Search the window around a position. Keeps the response map for `response` and `similarity_at`.
  Evidence localize(const Frame& frame, const Point2& around);
  /// Average the appearance at a position into the template.
  void adapt(const Frame& frame, const Point2& at);

  double similarity_at(const Point2& position) const { return response_.at(position); }
  /// The response map of the last `localize`, one value a displacement.
  const ResponseMap& response() const { return response_; }

  /// Visits what has been learned, for save_state, but not the response of the last `localize`.
  void visit_state(StateArchive& archive);

  const TemplateOptions& options() const { return options_; }

 private:
  void prepare(const Size2& size, int channels);  // all that follows from them
  // The window of `grid` template pixels around `centre`, in float gray levels.
  void sample(const Frame& frame, const Point2& centre, const cv::Size& grid, cv::Mat& pixels);
  void learn(const Frame& frame, const Point2& at, double rate);

  TemplateOptions options_;
  Size2 size_ = Size2::Zero();    // of the target
  double spacing_ = 1;            // image pixels a template pixel
  int rows_ = 0, cols_ = 0;       // of the template
  int channels_ = 1, reach_ = 0;  // reach: largest displacement [template pixels]
  Eigen::ArrayXf template_;       // rows x cols x channels, in gray levels
  double contrast_ = 0;           // |z - mean z|^2, the mean being that of each channel
  ResponseMap response_, likelihood_;
  Scratch patch_, pixels_, scores_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
