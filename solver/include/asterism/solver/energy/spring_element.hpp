#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/numbers.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <cmath>
#include <cstdint>
#include <limits>
#include <type_traits>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// The spring of a link as it lies in x, with d of link_difference: its length r = |d|, 1 / r, and its
/// direction u = d / r.
template <typename System>
struct Spring {
  typename System::Scalar length;
  typename System::Scalar inverse;  // not finite where nodes coincide, or nearly so
  typename System::Point direction;
};

/// v / |v| without overflow or underflow. Returns |v|; leaves v = 0 as it is.
template <typename Point>
typename Point::Scalar normalise(Point& v) {
  const auto largest = largest_size(v);
  if (!(largest > 0)) return 0;
  v /= largest;
  const auto norm = v.norm();
  v /= norm;
  return largest * norm;
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

/// The one convention for coincident nodes, of energy, gradient, Hessian and every solver: where d = 0, u
/// is the direction of a_i - a_j, or fixed_direction where that vanishes too or one of these anchors has no
/// stiffness. The energy has a conic peak there (a spring with mu_ij > 0 wants its nodes apart), and any unit
/// u makes -gradient a direction of strict descent.
template <typename System>
Spring<System> coincident_spring(const System& system, Link link, const typename System::Point& d) {
  typename System::Point direction = d;
  const auto length = normalise(direction);
  if (!(length > 0)) {
    if (system.anchor_stiffness[link.i] > 0 && system.anchor_stiffness[link.j] > 0)
      direction = system.anchors.col(link.i) - system.anchors.col(link.j);
    if (!(normalise(direction) > 0)) direction = fixed_direction<typename System::Point>(link);
  }
  return {length, 1 / length, direction};
}

/// Below this a squared length loses digits to underflow, and coincident_spring takes over.
template <typename Scalar>
constexpr Scalar kLeastSquare = std::numeric_limits<Scalar>::min() / std::numeric_limits<Scalar>::epsilon();

/// d = x_i - x_j - m_ij of link l. All that depends on a link's offset m_ij does so by d.
template <typename System, typename Points>
typename System::Point link_difference(const System& system, int l, const Link& link, const Points& x) {
  typename System::Point d = x.col(link.i) - x.col(link.j);
  if (system.has_offsets()) [[unlikely]]
    d -= system.rest_offset.col(l);
  return d;
}

/// The spring of `link` with d of link_difference.
template <typename System>
Spring<System> spring(const System& system, Link link, const typename System::Point& d) {
  using Scalar = typename System::Scalar;
  const Scalar square = d.squaredNorm();
  if (square < kLeastSquare<Scalar>) [[unlikely]]
    return coincident_spring(system, link, d);
  const Scalar length = std::sqrt(square);
  const Scalar inverse = 1 / length;
  return {length, inverse, d * inverse};
}

/// `value` times the identity.
template <int kDim, typename Scalar>
Eigen::Matrix<Scalar, kDim, kDim, Eigen::ColMajor> diagonal(Scalar value) {
  Eigen::Matrix<Scalar, kDim, kDim, Eigen::ColMajor> result;
  for (int c = 0; c < kDim; ++c) {
    for (int r = 0; r < kDim; ++r) result(r, c) = r == c ? value : Scalar(0);
  }
  return result;
}

/// A v, written out as a compiler takes a tenth of a second for each of Eigen's products.
template <typename Scalar, int kDim>
Eigen::Matrix<Scalar, kDim, 1> product(const Eigen::Matrix<Scalar, kDim, kDim, Eigen::ColMajor>& A,
                                       const Eigen::Matrix<Scalar, kDim, 1>& v) {
  Eigen::Matrix<Scalar, kDim, 1> result = Eigen::Matrix<Scalar, kDim, 1>::Zero();
  for (int c = 0; c < kDim; ++c) {
    for (int r = 0; r < kDim; ++r) result[r] += A(r, c) * v[c];
  }
  return result;
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

/// The same of node i in x, of its anchor and of its load.
template <typename System>
AnchorForce<System> node_force(const System& system, int i, const typename System::Points& x,
                               const typename System::Point& d) {
  AnchorForce<System> force = anchor_force(system, i, d);
  if (system.has_loads()) [[unlikely]] {
    for (int c = 0; c < System::kDim; ++c) {
      force.energy -= system.loads(c, i) * x(c, i);
      force.gradient[c] -= system.loads(c, i);
    }
  }
  return force;
}

/// The reference for the rounding error of the energy: the energy of the springs, with loads also the
/// absolute values of theirs, which grow with the distance from the origin.
template <typename System>
typename System::Scalar rounding_scale(const System& system, const typename System::Points& x,
                                       typename System::Scalar energy) {
  if (system.has_loads()) [[unlikely]] {
    for (int i = 0; i < system.nodes(); ++i) {
      const auto work = system.loads.col(i).dot(x.col(i));
      energy += work + std::abs(work);
    }
  }
  return energy;
}

/// d2E/dx_i2 of node i's anchor, of 1/2 k rho(d^T S d): k (rho' S + 2 rho'' S d (S d)^T). With `clamp`
/// without the second term, which is negative.
template <typename System>
auto anchor_curvature(const System& system, int i, const typename System::Point& d, bool clamp) {
  using Block = Eigen::Matrix<typename System::Scalar, System::kDim, System::kDim, Eigen::ColMajor>;
  const typename System::Scalar k = system.anchor_stiffness[i];
  if constexpr (System::kPlainAnchors) {
    return diagonal<System::kDim>(k);
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

/// Energy, tension and curvatures of link l at length r: its second derivatives along u, k phi'', and across
/// it, k phi' / r, as a link that pulls at its ends resists sideways as well. For Hooke's springs
/// k (r - mu)^2 / 2, k (r - mu), k and k (1 - mu / r).
template <typename Scalar>
struct LinkForce {
  Scalar energy;
  Scalar tension;
  Scalar along;
  Scalar across;

  /// Without negative curvature, which makes every matrix of links positive semi-definite.
  LinkForce clamped() const {
    return {energy, tension, std::max(along, Scalar(0)), std::max(across, Scalar(0))};
  }
};

template <typename System>
[[gnu::always_inline]] inline LinkForce<typename System::Scalar> link_force(const System& system, int l,
                                                                            typename System::Scalar length,
                                                                            typename System::Scalar inverse) {
  const typename System::Scalar k = system.link_stiffness[l];
  const auto phi = link_potential(system, l, length);
  return {k * phi.value, k * phi.first, k * phi.second, k * phi.first * inverse};
}

/// The same of a spring, also of one without length, where the curvature across it has no limit: that is
/// taken as 0 where the link pushes, else as that along it.
template <typename System>
[[gnu::always_inline]] inline LinkForce<typename System::Scalar> link_force(const System& system, int l,
                                                                            const Spring<System>& spring) {
  auto force = link_force(system, l, spring.length, spring.inverse);
  if (!is_finite(force.across)) [[unlikely]]
    force.across = force.tension < 0 ? typename System::Scalar(0) : force.along;
  return force;
}

/// The Dim x Dim second derivative of a link at either of its ends, along u u^T + across (I - u u^T); minus
/// that couples the two.
template <typename System>
[[gnu::always_inline]] inline auto link_curvature(const LinkForce<typename System::Scalar>& force,
                                                  const Spring<System>& spring) {
  using Block = Eigen::Matrix<typename System::Scalar, System::kDim, System::kDim, Eigen::ColMajor>;
  const typename System::Point& u = spring.direction;
  const typename System::Scalar difference = force.along - force.across;
  Block block;
  for (int c = 0; c < System::kDim; ++c) {
    for (int r = 0; r < System::kDim; ++r) block(r, c) = difference * (u[r] * u[c]);  // symmetric to the bit
    block(c, c) += force.across;
  }
  return block;
}

/// The one walk over the springs of a system at x, of which energy, gradient and every matrix are made: calls
/// on_anchor(i, offset) for every anchor, with anchor_offset, and on_link(l, link, force, spring) for every
/// link. Results that are not used cost nothing. The callee has to treat fixed nodes.
template <typename System, typename OnAnchor, typename OnLink>
void for_each_spring(const System& system, const typename System::Points& x, OnAnchor&& on_anchor,
                     OnLink&& on_link) {
  for (int i = 0; i < system.nodes(); ++i) on_anchor(i, anchor_offset(system, i, x));
  int l = 0;
  for (const Link& link : system.links()) {
    const Spring<System> here = spring(system, link, link_difference(system, l, link, x));
    on_link(l, link, link_force(system, l, here), here);
    ++l;
  }
}

/// The reference for relative errors of the energy, given the energy at x. With loads, whose energy depends
/// on the origin, it is the energy of the springs and the tension times the length of each link, which at
/// rest is the work that the loads do on the links.
template <typename System>
typename System::Scalar energy_scale(const System& system, const typename System::Points& x,
                                     typename System::Scalar energy) {
  if (!system.has_loads()) [[likely]]
    return energy;
  typename System::Scalar sum = 0;
  for_each_spring(
      system, x, [&](int i, const auto& offset) { sum += anchor_force(system, i, offset).energy; },
      [&](int, const Link&, const auto& force, const auto& spring) {
        sum += force.energy + std::abs(force.tension) * spring.length;
      });
  return sum;
}

/// The same for second derivatives: on_anchor(i, curvature) and on_link(l, link, force, spring), with `clamp`
/// without negative curvature. A Hessian, its clamped form, an operator and a diagonal are made of these.
template <typename System, typename OnAnchor, typename OnLink>
void for_each_curvature(const System& system, const typename System::Points& x, bool clamp,
                        OnAnchor&& on_anchor, OnLink&& on_link) {
  for_each_spring(
      system, x, [&](int i, const auto& offset) { on_anchor(i, anchor_curvature(system, i, offset, clamp)); },
      [&](int l, const Link& link, const auto& force, const auto& spring) {
        on_link(l, link, clamp ? force.clamped() : force, spring);
      });
}

/// A fixed node does not move, whatever force acts on it.
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
