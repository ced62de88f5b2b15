#pragma once

#include <Eigen/SparseCore>
#include <algorithm>
#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/memory.hpp>
#include <asterism/solver/energy/spring_element.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <cstddef>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace detail {

/// Calls add(node, node, block) for the Dim x Dim blocks of the Hessian; a block may come more than once.
/// With `clamp`, curvature below 0 counts as 0, which makes the matrix positive semi-definite. A fixed node
/// is coupled to none and has its springs' stiffness on the diagonal.
template <typename System, typename Add>
void for_each_hessian_block(const System& system, const typename System::Points& x, bool clamp, Add&& add) {
  using Scalar = typename System::Scalar;
  using Block = Eigen::Matrix<Scalar, System::kDim, System::kDim, Eigen::ColMajor>;
  for (int i = 0; i < system.nodes(); ++i) {
    if (system.is_fixed(i)) [[unlikely]] {
      const Scalar k = system.anchor_stiffness[i];
      add(i, i, Block((k > 0 ? k : Scalar(1)) * Block::Identity()));
    } else {
      add(i, i, anchor_curvature(system, i, anchor_offset(system, i, x), clamp));
    }
  }
  int l = 0;
  for (const Link& link : system.links()) {
    const auto [length, direction] = spring(system, link, x.col(link.i) - x.col(link.j));
    auto force = link_force(system, l, length);
    if (clamp) {
      force.along = std::max(force.along, Scalar(0));
      force.across = std::max(force.across, Scalar(0));
    }
    const Block along = direction * direction.transpose();
    const Block block = force.along * along + force.across * (Block::Identity() - along);
    const Block stiffness = system.link_stiffness[l] * Block::Identity();
    const bool fixed_i = system.is_fixed(link.i);
    const bool fixed_j = system.is_fixed(link.j);
    add(link.i, link.i, fixed_i ? stiffness : block);
    add(link.j, link.j, fixed_j ? stiffness : block);
    if (!fixed_i && !fixed_j) {
      add(link.i, link.j, Block(-block));
      add(link.j, link.i, Block(-block));
    }
    ++l;
  }
}

}  // namespace detail

/// Of all coordinates, (Dim N) x (Dim N).
template <typename System>
using DenseHessian = Eigen::Matrix<typename System::Scalar, detail::times<System::kNodes>(System::kDim),
                                   detail::times<System::kNodes>(System::kDim), Eigen::ColMajor,
                                   detail::times<System::kMaxNodes>(System::kDim),
                                   detail::times<System::kMaxNodes>(System::kDim)>;

/// d2E/dx2, (Dim N) x (Dim N), symmetric; coordinate d of node i is row Dim i + d. A spring contributes
/// k_ij (u u^T + (1 - mu_ij / r_ij) (I - u u^T)), indefinite where r_ij < mu_ij. Where two linked nodes
/// coincide and mu_ij > 0, the curvature across the spring is minus infinity and k_ij u u^T alone is used. A
/// fixed node is coupled to none; its diagonal has the stiffness of its springs. Throws a std::bad_alloc
/// where it does not fit into memory.
template <typename System>
DenseHessian<System> hessian(const System& system, const typename System::Points& x) {
  constexpr int kDim = System::kDim;
  if constexpr (System::kMaxNodes == Eigen::Dynamic) {
    const double size = double{kDim} * system.nodes();
    detail::require_memory(sizeof(typename System::Scalar) * size * size);
  }
  DenseHessian<System> result;
  result.setZero(kDim * system.nodes(), kDim * system.nodes());
  detail::for_each_hessian_block(system, x, false, [&](int i, int j, const auto& block) {
    result.template block<kDim, kDim>(kDim * i, kDim * j) += block;
  });
  return result;
}

/// The same as a sparse matrix with both triangles.
template <typename System>
Eigen::SparseMatrix<typename System::Scalar> sparse_hessian(const System& system,
                                                            const typename System::Points& x) {
  constexpr int kDim = System::kDim;
  detail::require_entries(double{kDim} * kDim * (system.nodes() + 4.0 * system.link_count()),
                          sizeof(typename System::Scalar), 3);  // and its triplets
  std::vector<Eigen::Triplet<typename System::Scalar>> entries;
  entries.reserve(static_cast<std::size_t>(kDim) * kDim *
                  (static_cast<std::size_t>(system.nodes()) + 4 * system.links().size()));
  detail::for_each_hessian_block(system, x, false, [&](int i, int j, const auto& block) {
    for (int row = 0; row < kDim; ++row) {
      for (int column = 0; column < kDim; ++column) {
        entries.emplace_back(kDim * i + row, kDim * j + column, block(row, column));
      }
    }
  });
  Eigen::SparseMatrix<typename System::Scalar> result(kDim * system.nodes(), kDim * system.nodes());
  result.setFromTriplets(entries.begin(), entries.end());
  return result;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
