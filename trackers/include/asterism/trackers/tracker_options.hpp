#pragma once

#include <asterism/parts/part_options.hpp>
#include <asterism/trackers/dpt.hpp>
#include <asterism/trackers/elastic.hpp>
#include <asterism/trackers/kalman.hpp>
#include <asterism/trackers/lgt.hpp>
#include <asterism/trackers/superpixel_tracker.hpp>
#if __has_include(<asterism/trackers/flock.hpp>)  // only installed where it was built
#include <asterism/trackers/flock.hpp>
#endif
#if __has_include(<asterism/trackers/keypoint_tracker.hpp>)
#include <asterism/trackers/keypoint_tracker.hpp>
#endif

/// The names of the trackers' options, those of their members, for descriptions in JSON (PartRegistry::read).

namespace asterism::inline ASTERISM_ABI {

inline void visit_options(OptionVisitor& visit, SolverOptions& options) {
  visit("tolerance", options.tolerance);
  visit("max_iterations", options.max_iterations);
}

inline void visit_options(OptionVisitor& visit, MotionOptions& options) {
  visit("histogram_rate", options.histogram_rate);
  visit("novelty", options.novelty);
  visit("background_novelty", options.background_novelty);
  visit("foreground_prior", options.foreground_prior);
  visit("padding", options.padding);
  visit("min_template_side", options.min_template_side);
  visit("max_template_side", options.max_template_side);
}

inline void visit_options(OptionVisitor& visit, CoarseOptions& options) {
  visit("root", options.root, "kcf");
  visit("colour", options.colour);
  visit("use_colour", options.use_colour);
  visit("colour_share", options.colour_share);
  visit("sub_pixel", options.sub_pixel);
  visit("lost_below", options.lost_below);
  visit("redetect", options.redetect);
  visit("motion", options.motion);
  visit("motion_share", options.motion_share);
}

inline void visit_options(OptionVisitor& visit, DptOptions& options) {
  visit("coarse", options.coarse);
  visit("part", options.part, "kcf");
  visit("grid_rows", options.grid_rows);
  visit("grid_cols", options.grid_cols);
  visit("overlap", options.overlap);
  visit("constellation", options.constellation, {"full", "local", "star"});
  visit("spring_rate", options.spring_rate);
  visit("response_gate", options.response_gate);
  visit("mask_gate", options.mask_gate);
  visit("smoothness", options.smoothness);
  visit("transform", options.transform, {"translation", "euclidean", "similarity"});
  visit("scale_share", options.scale_share);
  visit("scale", options.scale);
  visit("resize_parts", options.resize_parts);
  visit("anchor_law", options.anchor_law, {"variance", "covariance"});
  visit("spring_solver", options.spring_solver, {"ida", "newton"});
  visit("solver", options.solver);
  visit("threads", options.threads);
}

inline void visit_options(OptionVisitor& visit, KalmanOptions& options) {
  visit("acceleration", options.acceleration);
  visit("size_acceleration", options.size_acceleration);
  visit("deviation", options.deviation);
  visit("size_deviation", options.size_deviation);
  visit("lost_factor", options.lost_factor);
}

inline void visit_options(OptionVisitor& visit, ElasticOptions& options) {
  visit("deformation", options.deformation);
  visit("reach", options.reach);
  visit("solver", options.solver);
}

#if __has_include(<asterism/trackers/flock.hpp>)
inline void visit_options(OptionVisitor& visit, PointFlowOptions& options) {
  visit("max_error", options.max_error);
  visit("lk_window", options.lk_window);
  visit("lk_levels", options.lk_levels);
  visit("padding", options.padding);
  visit("min_template_side", options.min_template_side);
  visit("max_template_side", options.max_template_side);
}

inline void visit_options(OptionVisitor& visit, FlockOptions& options) {
  visit("flow", options.flow);
  visit("grid", options.grid);
  visit("neighbours", options.neighbours);
  visit("springs", options.springs);
  visit("max_residual", options.max_residual);
  visit("centre_weight", options.centre_weight);
  visit("layout_rate", options.layout_rate);
  visit("lost_below", options.lost_below);
}
#endif

#if __has_include(<asterism/trackers/keypoint_tracker.hpp>)
inline void visit_options(OptionVisitor& visit, KeypointTrackerOptions& options) {
  visit("flow", options.flow);
  visit("max_parts", options.max_parts);
  visit("max_points", options.max_points);
  visit("fast_threshold", options.fast_threshold);
  visit("max_distance", options.max_distance);
  visit("max_ratio", options.max_ratio);
  visit("padding", options.padding);
  visit("max_padding", options.max_padding);
  visit("neighbours", options.neighbours);
  visit("springs", options.springs);
  visit("centre_weight", options.centre_weight);
  visit("forget_after", options.forget_after);
  visit("min_agreeing", options.min_agreeing);
  visit("lost_below", options.lost_below);
}
#endif

inline void visit_options(OptionVisitor& visit, LgtOptions& options) {
  visit("part", options.part, "color_histogram");
  visit("colour", options.colour);
  visit("max_parts", options.max_parts);
  visit("part_side", options.part_side);
  visit("springs", options.springs);
  visit("sharpness", options.sharpness);
  visit("weight_rate", options.weight_rate);
  visit("remove_below", options.remove_below);
  visit("layout_rate", options.layout_rate);
  visit("lost_below", options.lost_below);
}

inline void visit_options(OptionVisitor& visit, SuperpixelTrackerOptions& options) {
  visit("slic", options.slic);
  visit("template_side", options.template_side);
  visit("padding", options.padding);
  visit("colour_sigma", options.colour_sigma);
  visit("neighbours", options.neighbours);
  visit("springs", options.springs);
  visit("learning_rate", options.learning_rate);
  visit("forget_after", options.forget_after);
  visit("lost_below", options.lost_below);
}

}  // namespace asterism::inline ASTERISM_ABI
