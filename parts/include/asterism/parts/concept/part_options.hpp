#pragma once

/// Names (those of the members) and ranges of the options of the library's models, for PartRegistry and for
/// options that contain them. An option whose comment says > 0 must be in [1e-9, 1e9].

#include <asterism/parts/concept/template_window.hpp>
#include <asterism/parts/models/color_histogram.hpp>
#include <asterism/parts/models/kcf.hpp>
#include <asterism/parts/models/mosse.hpp>
#include <asterism/parts/models/scale_filter.hpp>
#include <asterism/parts/models/siamese.hpp>
#include <asterism/parts/models/spatial_reliability.hpp>
#include <asterism/parts/models/strcf.hpp>
#include <asterism/parts/models/superpixels.hpp>
#include <asterism/parts/models/template.hpp>
#include <asterism/solver/run/option_visitor.hpp>
#if __has_include(<asterism/parts/models/flow.hpp>)  // only installed where it was built
#include <asterism/parts/models/flow.hpp>
#endif
#if __has_include(<asterism/parts/models/keypoints.hpp>)
#include <asterism/parts/models/keypoints.hpp>
#endif

namespace asterism {
inline namespace ASTERISM_ABI {

/// Ranges that several options have.
namespace option_ranges {
inline constexpr OptionRange kShare{0, 1};
/// The range of a prior probability: neither 0 nor 1.
inline constexpr OptionRange kProbability{1e-9, 1 - 1e-9};
/// The range of positive numbers whose squares are also representable in single precision.
inline constexpr OptionRange kPositive{1e-9, 1e9};
/// Longest side of templates and windows [template pixels]: beyond it, transforms and searches take seconds.
inline constexpr double kLongestSide = 1024;
inline constexpr OptionRange kSide{1, kLongestSide};
/// Greatest padding: in a larger window, the target is too small to be seen in the template.
inline constexpr double kMostPadding = 100;
/// Padding of models that search at every shift: with 0 they would search one position only.
inline constexpr OptionRange kSearchPadding{1e-9, kMostPadding};
}  // namespace option_ranges

/// Visits the options of a model's window, which are among the model's own, with their ranges.
inline void visit_window(OptionVisitor& visit, TemplateWindow& window, const OptionRange& padding,
                         const OptionRange& side) {
  visit("padding", window.padding, padding);
  visit("min_template_side", window.min_template_side, side);
  visit("max_template_side", window.max_template_side, side);
}

inline void visit_options(OptionVisitor& visit, Kernel& kernel) {
  visit("type", kernel.type, {"gaussian", "polynomial", "linear"});
  visit("sigma", kernel.sigma, option_ranges::kPositive);
  visit("offset", kernel.offset, {-1e6, 1e6});
  visit("exponent", kernel.exponent, {1, 100});
}

inline void visit_options(OptionVisitor& visit, CellFeatures& features) {
  visit("hog", features.hog);
  visit("gray", features.gray);
  visit("color", features.color);
}

inline void visit_options(OptionVisitor& visit, KcfOptions& options) {
  visit("features", options.features);
  visit("kernel", options.kernel);
  visit("lambda", options.lambda, option_ranges::kPositive);
  visit("learning_rate", options.learning_rate, option_ranges::kShare);
  visit("label_sigma", options.label_sigma, option_ranges::kPositive);
  visit("cell_size", options.cell_size, {1, option_ranges::kLongestSide});
  visit_window(visit, options.window, {0, option_ranges::kMostPadding}, option_ranges::kSide);
  visit("proportional_window", options.proportional_window);
  visit("separate_update", options.separate_update);
  visit("sub_pixel", options.sub_pixel);
}

inline void visit_options(OptionVisitor& visit, MosseOptions& options) {
  visit("learning_rate", options.learning_rate, option_ranges::kShare);
  visit("label_sigma", options.label_sigma, {1e-3, 1e3});
  visit("regularisation", options.regularisation, {1e-30, 1e30});
  visit("perturbations", options.perturbations, {0, 100});
  visit("perturbation", options.perturbation, {0, 0.99});
  visit_window(visit, options.window, {0, option_ranges::kMostPadding}, {16, option_ranges::kLongestSide});
}

inline void visit_options(OptionVisitor& visit, MrfOptions& options) {
  visit("enabled", options.enabled);
  visit("max_iterations", options.max_iterations, {1, 1000});
  visit("tolerance", options.tolerance, {0, 1e9});
  visit("neighbourhood", options.neighbourhood, {1e-9, 1});
}

inline void visit_options(OptionVisitor& visit, ColorOptions& options) {
  visit("histogram_rate", options.histogram_rate, option_ranges::kShare);
  visit("surrounding", options.surrounding, {1.001, option_ranges::kMostPadding});
  visit("foreground_prior", options.foreground_prior, option_ranges::kProbability);
  visit("min_area_ratio", options.min_area_ratio, {0, 1e9});
  visit("max_area_ratio", options.max_area_ratio, {0, 1e9});
  visit("uniform_weight", options.uniform_weight, option_ranges::kShare);
  visit("mrf", options.mrf);
}

inline void visit_options(OptionVisitor& visit, MaskedRegressionOptions& options) {
  visit("lambda", options.lambda, option_ranges::kPositive);
  visit("iterations", options.iterations, {0, 1000});
  visit("refining_iterations", options.refining_iterations, {0, 1000});
  visit("penalty", options.penalty, {1e-9, 1e6});
  visit("penalty_growth", options.penalty_growth, {1, 1e6});
  visit("max_penalty", options.max_penalty, {1e-9, 1e6});
}

inline void visit_options(OptionVisitor& visit, SpatialReliabilityOptions& options) {
  visit("regression", options.regression);
  visit("learning_rate", options.learning_rate, option_ranges::kShare);
  visit("weight_rate", options.weight_rate, option_ranges::kShare);
  visit("label_sigma", options.label_sigma, option_ranges::kPositive);
  visit("cell_size", options.cell_size, {1, option_ranges::kLongestSide});
  visit("color_channels", options.color_channels);
  visit("hog_channels", options.hog_channels);
  visit("network", options.network, options.network.text);
  visit("layer", options.layer, options.layer.text);
  visit_window(visit, options.window, {0, option_ranges::kMostPadding}, option_ranges::kSide);
  visit("segmentation", options.segmentation);
  visit("min_mask_area", options.min_mask_area, {0, 1e9});
  visit("max_mask_area", options.max_mask_area, {0, 1e9});
  visit("color", options.color);
  visit("channel_weights", options.channel_weights);
}

inline void visit_options(OptionVisitor& visit, SiameseOptions& options) {
  visit("network", options.network, options.network.text);
  visit("penalty", options.penalty, {0, 10});
  visit("window", options.window, option_ranges::kShare);
  visit("size_rate", options.size_rate, option_ranges::kShare);
  visit("filter_share", options.filter_share, option_ranges::kShare);
  visit("filter", options.filter);
}

inline void visit_options(OptionVisitor& visit, ScaleFilterOptions& options) {
  visit("scales", options.scales, {3, 101});
  visit("step", options.step, {1.000001, 10});
  visit("label_sigma", options.label_sigma, option_ranges::kPositive);
  visit("lambda", options.lambda, option_ranges::kPositive);
  visit("learning_rate", options.learning_rate, option_ranges::kShare);
  visit("cell_size", options.cell_size, {1, option_ranges::kLongestSide});
  visit("max_template_area", options.max_template_area,
        {1, option_ranges::kLongestSide * option_ranges::kLongestSide});
}

inline void visit_options(OptionVisitor& visit, ColorHistogramOptions& options) {
  visit("space", options.space, {"gray", "rgb", "hsv"});
  visit("bins", options.bins, {2, 64});
  visit("sharpness", options.sharpness, option_ranges::kPositive);
  visit("learning_rate", options.learning_rate, option_ranges::kShare);
  visit_window(visit, options.window, option_ranges::kSearchPadding, option_ranges::kSide);
}

inline void visit_options(OptionVisitor& visit, StrcfOptions& options) {
  visit("features", options.features);
  visit("temporal_weight", options.temporal_weight, {0, 1e6});
  visit("target_weight", options.target_weight, {0, 1e6});
  visit("background_weight", options.background_weight, {0, 1e6});
  visit("admm_iterations", options.admm_iterations, {1, 100});
  visit("penalty", options.penalty, {1e-6, 1e6});
  visit("penalty_growth", options.penalty_growth, {1, 1e6});
  visit("max_penalty", options.max_penalty, {1e-6, 1e6});
  visit("label_sigma", options.label_sigma, option_ranges::kPositive);
  visit("cell_size", options.cell_size, {1, option_ranges::kLongestSide});
  visit_window(visit, options.window, {0, option_ranges::kMostPadding}, option_ranges::kSide);
  visit("sub_pixel", options.sub_pixel);
}

inline void visit_options(OptionVisitor& visit, SlicOptions& options) {
  visit("side", options.side, {2, option_ranges::kLongestSide});
  visit("compactness", options.compactness, option_ranges::kPositive);
  visit("iterations", options.iterations, {1, 100});
}

inline void visit_options(OptionVisitor& visit, SuperpixelsOptions& options) {
  visit("slic", options.slic);
  visit("color_sigma", options.color_sigma, option_ranges::kPositive);
  visit("confidence_weight", options.confidence_weight, {0, 1e9});
  visit("sharpness", options.sharpness, option_ranges::kPositive);
  visit("learning_rate", options.learning_rate, option_ranges::kShare);
  visit_window(visit, options.window, option_ranges::kSearchPadding, option_ranges::kSide);
}

inline void visit_options(OptionVisitor& visit, TemplateOptions& options) {
  visit("distance", options.distance, {"ncc", "ssd"});
  visit("color", options.color);
  visit("sigma", options.sigma, option_ranges::kPositive);
  visit("learning_rate", options.learning_rate, option_ranges::kShare);
  visit_window(visit, options.window, option_ranges::kSearchPadding, option_ranges::kSide);
}

#if __has_include(<asterism/parts/models/flow.hpp>)
inline void visit_options(OptionVisitor& visit, FlowOptions& options) {
  visit("grid", options.grid, {2, 100});
  visit("max_error", options.max_error, option_ranges::kPositive);
  visit("lk_window", options.lk_window, {3, 101});
  visit("lk_levels", options.lk_levels, {0, 16});
  visit_window(visit, options.window, option_ranges::kSearchPadding, {8, option_ranges::kLongestSide});
}
#endif

#if __has_include(<asterism/parts/models/keypoints.hpp>)
inline void visit_options(OptionVisitor& visit, KeypointsOptions& options) {
  visit("max_points", options.max_points, {1, 5000});
  visit("fast_threshold", options.fast_threshold, {1, 255});
  visit("max_distance", options.max_distance, {1e-9, 1});
  visit("max_ratio", options.max_ratio, {1e-9, 1});
  visit("vote_radius", options.vote_radius, {1e-9, option_ranges::kLongestSide});
  visit_window(visit, options.window, option_ranges::kSearchPadding, {16, option_ranges::kLongestSide});
}
#endif

}  // namespace ASTERISM_ABI
}  // namespace asterism
