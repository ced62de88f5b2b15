#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/discrete/displacement_cost.hpp>
#include <asterism/solver/discrete/line_transform.hpp>
#include <asterism/solver/discrete/map_view.hpp>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// The distance transform of a cost that is finite in a window of displacements only, of which nothing else
/// is known: D(q) = min_d f(q + d) + cost(d), for each q the least of as many sums as the window has pixels.
class WindowTransform {
 public:
  /// Prepares for a cost with a window, and for the sizes of f and of the result.
  void plan(const DisplacementCost& cost, int width, int height, int result_width) {
    reach_ = cost.length.reach;
    first_ = cost.first_displacement();
    const int side = 2 * reach_ + 1;
    costs_.resize(static_cast<std::size_t>(side) * static_cast<std::size_t>(side));
    for (int y = 0; y < side; ++y) {
      for (int x = 0; x < side; ++x) {
        costs_[static_cast<std::size_t>(y * side + x)] =
            static_cast<float>(std::min(cost(first_.x() + x, first_.y() + y), kMost));
      }
    }
    stride_ = (std::ptrdiff_t{result_width} + kLineBlock - 1) / kLineBlock * kLineBlock + 2 * reach_;
    require_memory(sizeof(float) * static_cast<double>(stride_) * height);
    const auto size = static_cast<std::size_t>(stride_) * static_cast<std::size_t>(height);
    if (source_.size() < size) source_.resize(size);
    from_ = std::clamp(-std::ptrdiff_t{first_.x()}, std::ptrdiff_t{0}, stride_);
    to_ = std::clamp(std::ptrdiff_t{width} - first_.x(), from_, stride_);
  }

  /// Calls put(x, y, D(x, y)) for all pixels of the result.
  template <typename Put>
  void run(const MapView<const float>& f, int result_width, int result_height, Put&& put) {
    // Rows of f as the queries need them: column b is x = b + first_.x(); infinity beyond the map.
    for (int y = 0; y < f.height; ++y) {
      float* const row = source_.data() + y * stride_;
      std::fill(row, row + from_, kInfinity);
      for (std::ptrdiff_t b = from_; b < to_; ++b) row[b] = f(static_cast<int>(b + first_.x()), y);
      std::fill(row + to_, row + stride_, kInfinity);
    }
    const int side = 2 * reach_ + 1;
    for (int y = 0; y < result_height; ++y) {
      const std::ptrdiff_t top = std::ptrdiff_t{y} + first_.y();
      const auto begin = static_cast<int>(std::clamp<std::ptrdiff_t>(-top, 0, side));
      const auto end = static_cast<int>(std::clamp<std::ptrdiff_t>(f.height - top, begin, side));
      for (int x = 0; x < result_width; x += kLineBlock) {
        constexpr int kVectors = kLineBlock / kFloatLanes;
        FloatLanes least[kVectors];
        for (FloatLanes& of_vector : least) of_vector = FloatLanes{} + kInfinity;
        for (int v = begin; v < end; ++v) {
          const float* const row = source_.data() + (top + v) * stride_ + x;
          const float* const costs = costs_.data() + std::ptrdiff_t{v} * side;
          for (int u = 0; u < side; ++u) {
            for (int k = 0; k < kVectors; ++k) {
              const FloatLanes one =
                  reinterpret_cast<const StoredLanes&>(row[u + k * kFloatLanes]) + costs[u];
              least[k] = one < least[k] ? one : least[k];
            }
          }
        }
        const int count = std::min(kLineBlock, result_width - x);
        for (int k = 0; k < count; ++k) put(x + k, y, least[k / kFloatLanes][k % kFloatLanes]);
      }
    }
  }

 private:
  static constexpr float kInfinity = std::numeric_limits<float>::infinity();
  static constexpr double kMost = std::numeric_limits<float>::max();

  int reach_ = 0;
  Eigen::Vector2i first_ = Eigen::Vector2i::Zero();  // the window's least displacement
  std::vector<float> costs_, source_;
  std::ptrdiff_t stride_ = 0, from_ = 0, to_ = 0;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
