#pragma once

/// The names of the options of the library's models, those of their members, for PartRegistry and for options
/// that contain them.

#include <asterism/parts/color_histogram.hpp>
#include <asterism/parts/kcf.hpp>
#include <asterism/parts/mosse.hpp>
#include <asterism/parts/option_visitor.hpp>
#include <asterism/parts/scale_filter.hpp>
#include <asterism/parts/spatial_reliability.hpp>
#include <asterism/parts/superpixels.hpp>
#include <asterism/parts/template.hpp>
#if __has_include(<asterism/parts/flow.hpp>)  // only installed where it was built
#include <asterism/parts/flow.hpp>
#endif
#if __has_include(<asterism/parts/keypoints.hpp>)
#include <asterism/parts/keypoints.hpp>
#endif

namespace asterism::inline ASTERISM_ABI {

inline void visit_options(OptionVisitor& visit, Kernel& kernel) {
  visit("type", kernel.type, {"gaussian", "polynomial", "linear"});
  visit("sigma", kernel.sigma);
  visit("offset", kernel.offset);
  visit("exponent", kernel.exponent);
}

inline void visit_options(OptionVisitor& visit, KcfFeatures& features) {
  visit("hog", features.hog);
  visit("gray", features.gray);
  visit("colour", features.colour);
}

inline void visit_options(OptionVisitor& visit, KcfOptions& options) {
  visit("features", options.features);
  visit("kernel", options.kernel);
  visit("lambda", options.lambda);
  visit("learning_rate", options.learning_rate);
  visit("label_sigma", options.label_sigma);
  visit("cell_size", options.cell_size);
  visit("padding", options.padding);
  visit("proportional_window", options.proportional_window);
  visit("min_template_side", options.min_template_side);
  visit("max_template_side", options.max_template_side);
  visit("separate_update", options.separate_update);
  visit("sub_pixel", options.sub_pixel);
}

inline void visit_options(OptionVisitor& visit, MosseOptions& options) {
  visit("learning_rate", options.learning_rate);
  visit("label_sigma", options.label_sigma);
  visit("regularisation", options.regularisation);
  visit("perturbations", options.perturbations);
  visit("perturbation", options.perturbation);
  visit("padding", options.padding);
  visit("min_template_side", options.min_template_side);
  visit("max_template_side", options.max_template_side);
}

inline void visit_options(OptionVisitor& visit, MrfOptions& options) {
  visit("enabled", options.enabled);
  visit("max_iterations", options.max_iterations);
  visit("tolerance", options.tolerance);
  visit("neighbourhood", options.neighbourhood);
}

inline void visit_options(OptionVisitor& visit, ColourOptions& options) {
  visit("histogram_rate", options.histogram_rate);
  visit("surrounding", options.surrounding);
  visit("foreground_prior", options.foreground_prior);
  visit("min_area_ratio", options.min_area_ratio);
  visit("max_area_ratio", options.max_area_ratio);
  visit("uniform_weight", options.uniform_weight);
  visit("mrf", options.mrf);
}

inline void visit_options(OptionVisitor& visit, MaskedRegressionOptions& options) {
  visit("lambda", options.lambda);
  visit("iterations", options.iterations);
  visit("refining_iterations", options.refining_iterations);
  visit("penalty", options.penalty);
  visit("penalty_growth", options.penalty_growth);
  visit("max_penalty", options.max_penalty);
}

inline void visit_options(OptionVisitor& visit, SpatialReliabilityOptions& options) {
  visit("regression", options.regression);
  visit("learning_rate", options.learning_rate);
  visit("weight_rate", options.weight_rate);
  visit("label_sigma", options.label_sigma);
  visit("cell_size", options.cell_size);
  visit("colour_channels", options.colour_channels);
  visit("padding", options.padding);
  visit("min_template_side", options.min_template_side);
  visit("max_template_side", options.max_template_side);
  visit("segmentation", options.segmentation);
  visit("min_mask_area", options.min_mask_area);
  visit("max_mask_area", options.max_mask_area);
  visit("colour", options.colour);
  visit("channel_weights", options.channel_weights);
  visit("detection_weights", options.detection_weights);
}

inline void visit_options(OptionVisitor& visit, ScaleFilterOptions& options) {
  visit("scales", options.scales);
  visit("step", options.step);
  visit("label_sigma", options.label_sigma);
  visit("lambda", options.lambda);
  visit("learning_rate", options.learning_rate);
  visit("cell_size", options.cell_size);
  visit("max_template_area", options.max_template_area);
}

inline void visit_options(OptionVisitor& visit, ColorHistogramOptions& options) {
  visit("space", options.space, {"gray", "rgb", "hsv"});
  visit("bins", options.bins);
  visit("sharpness", options.sharpness);
  visit("learning_rate", options.learning_rate);
  visit("padding", options.padding);
  visit("min_template_side", options.min_template_side);
  visit("max_template_side", options.max_template_side);
}

inline void visit_options(OptionVisitor& visit, SlicOptions& options) {
  visit("side", options.side);
  visit("compactness", options.compactness);
  visit("iterations", options.iterations);
}

inline void visit_options(OptionVisitor& visit, SuperpixelsOptions& options) {
  visit("slic", options.slic);
  visit("colour_sigma", options.colour_sigma);
  visit("confidence_weight", options.confidence_weight);
  visit("sharpness", options.sharpness);
  visit("learning_rate", options.learning_rate);
  visit("padding", options.padding);
  visit("min_template_side", options.min_template_side);
  visit("max_template_side", options.max_template_side);
}

inline void visit_options(OptionVisitor& visit, TemplateOptions& options) {
  visit("distance", options.distance, {"ncc", "ssd"});
  visit("colour", options.colour);
  visit("sigma", options.sigma);
  visit("learning_rate", options.learning_rate);
  visit("padding", options.padding);
  visit("min_template_side", options.min_template_side);
  visit("max_template_side", options.max_template_side);
}

#if __has_include(<asterism/parts/flow.hpp>)
inline void visit_options(OptionVisitor& visit, FlowOptions& options) {
  visit("grid", options.grid);
  visit("max_error", options.max_error);
  visit("lk_window", options.lk_window);
  visit("lk_levels", options.lk_levels);
  visit("padding", options.padding);
  visit("min_template_side", options.min_template_side);
  visit("max_template_side", options.max_template_side);
}
#endif

#if __has_include(<asterism/parts/keypoints.hpp>)
inline void visit_options(OptionVisitor& visit, KeypointsOptions& options) {
  visit("max_points", options.max_points);
  visit("fast_threshold", options.fast_threshold);
  visit("max_distance", options.max_distance);
  visit("max_ratio", options.max_ratio);
  visit("vote_radius", options.vote_radius);
  visit("padding", options.padding);
  visit("min_template_side", options.min_template_side);
  visit("max_template_side", options.max_template_side);
}
#endif

}  // namespace asterism::inline ASTERISM_ABI
