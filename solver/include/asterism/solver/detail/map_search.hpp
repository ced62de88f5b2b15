#pragma once

#include <algorithm>
#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/line_transform.hpp>
#include <asterism/solver/discrete/map_view.hpp>
#include <cmath>
#include <limits>
#include <utility>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// The first of the least numbers of a map whose rows have no gaps; false if none is finite.
inline bool find_least(const MapView<const float>& map, int& x, int& y) {
  float least = std::numeric_limits<float>::infinity();
  bool found = false;
  for (int row = 0; row < map.height; ++row) {
    const float of_row = least_of(map.row(row), map.width);
    if (!(of_row < least)) continue;
    least = of_row;
    y = row;
    found = true;
  }
  if (found) x = static_cast<int>(std::find(map.row(y), map.row(y) + map.width, least) - map.row(y));
  return found;
}

/// Whether a pixel is within a distance [px] of another.
inline bool is_near(int dx, int dy, double distance) {
  const double x = dx, y = dy;
  return x * x + y * y <= distance * distance;
}

/// Forbids the pixels within a distance [px] of (x, y).
inline void forbid_near(const MapView<float>& map, int x, int y, double distance) {
  const auto reach = [distance](int at, int size) {
    return std::pair(static_cast<int>(std::max(0.0, std::ceil(at - distance))),
                     static_cast<int>(std::min(size - 1.0, std::floor(at + distance))));
  };
  const auto [left, right] = reach(x, map.width);
  const auto [top, bottom] = reach(y, map.height);
  for (int v = top; v <= bottom; ++v) {
    for (int u = left; u <= right; ++u) {
      if (is_near(u - x, v - y, distance)) map(u, v) = std::numeric_limits<float>::infinity();
    }
  }
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
