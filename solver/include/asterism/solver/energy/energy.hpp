#pragma once

#include <array>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/energy/full_links.hpp>
#include <asterism/solver/energy/spring_element.hpp>
#include <asterism/solver/energy/spring_rows.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/topology.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace detail {

/// Gradient and energy for a small full topology; false where it does not serve.
template <typename System>
[[gnu::flatten]] bool evaluate_full(const System& system, const typename System::Points& x,
                                    typename System::Points& gradient, typename System::Scalar& energy) {
  using Links = FullLinks<System>;
  if constexpr (!Links::kServes) {
    return false;
  } else {
    Links links;
    if (!Links::serve(system) || !links.set(system, x)) return false;
    std::array<typename System::Point, Links::kNodes> pulls;
    typename System::Scalar sum = 0;
    unroll<0, Links::kNodes>([&](auto i) {
      const auto anchor = anchor_force(system, i, anchor_offset(system, i, x));
      pulls[i] = anchor.gradient;
      sum += anchor.energy;
    });
    Links::for_each([&](auto i, auto j, auto l) {
      sum += links.energy(l);
      const typename System::Point pull = links.pull(l);
      pulls[i] += pull;
      pulls[j] -= pull;
    });
    unroll<0, Links::kNodes>([&](auto i) { gradient.col(i) = pulls[i]; });
    energy = sum;
    return true;
  }
}

/// Gradient and, if wanted, energy (otherwise any number) in one pass over the springs.
template <bool kWithEnergy, typename System>
typename System::Scalar evaluate(const System& system, const typename System::Points& x,
                                 typename System::Points& gradient) {
  using Scalar = typename System::Scalar;
  using Point = typename System::Point;
  gradient.resize(System::kDim, system.nodes());
  Scalar energy = 0;
  const auto on_node = [&](int i, const Point& offset) {
    const auto force = node_force(system, i, x, offset);
    gradient.col(i) = force.gradient;
    if constexpr (kWithEnergy) energy += force.energy;
  };
  if (evaluate_full(system, x, gradient, energy)) {
    // All links at once.
  } else if (SpringRows<System>::serve(system)) {
    for (int i = 0; i < system.nodes(); ++i) on_node(i, anchor_offset(system, i, x));
    energy += SpringRows<System>::evaluate(system, x, gradient);
  } else {
    for_each_spring(system, x, on_node, [&](int, const Link& link, const auto& force, const auto& spring) {
      const Point pull = force.tension * spring.direction;
      gradient.col(link.i) += pull;
      gradient.col(link.j) -= pull;
      if constexpr (kWithEnergy) energy += force.energy;
    });
  }
  clear_fixed(system, gradient);
  return energy;
}

}  // namespace detail

// The functions below take x as Dim x N, with as many columns as the system has nodes, and do not validate:
// NaN in x gives NaN in the result. A spring of stiffness 0 has no effect, whatever its rest length or its
// anchor's position.

/// E(x) = 1/2 sum_i k_i |x_i - a_i|^2 + 1/2 sum_ij k_ij (mu_ij - |x_i - x_j|)^2, the paper's energy with the
/// second 1/2 that its forces (Eq. 13) imply; for another Model than Springs sum_i 1/2 k_i rho(|x_i - a_i|^2)
/// + sum_ij k_ij phi(|x_i - x_j|, mu_ij), where x_i - x_j is less the link's offset m_ij if it has one; with
/// loads less sum_i f_i . x_i. Not convex: a spring shorter than its rest length has negative curvature
/// across its axis.
template <typename System>
typename System::Scalar energy(const System& system, const typename System::Points& x) {
  typename System::Scalar energy = 0;
  const auto on_node = [&](int i, const typename System::Point& offset) {
    energy += detail::node_force(system, i, x, offset).energy;
  };
  if (detail::SpringRows<System>::serve(system)) {
    for (int i = 0; i < system.nodes(); ++i) on_node(i, detail::anchor_offset(system, i, x));
    return energy + detail::SpringRows<System>::energy(system, x);
  }
  detail::for_each_spring(system, x, on_node,
                          [&](int, const Link&, const auto& force, const auto&) { energy += force.energy; });
  return energy;
}

/// Writes dE/dx_i = k_i (x_i - a_i) + sum_j k_ij (r_ij - mu_ij) u_ij - f_i into column i of `gradient` (Dim x
/// N) and returns E(x). Minus the gradient is the paper's F_nodes (Eq. 15). Where two linked nodes coincide,
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
    if (is_zero(link_difference(system, l, link, x)) && system.link_stiffness[l] > 0 &&
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

}  // namespace ASTERISM_ABI
}  // namespace asterism
