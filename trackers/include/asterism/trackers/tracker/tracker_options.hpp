#pragma once

/// The names of the trackers' options, those of their members, for descriptions in JSON (PartRegistry::read).

#include <asterism/parts/concept/part_options.hpp>
#include <asterism/trackers/around/kalman.hpp>
#include <asterism/trackers/constellation/elastic.hpp>
#include <asterism/trackers/dpt/dpt.hpp>
#include <asterism/trackers/others/lgt.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

inline void visit_options(OptionVisitor& visit, MotionOptions& options) {
  visit("histogram_rate", options.histogram_rate, option_ranges::kShare);
  visit("novelty", options.novelty, option_ranges::kProbability);
  visit("background_novelty", options.background_novelty, option_ranges::kProbability);
  visit("foreground_prior", options.foreground_prior, option_ranges::kProbability);
  visit_window(visit, options.window, {1, option_ranges::kMostPadding}, {8, option_ranges::kLongestSide});
}

inline void visit_options(OptionVisitor& visit, CoarseOptions& options) {
  visit("root", options.root, "kcf");
  visit("color", options.color);
  visit("use_color", options.use_color);
  visit("color_share", options.color_share, option_ranges::kShare);
  visit("sub_pixel", options.sub_pixel);
  visit("lost_below", options.lost_below, {-1e9, 1e9});
}

inline void visit_options(OptionVisitor& visit, StiffnessLaw& law) {
  visit("peak_exponent", law.peak_exponent, {0, 4});
  visit("variance_exponent", law.variance_exponent, {0, 4});
  visit("link_scale", law.link_scale, option_ranges::kPositive);
  visit("strain_exponent", law.strain_exponent, {0, 8});
  visit("strain_floor", law.strain_floor, {0, 1e3});
}

inline void visit_options(OptionVisitor& visit, DptOptions& options) {
  visit("coarse", options.coarse);
  visit("part", options.part, "kcf");
  visit("grid_rows", options.grid_rows, {1, DptOptions::kMaxParts});
  visit("grid_cols", options.grid_cols, {1, DptOptions::kMaxParts});
  visit("overlap", options.overlap, {0, 0.99});
  visit("constellation", options.constellation, {"full", "local", "star"});
  visit("spring_rate", options.spring_rate, option_ranges::kShare);
  visit("response_gate", options.response_gate, {-1e9, 1e9});
  visit("mask_gate", options.mask_gate, {-1e9, 1e9});
  visit("transform", options.transform, {"euclidean", "similarity"});
  visit("root_weight", options.root_weight, {0, 1e9});
  visit("scale_filter_share", options.scale_filter_share, option_ranges::kShare);
  visit("scale", options.scale);
  visit("stiffness", options.stiffness);
  visit("solver", options.solver, options.solver.name);
  visit("certify", options.certify);
  visit("judge", options.judge);
  visit("threads", options.threads, {0, 256});
}

inline void visit_options(OptionVisitor& visit, KalmanOptions& options) {
  visit("acceleration", options.acceleration, {1e-6, 1e6});
  visit("size_acceleration", options.size_acceleration, {1e-6, 1e6});
  visit("deviation", options.deviation, {1e-6, 1e6});
  visit("size_deviation", options.size_deviation, {1e-6, 1e6});
  visit("lost_factor", options.lost_factor, {1, 1e12});
}

inline void visit_options(OptionVisitor& visit, ElasticOptions& options) {
  visit("deformation", options.deformation, option_ranges::kPositive);
  visit("reach", options.reach, option_ranges::kPositive);
  visit("solver", options.solver);
}

inline void visit_options(OptionVisitor& visit, LgtOptions& options) {
  visit("part", options.part, "color_histogram");
  visit("max_parts", options.max_parts, {1, 100});
  visit("color", options.color);
  visit("motion", options.motion);
  visit("use_color", options.use_color);
  visit("use_motion", options.use_motion);
  visit("use_shape", options.use_shape);
  visit("translation", options.translation, {0, 1e3});
  visit("rotation", options.rotation, {0, 10});
  visit("scale", options.scale, {0, 1});
  visit("springs", options.springs);
  visit("sharpness", options.sharpness, option_ranges::kPositive);
  visit("weight_rate", options.weight_rate, {1e-9, 1});
  visit("remove_below", options.remove_below, option_ranges::kShare);
  visit("box", options.box, {"bounds", "spread"});
  visit("lost_below", options.lost_below, option_ranges::kShare);
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
