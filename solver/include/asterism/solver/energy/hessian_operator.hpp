#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/energy/spring_element.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <cstddef>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// The Hessian of the energy at one x as an operator: a symmetric Dim x Dim block a link, and a node's
/// anchor. Conventions are as in hessian(), except that the rows of fixed nodes are zero.
template <typename System>
class HessianOperator {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;
  static constexpr int kDim = System::kDim;

  /// H at x.
  void set(const System& system, const Points& x) {
    blocks_.resize(kPacked, system.link_count());
    if constexpr (!System::kPlainAnchors) anchor_blocks_.resize(kDim, kDim * system.nodes());
    for_each_spring(
        system, x,
        [&]([[maybe_unused]] int i, [[maybe_unused]] const auto& offset) {
          if constexpr (!System::kPlainAnchors)
            anchor_blocks_.template block<kDim, kDim>(0, kDim * i) =
                anchor_curvature(system, i, offset, false);
        },
        [this](int l, const Link&, const auto& force, const auto& spring) {
          const auto curvature = link_curvature(force, spring);
          int at = 0;
          for (int a = 0; a < kDim; ++a) {
            for (int b = a; b < kDim; ++b) blocks_(at++, l) = curvature(a, b);
          }
        });
  }

  /// result = H v.
  void apply(const System& system, const Points& v, Points& result) const {
    result.resize(kDim, system.nodes());
    if constexpr (System::kPlainAnchors) {
      for (int i = 0; i < system.nodes(); ++i) {
        for (int c = 0; c < kDim; ++c) result(c, i) = system.anchor_stiffness[i] * v(c, i);
      }
    } else {
      for (int i = 0; i < system.nodes(); ++i) {
        result.col(i) = anchor_blocks_.template block<kDim, kDim>(0, kDim * i) * v.col(i);
      }
    }
    int l = 0;
    for (const Link& link : system.links()) {
      const typename System::Point force = times(l++, v.col(link.i) - v.col(link.j));
      result.col(link.i) += force;
      result.col(link.j) -= force;
    }
    clear_fixed(system, result);
  }

 private:
  static constexpr int kPacked = kDim * (kDim + 1) / 2;
  static constexpr int kMaxLinks = System::TopologyType::kMaxLinks;

  typename System::Point times(int l, const typename System::Point& d) const {
    const Scalar* const block = blocks_.data() + static_cast<std::ptrdiff_t>(kPacked) * l;
    if constexpr (kDim == 2) {
      return {block[0] * d[0] + block[1] * d[1], block[1] * d[0] + block[2] * d[1]};
    } else {
      typename System::Point result = System::Point::Zero();
      int at = 0;
      for (int a = 0; a < kDim; ++a) {
        result[a] += block[at++] * d[a];
        for (int b = a + 1; b < kDim; ++b, ++at) {
          result[a] += block[at] * d[b];
          result[b] += block[at] * d[a];
        }
      }
      return result;
    }
  }

  Eigen::Matrix<Scalar, kPacked, Eigen::Dynamic, (kPacked == 1 ? Eigen::RowMajor : Eigen::ColMajor), kPacked,
                kMaxLinks>
      blocks_;  // upper triangles, row by row
  // One Dim x Dim block for each node, side by side.
  Eigen::Matrix<Scalar, kDim, asterism::detail::times<System::kNodes>(kDim),
                (kDim == 1 ? Eigen::RowMajor : Eigen::ColMajor), kDim,
                asterism::detail::times<System::kMaxNodes>(kDim)>
      anchor_blocks_;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
