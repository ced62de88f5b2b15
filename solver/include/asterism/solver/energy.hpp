#pragma once

#include <Eigen/SparseCore>
#include <asterism/solver/config.hpp>
#include <asterism/solver/spring_system.hpp>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

namespace asterism::inline ASTERISM_ABI {

namespace detail {

/// The spring of a link as it lies in x: its length r = |x_i - x_j| and its direction u = (x_i - x_j) / r.
template <typename System>
struct Spring {
  typename System::Scalar length;
  typename System::Point direction;
};

/// v / |v| without overflow or underflow; false and untouched for v = 0.
template <typename Point>
bool normalise(Point& v) {
  const auto largest = v.cwiseAbs().maxCoeff();
  if (!(largest > 0)) return false;
  v /= largest;
  v /= v.norm();
  return true;
}

/// A unit vector that depends on the two node numbers alone and changes sign when they are swapped.
template <typename Point>
Point fixed_direction(Link link) {
  const auto low = static_cast<std::uint32_t>(std::min(link.i, link.j));
  const auto high = static_cast<std::uint32_t>(std::max(link.i, link.j));
  std::uint32_t state = low * 0x9e3779b9U ^ (high * 0x85ebca6bU + 0x27d4eb2fU);
  Point direction;
  for (auto& coordinate : direction) {
    state ^= state >> 15;
    state *= 0x2c1b3c6dU;
    state ^= state >> 12;
    const int odd = 2 * static_cast<int>(state >> 17) + 1 - (1 << 15);  // never zero
    coordinate = static_cast<typename Point::Scalar>(odd);
  }
  normalise(direction);
  return link.i < link.j ? direction : Point(-direction);
}

/// The one convention for coincident nodes, of energy, gradient, Hessian and every solver: where x_i = x_j, u
/// is the direction of a_i - a_j, or fixed_direction where that vanishes too. The energy has a conic peak
/// there (a spring with mu_ij > 0 wants its nodes apart), and any unit u makes -gradient a direction of
/// strict descent.
template <typename System>
Spring<System> coincident_spring(const System& system, Link link, const typename System::Point& d) {
  typename System::Point direction = d;
  const auto length = direction.stableNorm();
  if (!normalise(direction)) {
    direction = system.anchors.col(link.i) - system.anchors.col(link.j);
    if (!normalise(direction)) direction = fixed_direction<typename System::Point>(link);
  }
  return {length, direction};
}

/// The spring of `link` with d = x_i - x_j.
template <typename System>
Spring<System> spring(const System& system, Link link, const typename System::Point& d) {
  using Scalar = typename System::Scalar;
  // Below this the squared length loses digits to underflow.
  constexpr Scalar kTiny = std::numeric_limits<Scalar>::min() / std::numeric_limits<Scalar>::epsilon();
  const Scalar square = d.squaredNorm();
  if (square < kTiny) [[unlikely]]
    return coincident_spring(system, link, d);
  const Scalar length = std::sqrt(square);
  return {length, d * (Scalar(1) / length)};
}

/// Gradient and, if wanted, energy (else 0) in one pass over the springs.
template <bool kWithEnergy, typename System>
typename System::Scalar evaluate(const System& system, const typename System::Points& x,
                                 typename System::Points& gradient) {
  using Scalar = typename System::Scalar;
  using Point = typename System::Point;
  gradient.resize(System::kDim, system.nodes());
  Scalar twice = 0;
  for (int i = 0; i < system.nodes(); ++i) {
    const Point d = x.col(i) - system.anchors.col(i);
    gradient.col(i) = system.anchor_stiffness[i] * d;
    if constexpr (kWithEnergy) twice += system.anchor_stiffness[i] * d.squaredNorm();
  }
  int l = 0;
  for (const Link& link : system.links()) {
    const auto [length, direction] = spring(system, link, x.col(link.i) - x.col(link.j));
    const Scalar stretch = length - system.rest_length[l];
    const Scalar tension = system.link_stiffness[l] * stretch;
    const Point force = tension * direction;
    gradient.col(link.i) += force;
    gradient.col(link.j) -= force;
    if constexpr (kWithEnergy) twice += tension * stretch;
    ++l;
  }
  return twice / 2;
}

/// Calls add(node, node, block) for the Dim x Dim blocks of the Hessian; a block may come more than once.
template <typename System, typename Add>
void for_each_hessian_block(const System& system, const typename System::Points& x, Add&& add) {
  using Scalar = typename System::Scalar;
  using Block = Eigen::Matrix<Scalar, System::kDim, System::kDim>;
  for (int i = 0; i < system.nodes(); ++i) add(i, i, Block(system.anchor_stiffness[i] * Block::Identity()));
  int l = 0;
  for (const Link& link : system.links()) {
    const auto [length, direction] = spring(system, link, x.col(link.i) - x.col(link.j));
    const Scalar mu = system.rest_length[l];
    // Curvature across the spring relative to along it: 1 - mu / r, which has no limit at r = 0.
    Scalar across = mu > 0 ? 0 : 1;
    if (length > 0 && std::isfinite(mu / length)) across = 1 - mu / length;
    const Block along = direction * direction.transpose();
    const Block block = system.link_stiffness[l] * (along + across * (Block::Identity() - along));
    add(link.i, link.i, block);
    add(link.j, link.j, block);
    add(link.i, link.j, Block(-block));
    add(link.j, link.i, Block(-block));
    ++l;
  }
}

template <int N>
constexpr int times(int factor) {
  return N == Eigen::Dynamic ? Eigen::Dynamic : N * factor;
}

}  // namespace detail

// The functions below take x as Dim x N points of the same number of nodes as the system, and do not
// validate: NaN in is NaN out.

/// E(x) = 1/2 sum_i k_i |x_i - a_i|^2 + 1/2 sum_ij k_ij (mu_ij - |x_i - x_j|)^2, the paper's energy with the
/// second 1/2 that its forces (Eq. 13) imply. Not convex: a spring shorter than its rest length has negative
/// curvature across its axis.
template <typename System>
typename System::Scalar energy(const System& system, const typename System::Points& x) {
  using Scalar = typename System::Scalar;
  Scalar twice = 0;
  for (int i = 0; i < system.nodes(); ++i) {
    twice += system.anchor_stiffness[i] * (x.col(i) - system.anchors.col(i)).squaredNorm();
  }
  int l = 0;
  for (const Link& link : system.links()) {
    const Scalar stretch =
        detail::spring(system, link, x.col(link.i) - x.col(link.j)).length - system.rest_length[l];
    twice += system.link_stiffness[l] * stretch * stretch;
    ++l;
  }
  return twice / 2;
}

/// Writes dE/dx_i = k_i (x_i - a_i) + sum_j k_ij (r_ij - mu_ij) u_ij into column i of `gradient` (Dim x N)
/// and returns E(x). Minus the gradient is the paper's F_nodes (Eq. 15). Where two linked nodes coincide,
/// u_ij is the direction of a_i - a_j, or a fixed one of (i, j) where the anchors coincide too.
template <typename System>
typename System::Scalar energy_and_gradient(const System& system, const typename System::Points& x,
                                            typename System::Points& gradient) {
  return detail::evaluate<true>(system, x, gradient);
}

/// The gradient alone, as above.
template <typename System>
typename System::Points gradient(const System& system, const typename System::Points& x) {
  typename System::Points result;
  detail::evaluate<false>(system, x, result);
  return result;
}

template <typename System>
using DenseHessian = Eigen::Matrix<typename System::Scalar, detail::times<System::kNodes>(System::kDim),
                                   detail::times<System::kNodes>(System::kDim), Eigen::ColMajor,
                                   detail::times<System::kMaxNodes>(System::kDim),
                                   detail::times<System::kMaxNodes>(System::kDim)>;

/// d2E/dx2, (Dim N) x (Dim N), symmetric; coordinate d of node i is row Dim i + d. A spring contributes
/// k_ij (u u^T + (1 - mu_ij / r_ij) (I - u u^T)), indefinite where r_ij < mu_ij. Where two linked nodes
/// coincide and mu_ij > 0, the curvature across the spring is minus infinity and k_ij u u^T alone is used.
template <typename System>
DenseHessian<System> hessian(const System& system, const typename System::Points& x) {
  constexpr int kDim = System::kDim;
  DenseHessian<System> result;
  result.setZero(kDim * system.nodes(), kDim * system.nodes());
  detail::for_each_hessian_block(system, x, [&](int i, int j, const auto& block) {
    result.template block<kDim, kDim>(kDim * i, kDim * j) += block;
  });
  return result;
}

/// The same as a sparse matrix with both triangles.
template <typename System>
Eigen::SparseMatrix<typename System::Scalar> sparse_hessian(const System& system,
                                                            const typename System::Points& x) {
  constexpr int kDim = System::kDim;
  std::vector<Eigen::Triplet<typename System::Scalar>> entries;
  entries.reserve(static_cast<std::size_t>(kDim) * kDim *
                  (static_cast<std::size_t>(system.nodes()) + 4 * system.links().size()));
  detail::for_each_hessian_block(system, x, [&](int i, int j, const auto& block) {
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
