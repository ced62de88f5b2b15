#pragma once

#include <algorithm>
#include <array>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/energy/full_springs.hpp>
#include <asterism/solver/energy/newton_kernels.hpp>
#include <asterism/solver/energy/spring_element.hpp>
#include <cstddef>
#include <type_traits>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// Hooke's springs between all pairs of nodes, each once, for the kernel that computes their gradient in the
/// machine's widest vectors (lanes_v0_1::SpringTiles). The kernel is in the compiled library.
template <typename System>
class TiledSprings {
 public:
  using Points = typename System::Points;

  /// Whether systems of this type can be served.
  static constexpr bool kServes = FullSprings<System>::kServes;

  /// Whether the system can be served.
  static bool serve(const System& system) {
    return kServes && system.topology().is_full() && !system.has_offsets();
  }

  /// Takes the springs of a system that is served.
  void set(const System& system) {
    nodes_ = system.nodes();
    stride_ = lanes_v0_1::aligned_rows(nodes_);
    if constexpr (kMaxNodes == Eigen::Dynamic) {
      springs_.resize(static_cast<std::size_t>(stride_ * stride_));
      rows_.resize(kRows * static_cast<std::size_t>(stride_));
    }
    std::fill(springs_.begin(), springs_.end(), 0.0);
    std::fill(rows_.begin(), rows_.end(), 0.0);
    set_springs(system);
    for (std::ptrdiff_t i = nodes_; i < stride_; ++i)
      rows_[static_cast<std::size_t>(i)] = kFar * static_cast<double>(i - nodes_ + 1);
    are_anchors_plain_ = System::kPlainAnchors && !system.has_loads();
    double* const anchors = rows_.data() + 2 * kDim * stride_;
    for (int i = 0; i < nodes_; ++i) {
      if (!(system.anchor_stiffness[i] > 0)) continue;
      for (int c = 0; c < kDim; ++c) anchors[c * stride_ + i] = system.anchors(c, i);
      anchors[kDim * stride_ + i] = system.anchor_stiffness[i];
    }
  }

  /// Writes the points from + step * direction, the gradient of all springs and anchors there, their energy,
  /// and the slope along `direction`. False where two nodes are too near for the kernel, or the result is not
  /// finite.
  bool differentiate(const System& system, const Points& from, const Points& direction, double step,
                     Points& to, Points& gradient, double& energy, double& slope) {
    double* const points = rows_.data();
    double* const forces = points + kDim * stride_;
    double* const anchors = forces + kDim * stride_;
    to.resize(kDim, nodes_);
    gradient.resize(kDim, nodes_);
    energy = 0;
    if (!are_anchors_plain_) {
      to = from + step * direction;
      for (int i = 0; i < nodes_; ++i) {
        const auto node = node_force(system, i, to, anchor_offset(system, i, to));
        energy += node.energy;
        for (int c = 0; c < kDim; ++c) forces[c * stride_ + i] = node.gradient[c];
      }
    }
    const auto [of_kernel, along] =
        lanes_v0_1::differentiate({.nodes = nodes_,
                                   .dim = kDim,
                                   .stride = stride_,
                                   .springs = springs_.data(),
                                   .anchors = are_anchors_plain_ ? anchors : nullptr,
                                   .anchor_stiffness = anchors + kDim * stride_,
                                   .points = points,
                                   .forces = forces,
                                   .from = are_anchors_plain_ ? from.data() : to.data(),
                                   .direction = direction.data(),
                                   .step = are_anchors_plain_ ? step : 0,
                                   .to = to.data(),
                                   .gradient = gradient.data()});
    energy += of_kernel;
    slope = along;
    return is_finite(energy);
  }

 private:
  static constexpr int kDim = System::kDim;
  static constexpr int kMaxNodes = System::kMaxNodes;
  static constexpr double kFar = 1e150;               // the square of which is finite
  static constexpr std::size_t kRows = 3 * kDim + 1;  // for each node
  static constexpr std::size_t kMaxStride =
      kMaxNodes == Eigen::Dynamic ? 0 : static_cast<std::size_t>(lanes_v0_1::aligned_rows(kMaxNodes));
  template <std::size_t kCount>
  using Storage =
      std::conditional_t<kMaxNodes == Eigen::Dynamic, std::vector<double>, std::array<double, kCount>>;

  // See lanes_v0_1::SpringTiles.
  void set_springs(const System& system) {
    const std::ptrdiff_t lanes = lanes_v0_1::lanes(), groups = (nodes_ + lanes - 1) / lanes;
    const double *stiffness = system.link_stiffness.data(), *rest_length = system.rest_length.data();
    double* row = springs_.data();  // of the tiles of a group and those that follow it
    for (std::ptrdiff_t a = 0; a < groups; ++a) {
      const std::ptrdiff_t first = a * lanes, end = std::min<std::ptrdiff_t>(first + lanes, nodes_);
      for (std::ptrdiff_t i = first; i < end; ++i) {
        for (std::ptrdiff_t j = i + 1; j < nodes_; ++j) {
          std::ptrdiff_t lane = i - first, diagonal = (j - i) % lanes;
          if (j < first + lanes) {
            if (diagonal > lanes / 2) lane = j - first, diagonal = lanes - diagonal;
            --diagonal;  // there is no 0
          } else {
            diagonal += (j / lanes - a) * lanes - lanes / 2;
          }
          double* const spring = row + diagonal * 2 * lanes + lane;
          spring[0] = *stiffness++;
          spring[lanes] = *rest_length++;
        }
      }
      row += ((groups - a) * lanes - lanes / 2) * 2 * lanes;
    }
  }

  int nodes_ = 0;
  std::ptrdiff_t stride_ = 0;
  Storage<kMaxStride * kMaxStride> springs_{};
  Storage<kRows * kMaxStride> rows_{};  // coordinates, forces, anchors and their stiffness
  bool are_anchors_plain_ = false;      // the kernel knows them
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
