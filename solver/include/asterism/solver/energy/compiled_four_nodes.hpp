#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/energy/four_nodes.hpp>
#include <asterism/solver/problem/compiled_types.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// Whether the kernels for four nodes serve a system of a type with kHasFourNodes.
template <typename System>
bool is_four_nodes(const System& system) {
  return system.nodes() == 4 && system.fixed_count() == 0 && system.topology().is_full() &&
         !system.has_offsets() && !system.has_loads();
}

/// Such a system, with the scales of a StoppingRule.
template <typename System, typename Scales>
lanes_v0_1::FourNodes four_nodes(const System& system, const Scales& scales) {
  return {system.anchors.data(),     system.anchor_stiffness.data(), system.link_stiffness.data(),
          system.rest_length.data(), scales.node_stiffness().data(), scales.length(),
          scales.tolerance()};
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
