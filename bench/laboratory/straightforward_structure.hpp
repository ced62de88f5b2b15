#pragma once

#include <asterism/solver/discrete/pictorial_structure.hpp>
#include <span>
#include <vector>

namespace asterism::bench {

/// A star of parts with maps of one size, without gaps, and quadratic costs, solved as the algorithm's paper
/// writes it down (Felzenszwalb and Huttenlocher 2012): the lower envelope of parabolas in floats, one line
/// after the other, rows first, with the places kept for all pixels. Part 0 is the root. What the library is
/// compared with; compiled with -O2.
class StraightforwardStar {
 public:
  void solve(std::span<const Joint> joints, std::span<const MapView<const float>> maps, PartPlacement& best);
  /// The transform of one map to `result`, both of this size.
  void transform(const float* f, int width, int height, const DisplacementCost& cost, float* result,
                 int* place_x, int* place_y);

 private:
  void line(const float* f, int count, int stride, const AxisCost& cost, float* result, int* place);

  std::vector<float> begin_, between_, message_, sum_;
  std::vector<int> site_;
  std::vector<std::vector<int>> place_x_, place_y_;  // of each joint
};

}  // namespace asterism::bench
