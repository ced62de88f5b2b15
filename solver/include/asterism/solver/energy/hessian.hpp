#pragma once

#include <Eigen/SparseCore>
#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/energy/spring_element.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <cstddef>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace detail {

/// The blocks of the Hessian (with `clamp`, of its clamped form) as matrices store them: add(i, block) is for
/// the diagonal of node i, couple(l, link, block) for both off-diagonal blocks of link l, (i, j) and (j, i).
/// A block may come more than once. A fixed node is coupled to none; its diagonal has the stiffness of its
/// springs, or 1 where these have none.
template <typename System, typename Add, typename Couple>
void for_each_hessian_block(const System& system, const typename System::Points& x, bool clamp, Add&& add,
                            Couple&& couple) {
  using Scalar = typename System::Scalar;
  using Block = Eigen::Matrix<Scalar, System::kDim, System::kDim, Eigen::ColMajor>;
  for_each_curvature(
      system, x, clamp,
      [&](int i, const Block& curvature) {
        const Scalar k = system.anchor_stiffness[i];
        add(i, system.is_fixed(i) ? diagonal<System::kDim>(k > 0 ? k : Scalar(1)) : curvature);
      },
      [&](int l, const Link& link, const LinkForce<Scalar>& force, const Spring<System>& spring) {
        const Block curvature = link_curvature(force, spring);
        const bool fixed_i = system.is_fixed(link.i);
        const bool fixed_j = system.is_fixed(link.j);
        if (fixed_i || fixed_j) [[unlikely]] {
          const Block stiffness = diagonal<System::kDim>(system.link_stiffness[l]);
          add(link.i, fixed_i ? stiffness : curvature);
          add(link.j, fixed_j ? stiffness : curvature);
          return;
        }
        add(link.i, curvature);
        add(link.j, curvature);
        couple(l, link, Block(-curvature));
      });
}

}  // namespace detail

/// A matrix of all coordinates, (Dim N) x (Dim N).
template <typename System>
using DenseHessian = Eigen::Matrix<typename System::Scalar, detail::times<System::kNodes>(System::kDim),
                                   detail::times<System::kNodes>(System::kDim), Eigen::ColMajor,
                                   detail::times<System::kMaxNodes>(System::kDim),
                                   detail::times<System::kMaxNodes>(System::kDim)>;

/// d2E/dx2, (Dim N) x (Dim N), symmetric; coordinate d of node i is row Dim i + d. A spring contributes
/// k_ij (u u^T + (1 - mu_ij / r_ij) (I - u u^T)), indefinite where r_ij < mu_ij. Where two linked nodes
/// coincide and mu_ij > 0, the curvature across the spring is minus infinity and k_ij u u^T alone is used. A
/// fixed node is not coupled to others; its diagonal has the stiffness of its springs. Throws std::bad_alloc
/// if memory runs out.
template <typename System>
DenseHessian<System> hessian(const System& system, const typename System::Points& x) {
  constexpr int kDim = System::kDim;
  if constexpr (System::kMaxNodes == Eigen::Dynamic) {
    const double size = double{kDim} * system.nodes();
    detail::require_memory(sizeof(typename System::Scalar) * size * size);
  }
  DenseHessian<System> result;
  result.setZero(kDim * system.nodes(), kDim * system.nodes());
  const auto add = [&](int i, int j, const auto& block) {
    result.template block<kDim, kDim>(kDim * i, kDim * j) += block;
  };
  detail::for_each_hessian_block(
      system, x, false, [&](int i, const auto& block) { add(i, i, block); },
      [&](int, const Link& link, const auto& block) {
        add(link.i, link.j, block);
        add(link.j, link.i, block);
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
  const auto add = [&](int i, int j, const auto& block) {
    for (int row = 0; row < kDim; ++row) {
      for (int column = 0; column < kDim; ++column) {
        entries.emplace_back(kDim * i + row, kDim * j + column, block(row, column));
      }
    }
  };
  detail::for_each_hessian_block(
      system, x, false, [&](int i, const auto& block) { add(i, i, block); },
      [&](int, const Link& link, const auto& block) {
        add(link.i, link.j, block);
        add(link.j, link.i, block);
      });
  Eigen::SparseMatrix<typename System::Scalar> result(kDim * system.nodes(), kDim * system.nodes());
  result.setFromTriplets(entries.begin(), entries.end());
  return result;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
