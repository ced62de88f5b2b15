#pragma once

#include <Eigen/SparseCore>
#include <algorithm>
#include <asterism/solver/config.hpp>
#include <asterism/solver/forces.hpp>
#include <asterism/solver/memory.hpp>
#include <asterism/solver/spring_rows.hpp>
#include <asterism/solver/spring_system.hpp>
#include <cstddef>
#include <vector>

namespace asterism::inline ASTERISM_ABI {

namespace detail {

/// Gradient and, if wanted, energy (else some number) in one pass over the springs.
template <bool kWithEnergy, typename System>
typename System::Scalar evaluate(const System& system, const typename System::Points& x,
                                 typename System::Points& gradient) {
  using Scalar = typename System::Scalar;
  using Point = typename System::Point;
  gradient.resize(System::kDim, system.nodes());
  Scalar energy = 0;
  for (int i = 0; i < system.nodes(); ++i) {
    const auto anchor = anchor_force(system, i, anchor_offset(system, i, x));
    gradient.col(i) = anchor.gradient;
    if constexpr (kWithEnergy) energy += anchor.energy;
  }
  if (SpringRows<System>::serve(system)) {
    energy += SpringRows<System>::evaluate(system, x, gradient);
  } else {
    int l = 0;
    for (const Link& link : system.links()) {
      const auto [length, direction] = spring(system, link, x.col(link.i) - x.col(link.j));
      const auto phi = link_potential(system, l, length);
      const Scalar k = system.link_stiffness[l];
      const Point force = (k * phi.first) * direction;
      gradient.col(link.i) += force;
      gradient.col(link.j) -= force;
      if constexpr (kWithEnergy) energy += k * phi.value;
      ++l;
    }
  }
  clear_fixed(system, gradient);
  return energy;
}

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

template <int N>
constexpr int times(int factor) {
  return N == Eigen::Dynamic ? Eigen::Dynamic : N * factor;
}

}  // namespace detail

// The functions below take x as Dim x N points of the same number of nodes as the system, and do not
// validate: NaN in is NaN out. A spring without stiffness is none: its anchor's position or its rest length
// means nothing, however large.

/// E(x) = 1/2 sum_i k_i |x_i - a_i|^2 + 1/2 sum_ij k_ij (mu_ij - |x_i - x_j|)^2, the paper's energy with the
/// second 1/2 that its forces (Eq. 13) imply; for another Model than Springs sum_i 1/2 k_i rho(|x_i - a_i|^2)
/// + sum_ij k_ij phi(|x_i - x_j|, mu_ij). Not convex: a spring shorter than its rest length has negative
/// curvature across its axis.
template <typename System>
typename System::Scalar energy(const System& system, const typename System::Points& x) {
  typename System::Scalar energy = 0;
  for (int i = 0; i < system.nodes(); ++i) {
    energy += detail::anchor_force(system, i, detail::anchor_offset(system, i, x)).energy;
  }
  if (detail::SpringRows<System>::serve(system))
    return energy + detail::SpringRows<System>::energy(system, x);
  int l = 0;
  for (const Link& link : system.links()) {
    const auto length = detail::spring(system, link, x.col(link.i) - x.col(link.j)).length;
    energy += system.link_stiffness[l] * detail::link_potential(system, l, length).value;
    ++l;
  }
  return energy;
}

/// Writes dE/dx_i = k_i (x_i - a_i) + sum_j k_ij (r_ij - mu_ij) u_ij into column i of `gradient` (Dim x N)
/// and returns E(x). Minus the gradient is the paper's F_nodes (Eq. 15). Where two linked nodes coincide,
/// u_ij is the direction of a_i - a_j, or a fixed one of (i, j) where the anchors coincide too. The column of
/// a fixed node is zero.
template <typename System>
typename System::Scalar energy_and_gradient(const System& system, const typename System::Points& x,
                                            typename System::Points& gradient) {
  return detail::evaluate<true>(system, x, gradient);
}

namespace detail {

/// The first link whose ends coincide though they push each other apart, -1 if there is none. The energy has
/// a conic peak there, which neither gradient nor Hessian show: both keep to coincident_spring's direction.
template <typename System>
int peaked_link(const System& system, const typename System::Points& x) {
  int l = 0;
  for (const Link& link : system.links()) {
    if (x.col(link.i) == x.col(link.j) && system.link_stiffness[l] > 0 &&
        !(system.is_fixed(link.i) && system.is_fixed(link.j)) &&
        system.link_potential(typename System::Scalar(0), system.rest_length[l]).first < 0)
      return l;
    ++l;
  }
  return -1;
}

}  // namespace detail

/// The gradient alone, as above.
template <typename System>
typename System::Points gradient(const System& system, const typename System::Points& x) {
  typename System::Points result;
  detail::evaluate<false>(system, x, result);
  return result;
}

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

}  // namespace asterism::inline ASTERISM_ABI
