#pragma once

#include <asterism/parts/concept/response.hpp>
#include <asterism/parts/concept/state.hpp>
#include <asterism/parts/concept/template_window.hpp>
#include <asterism/parts/features/patch.hpp>
#include <asterism/parts/features/slic.hpp>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of Superpixels.
struct SuperpixelsOptions {
  /// Options of the superpixels, in template pixels and CIELAB.
  SlicOptions slic = {.side = 6, .compactness = 10, .iterations = 5};
  /// Deviation sigma of a superpixel's mean color from frame to frame, > 0 [CIELAB units]: colors c and c'
  /// are alike to k = exp(-|c - c'|^2 / (2 sigma^2)).
  double color_sigma = 10;
  /// Weight beta of the confidences, >= 0; that of the layout is 1.
  double confidence_weight = 0.4;
  /// Displacements have the likelihood exp(sharpness (response - peak)), > 0.
  double sharpness = 40;
  /// Rate of the appearance's autoregressive update, in [0, 1].
  double learning_rate = 0.1;
  /// The search window: padding in (0, 100], sides in [1, 1024].
  TemplateWindow window = {.padding = 1.5, .min_template_side = 32, .max_template_side = 40};
};

/// SLIC superpixels that vote with their colors, after DGT (Cai et al., TIP 2014) and superpixel tracking
/// (Wang et al., ICCV 2011). A PartModel; copies are independent.
///
/// A superpixel's confidence, in [-1, 1], says whether its color is rather the target's or its
/// surroundings'. The superpixels learned on the target each vote for the displacements that bring them onto
/// superpixels of their color, by the area on which they do, and more the more confident they are; to this
/// the confidences of the frame's superpixels under the target's box are added. The response is the sum
/// relative to that of the target as learned. Among equal matches the one nearest to the window's middle
/// counts; a response that is the same everywhere says nothing, and the similarity is 0.
class ASTERISM_API Superpixels {
 public:
  /// Throws std::invalid_argument for options out of range.
  explicit Superpixels(const SuperpixelsOptions& options = {});

  /// Learn a target of `size` [px] at `centre` [px].
  void init(const Frame& frame, const Point2& centre, const Size2& size);
  /// Search the window around a position. Keeps the response map for `response` and `similarity_at`.
  Evidence localize(const Frame& frame, const Point2& around);
  /// Average the target and its surroundings at a position into those learned, and cut them again.
  void adapt(const Frame& frame, const Point2& at);

  double similarity_at(const Point2& position) const { return response_.at(position); }
  /// The response map of the last `localize`, one value a displacement.
  const ResponseMap& response() const { return response_; }
  /// Visits what has been learned, for save_state.
  void visit_state(StateArchive& archive);
  /// Number of superpixels on the target.
  int size() const { return static_cast<int>(weights_.size()); }

  const SuperpixelsOptions& options() const { return options_; }

 private:
  // Pixels of one row of the target that belong to one superpixel.
  struct Run {
    int row, first, end;
  };
  // Colors and the share of the area that each has.
  struct Colors {
    Eigen::ArrayX3f colors;
    Eigen::ArrayXf shares;
  };

  // What follows from the size.
  void prepare(const Size2& size);
  void sample(const Frame& frame, const Point2& centre);
  void learn(const Frame& frame, const Point2& at, double rate);
  // The superpixels of what has been learned.
  void cut();
  Eigen::ArrayXXf alike(const Eigen::ArrayX3f& rows, const Eigen::ArrayX3f& cols) const;
  Eigen::ArrayXf confidence(const Eigen::ArrayX3f& colors) const;

  SuperpixelsOptions options_;
  Size2 size_ = Size2::Zero();             // of the target [px], 0 before init
  bool color_ = false;                     // learned in color
  double spacing_ = 1;                     // image pixels a template pixel
  int rows_ = 0, cols_ = 0, reach_ = 0;    // of the template; largest displacement [template pixels]
  Eigen::ArrayX3f learned_, pixels_;       // CIELAB of the window, learned and of the frame
  Colors foreground_, background_;         // superpixels on the target, and around it
  Eigen::ArrayXf weights_;                 // of the votes of those on the target
  std::vector<std::vector<Run>> regions_;  // those on the target
  float whole_ = 1;                        // the sum of votes for the target as learned
  ResponseMap response_, likelihood_;
  Scratch patch_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
