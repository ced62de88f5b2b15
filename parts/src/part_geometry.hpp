#pragma once

#include <algorithm>
#include <asterism/parts/frame.hpp>
#include <cmath>
#include <stdexcept>

// What the part models share of checks and sizes.
namespace asterism::inline ASTERISM_ABI {

/// However thin a target is, its window is no longer than this [template pixels].
inline constexpr double kMaxWindowSide = 1024;

inline void require(bool holds, const char* what) {
  if (!holds) throw std::invalid_argument(what);
}

/// The contract of PartModel::init.
inline void require_target(const Point2& centre, const Size2& size) {
  require(centre.allFinite(), "part: the centre must be finite");
  require(size.allFinite() && size.minCoeff() > 0, "part: the size must be finite and positive");
}

/// Geometric mean of the sides, of any size that is finite.
inline double mean_side(const Size2& size) { return std::sqrt(size.x()) * std::sqrt(size.y()); }

/// Template pixels an image pixel: the mean side of the target is min_side .. max_side in the template, and
/// unscaled between; no side of a window that adds `padding` x the mean side to both exceeds kMaxWindowSide.
inline double template_scale(const Size2& size, double padding, double min_side, double max_side) {
  const double side = mean_side(size);
  return std::min(std::clamp(side, min_side, max_side) / side,
                  kMaxWindowSide / (size.maxCoeff() + padding * side));
}

}  // namespace asterism::inline ASTERISM_ABI
