#pragma once

#include <asterism/solver/detail/config.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

/// How much of a target's surroundings a model sees, and at which resolution: options of every model that
/// resamples the image. Defaults and ranges are each model's; in descriptions these options stand among the
/// model's own.
struct TemplateWindow {
  /// The window adds this much around the target, x the geometric mean of its sides on both axes.
  double padding = 1.5;
  /// The target is resampled so that the geometric mean of its sides is in this range [template pixels]:
  /// min_template_side <= max_template_side.
  double min_template_side = 1;
  double max_template_side = 1024;

  /// Whether the range is one.
  bool ordered() const { return min_template_side <= max_template_side; }
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
