#pragma once

#include <asterism/solver/base/config.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The extent of a target's surroundings that a model sees, and their resolution: options of every model that
/// resamples the image. Each model has its own defaults and ranges; in descriptions, these options are among
/// the model's own.
struct TemplateWindow {
  /// The window adds this many times the geometric mean of the target's sides to both axes.
  double padding = 1.5;
  /// The target is resampled so that the geometric mean of its sides is from `min_template_side` to
  /// `max_template_side` [template pixels].
  double min_template_side = 1;
  double max_template_side = 1024;

  /// Whether min_template_side <= max_template_side.
  bool ordered() const { return min_template_side <= max_template_side; }
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
