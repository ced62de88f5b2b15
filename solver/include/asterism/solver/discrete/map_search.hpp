#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/discrete/displacement_cost.hpp>
#include <asterism/solver/discrete/line_transform.hpp>
#include <asterism/solver/discrete/map_view.hpp>
#include <asterism/solver/problem/defect.hpp>
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

/// The range of the energies of placements, which are summed in floats.
class EnergyRange {
 public:
  /// Counts a part, by the least number of its maps that is negative, or 0.
  void add_least(float least) { least_ += static_cast<double>(least); }
  /// Whether placements may have an energy below all floats, so that they could not be told apart.
  bool is_below_floats() const { return least_ < -kMost; }

  /// Counts a part's map, by its largest finite number.
  void add(const MapView<const float>& map) {
    float largest = 0;
    for (int y = 0; y < map.height; ++y) {
      for (int x = 0; x < map.width; ++x) {
        if (map(x, y) < std::numeric_limits<float>::infinity()) largest = std::max(largest, map(x, y));
      }
    }
    most_ += static_cast<double>(largest);
  }
  /// Counts a joint between parts with these maps, by the most that it may cost.
  void add(const DisplacementCost& cost, const MapView<const float>& parent,
           const MapView<const float>& child) {
    most_ += cost.most(std::max(parent.width, child.width), std::max(parent.height, child.height));
  }
  /// The problem if no placement has a finite energy: those above the range of a float count as forbidden.
  Defect no_placement() const {
    return {
        "maps", Defect::kNoIndex,
        most_ > kMost ? "leave no placement with an energy in the range of float" : "forbid every placement"};
  }

 private:
  static constexpr double kMost = std::numeric_limits<float>::max();

  double least_ = 0, most_ = 0;
};

inline constexpr const char* kBelowFloats = "have negative numbers whose sum is below the range of float";

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
