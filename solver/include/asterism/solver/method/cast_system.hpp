#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/problem/spring_system.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// Converts springs to another type of system, of any size and of at least as many dimensions. The added
/// coordinates of anchors, offsets and loads are zero.
template <typename To, typename From>
To cast_system(const From& from) {
  static_assert(To::kNodes == Eigen::Dynamic && To::kDim >= From::kDim);
  using Scalar = typename To::Scalar;
  To to(To::TopologyType::from_links(from.nodes(), from.links()));
  to.anchors.setZero(To::kDim, from.anchors.cols());
  to.anchors.template topRows<From::kDim>() = from.anchors.template cast<Scalar>();
  to.anchor_stiffness = from.anchor_stiffness.template cast<Scalar>();
  to.rest_length = from.rest_length.template cast<Scalar>();
  to.link_stiffness = from.link_stiffness.template cast<Scalar>();
  if (from.has_offsets()) {
    to.rest_offset.setZero(To::kDim, from.link_count());
    to.rest_offset.template topRows<From::kDim>() = from.rest_offset.template cast<Scalar>();
  }
  if (from.has_loads()) {
    to.loads.setZero(To::kDim, from.nodes());
    to.loads.template topRows<From::kDim>() = from.loads.template cast<Scalar>();
  }
  to.anchor_loss = from.anchor_loss;
  to.link_potential = from.link_potential;
  for (int i = 0; i < from.nodes(); ++i) {
    if (from.is_fixed(i)) to.fix(i);
  }
  return to;
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
