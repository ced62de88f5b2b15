#pragma once

#include <algorithm>
#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/finite.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <cmath>
#include <cstdint>
#include <limits>

namespace asterism {
inline namespace ASTERISM_ABI {
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
/// is the direction of a_i - a_j, or fixed_direction where that vanishes too or one of these anchors has no
/// stiffness. The energy has a conic peak there (a spring with mu_ij > 0 wants its nodes apart), and any unit
/// u makes -gradient a direction of strict descent.
template <typename System>
Spring<System> coincident_spring(const System& system, Link link, const typename System::Point& d) {
  typename System::Point direction = d;
  const auto length = direction.stableNorm();
  if (!normalise(direction)) {
    if (system.anchor_stiffness[link.i] > 0 && system.anchor_stiffness[link.j] > 0)
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

/// x_i - a_i, and 0 where the anchor has no stiffness: its position means nothing then, and may be so far off
/// that its square overflows.
template <typename System>
typename System::Point anchor_offset(const System& system, int i, const typename System::Points& x) {
  if (!(system.anchor_stiffness[i] > 0)) [[unlikely]]
    return System::Point::Zero();
  return x.col(i) - system.anchors.col(i);
}

/// phi of link l at length r, and 0 where the link has no stiffness, whatever its rest length is then.
template <typename System>
Derivatives<typename System::Scalar> link_potential(const System& system, int l, typename System::Scalar r) {
  if (!(system.link_stiffness[l] > 0)) [[unlikely]]
    return {0, 0, 0};
  return system.link_potential(r, system.rest_length[l]);
}

/// S d with the anchor's shape S.
template <typename System>
typename System::Point anchor_shaped(const System& system, int i, const typename System::Point& d) {
  if constexpr (System::kAnisotropic) {
    return system.anchor_shape.template block<System::kDim, System::kDim>(0, System::kDim * i) * d;
  } else {
    return d;
  }
}

/// Energy and gradient of node i's anchor with d of anchor_offset.
template <typename System>
struct AnchorForce {
  typename System::Scalar energy;
  typename System::Point gradient;
};

template <typename System>
AnchorForce<System> anchor_force(const System& system, int i, const typename System::Point& d) {
  const typename System::Scalar k = system.anchor_stiffness[i];
  if constexpr (System::kPlainAnchors) {
    return {k * d.squaredNorm() / 2, k * d};
  } else {
    const typename System::Point shaped = anchor_shaped(system, i, d);
    const auto loss = system.anchor_loss(d.dot(shaped));
    return {k * loss.value / 2, (k * loss.first) * shaped};
  }
}

/// d2E/dx_i2 of node i's anchor, of 1/2 k rho(d^T S d): k (rho' S + 2 rho'' S d (S d)^T). With `clamp`
/// without the second term, which is negative.
template <typename System>
auto anchor_curvature(const System& system, int i, const typename System::Point& d, bool clamp) {
  using Block = Eigen::Matrix<typename System::Scalar, System::kDim, System::kDim, Eigen::ColMajor>;
  const typename System::Scalar k = system.anchor_stiffness[i];
  if constexpr (System::kPlainAnchors) {
    return Block(k * Block::Identity());
  } else {
    const typename System::Point shaped = anchor_shaped(system, i, d);
    const auto loss = system.anchor_loss(d.dot(shaped));
    Block block = Block::Identity();
    if constexpr (System::kAnisotropic)
      block = system.anchor_shape.template block<System::kDim, System::kDim>(0, System::kDim * i);
    block *= k * loss.first;
    if (!clamp) block += (2 * k * loss.second) * shaped * shaped.transpose();
    return block;
  }
}

/// The force and the curvatures of link l at length r: along it, and across it, where a link that pulls at
/// its end resists sideways as well.
template <typename Scalar>
struct LinkForce {
  Scalar energy;
  Scalar tension;
  Scalar along;
  Scalar across;  // has no limit at r = 0; taken as 0 where the link pushes there
};

template <typename System>
LinkForce<typename System::Scalar> link_force(const System& system, int l, typename System::Scalar r) {
  const typename System::Scalar k = system.link_stiffness[l];
  const auto phi = link_potential(system, l, r);
  const auto ratio = phi.first / r;
  const auto across =
      r > 0 && is_finite(ratio) ? ratio : (phi.first < 0 ? typename System::Scalar(0) : phi.second);
  return {k * phi.value, k * phi.first, k * phi.second, k * across};
}

/// A fixed node does not move, whatever pulls at it.
template <typename System>
void clear_fixed(const System& system, typename System::Points& gradient) {
  if (system.fixed_count() == 0) [[likely]]
    return;
  for (int i = 0; i < system.nodes(); ++i) {
    if (system.is_fixed(i)) gradient.col(i).setZero();
  }
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
