#pragma once

#include <algorithm>
#include <array>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/energy/newton_kernels.hpp>
#include <asterism/solver/energy/spring_element.hpp>
#include <asterism/solver/problem/model.hpp>
#include <cstddef>
#include <type_traits>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// Hooke's springs between all pairs of nodes, from each of their ends, for the kernel that computes their
/// gradient and Hessian in the machine's widest vectors. The kernel is in the compiled library.
template <typename System>
class FullSprings {
 public:
  using Points = typename System::Points;

  /// Whether systems of this type can be served.
  static constexpr bool kServes = (System::kDim == 2 || System::kDim == 3) &&
                                  std::is_same_v<typename System::Scalar, double> &&
                                  std::is_same_v<typename System::Model::LinkPotential, Hooke>;

  /// Whether the system can be served. With more nodes, a matrix is factored for much longer than it takes to
  /// fill.
  static bool serve(const System& system) {
    return kServes && system.topology().is_full() && !system.has_offsets() && system.nodes() <= kMostNodes;
  }

  /// Takes the springs of a system that is served.
  void set(const System& system) {
    nodes_ = system.nodes();
    stride_ = lanes_v0_1::aligned_rows(nodes_);
    const std::size_t springs = static_cast<std::size_t>(nodes_ * stride_);
    if constexpr (kMaxNodes == Eigen::Dynamic) {
      springs_.resize(2 * springs);
      rows_.resize(kRows * static_cast<std::size_t>(stride_));
    }
    std::fill_n(springs_.begin(), 2 * springs, 0.0);
    std::fill(rows_.begin(), rows_.end(), 0.0);
    double* const stiffness = springs_.data();
    double* const rest_length = stiffness + springs;
    const double *from_stiffness = system.link_stiffness.data(), *from_length = system.rest_length.data();
    for (std::ptrdiff_t i = 0; i < nodes_; ++i) {
      for (std::ptrdiff_t j = i + 1; j < nodes_; ++j) {
        stiffness[i * stride_ + j] = stiffness[j * stride_ + i] = *from_stiffness++;
        rest_length[i * stride_ + j] = rest_length[j * stride_ + i] = *from_length++;
      }
    }
    are_anchors_plain_ = System::kPlainAnchors && !system.has_loads();
    double* const anchors = rows_.data() + (2 * kDim + kEntries) * stride_;
    for (int i = 0; i < nodes_; ++i) {
      if (!(system.anchor_stiffness[i] > 0)) continue;
      for (int c = 0; c < kDim; ++c) anchors[c * stride_ + i] = system.anchors(c, i);
      anchors[kDim * stride_ + i] = system.anchor_stiffness[i];
    }
  }

  /// Writes gradient and Hessian of all springs and anchors at x, and their energy. See
  /// lanes_v0_1::SpringHessian for the matrix. False where a spring is too short for the kernel, or the
  /// result is not finite.
  bool differentiate(const System& system, const Points& x, bool clamp, Points& gradient, double* hessian,
                     std::ptrdiff_t rows, double& energy) {
    double* const points = rows_.data();
    double* const forces = points + kDim * stride_;
    double* const own = forces + kDim * stride_;
    double* const anchors = own + kEntries * stride_;
    for (int i = 0; i < nodes_; ++i) {
      for (int c = 0; c < kDim; ++c) points[c * stride_ + i] = x(c, i);
    }
    energy = 0;
    for (int i = 0; !are_anchors_plain_ && i < nodes_; ++i) {
      const auto offset = anchor_offset(system, i, x);
      const auto node = node_force(system, i, x, offset);
      energy += node.energy;
      for (int c = 0; c < kDim; ++c) forces[c * stride_ + i] = node.gradient[c];
      const auto curvature = anchor_curvature(system, i, offset, clamp);
      for (int c = 0, entry = 0; c < kDim; ++c) {
        for (int r = 0; r <= c; ++r, ++entry) own[entry * stride_ + i] = curvature(r, c);
      }
    }
    const lanes_v0_1::SpringHessian springs{.nodes = nodes_,
                                            .dim = kDim,
                                            .stride = stride_,
                                            .stiffness = springs_.data(),
                                            .rest_length = springs_.data() + nodes_ * stride_,
                                            .points = points,
                                            .anchors = are_anchors_plain_ ? anchors : nullptr,
                                            .anchor_stiffness = anchors + kDim * stride_,
                                            .clamp = clamp,
                                            .gradient = forces,
                                            .own = own,
                                            .hessian = hessian,
                                            .rows = rows};
    energy += lanes_v0_1::differentiate(springs);
    if (!is_finite(energy)) [[unlikely]]
      return false;
    gradient.resize(kDim, nodes_);
    for (int i = 0; i < nodes_; ++i) {
      for (int c = 0; c < kDim; ++c) gradient(c, i) = forces[c * stride_ + i];
    }
    return true;
  }

 private:
  static constexpr int kDim = System::kDim;
  static constexpr int kMaxNodes = System::kMaxNodes;
  static constexpr int kMostNodes = 128;
  static constexpr int kEntries = kDim * (kDim + 1) / 2;
  static constexpr std::size_t kRows = kDim + kDim + kEntries + kDim + 1;  // for each node
  static constexpr std::size_t kMaxStride =
      kMaxNodes == Eigen::Dynamic ? 0 : static_cast<std::size_t>(lanes_v0_1::aligned_rows(kMaxNodes));
  template <std::size_t kCount>
  using Storage =
      std::conditional_t<kMaxNodes == Eigen::Dynamic, std::vector<double>, std::array<double, kCount>>;

  int nodes_ = 0;
  std::ptrdiff_t stride_ = 0;
  Storage<2 * kMaxStride * kMaxStride> springs_{};  // stiffness and rest length, a row for each node
  Storage<kRows * kMaxStride> rows_{};  // coordinates, gradient, own blocks, anchors and their stiffness
  bool are_anchors_plain_ = false;      // the kernel knows them
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
