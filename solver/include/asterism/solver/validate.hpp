#pragma once

#include <asterism/solver/config.hpp>
#include <asterism/solver/spring_system.hpp>
#include <cmath>

namespace asterism::inline ASTERISM_ABI {

namespace detail {

/// Scratch of the search for connected components: the nodes and one for the image that anchors hold on to.
template <typename System>
using ComponentScratch =
    Eigen::Matrix<int, Eigen::Dynamic, 1, Eigen::ColMajor,
                  System::kMaxNodes == Eigen::Dynamic ? Eigen::Dynamic : System::kMaxNodes + 1, 1>;

/// The first node without a path of positive stiffness to an anchor, or -1.
template <typename System>
int first_floating_node(const System& system, ComponentScratch<System>& parent) {
  if ((system.anchor_stiffness.array() > 0).all()) return -1;
  const int n = system.nodes();
  parent.setLinSpaced(n + 1, 0, n);
  const auto root = [&parent](int node) {
    while (parent[node] != node) node = parent[node] = parent[parent[node]];
    return node;
  };
  for (int i = 0; i < n; ++i) {
    if (system.anchor_stiffness[i] > 0) parent[root(i)] = root(n);
  }
  int l = 0;
  for (const Link& link : system.links()) {
    if (system.link_stiffness[l++] > 0) parent[root(link.i)] = root(link.j);
  }
  for (int i = 0; i < n; ++i) {
    if (root(i) != root(n)) return i;
  }
  return -1;
}

template <typename Matrix>
int first_column_not_finite(const Matrix& points) {
  if (points.allFinite()) return -1;
  int i = 0;
  while (points.col(i).allFinite()) ++i;
  return i;
}

/// The first entry that is not a finite number >= 0, or -1.
template <typename Vector>
int first_bad_entry(const Vector& values) {
  for (int i = 0; i < values.size(); ++i) {
    if (!(values[i] >= 0 && std::isfinite(values[i]))) return i;
  }
  return -1;
}

template <typename System>
Defect validate(const System& system, const typename System::Points& x, ComponentScratch<System>& scratch) {
  if (system.topology().defect()) return system.topology().defect();
  const int n = system.nodes();
  if (n == 0) return {"system", -1, "has no nodes"};
  if (system.anchors.cols() != n) return {"anchors", -1, "are not one a node"};
  if (system.anchor_stiffness.size() != n) return {"anchor stiffness", -1, "is not one a node"};
  if (system.rest_length.size() != system.link_count()) return {"rest length", -1, "is not one a link"};
  if (system.link_stiffness.size() != system.link_count()) return {"link stiffness", -1, "is not one a link"};
  if (x.cols() != n) return {"x", -1, "is not one column a node"};

  constexpr auto kNotFinite = "is not finite";
  constexpr auto kNotPositive = "is negative or not finite";
  if (const int i = first_column_not_finite(system.anchors); i >= 0) return {"anchor", i, kNotFinite};
  if (const int i = first_bad_entry(system.anchor_stiffness); i >= 0)
    return {"anchor stiffness", i, kNotPositive};
  if (const int l = first_bad_entry(system.rest_length); l >= 0) return {"rest length", l, kNotPositive};
  if (const int l = first_bad_entry(system.link_stiffness); l >= 0)
    return {"link stiffness", l, kNotPositive};
  if (const int i = first_column_not_finite(x); i >= 0) return {"x of node", i, kNotFinite};
  if (const int i = first_floating_node(system, scratch); i >= 0) {
    return {"node", i, "is in a connected component without anchor stiffness"};
  }
  return {};
}

}  // namespace detail

/// What a solver would refuse `system` and `x` for: NaN, infinity, a negative stiffness or rest length, a bad
/// link, a wrong size, or a connected component (links of zero stiffness do not connect) without anchor
/// stiffness.
template <typename System>
Defect validate(const System& system, const typename System::Points& x) {
  detail::ComponentScratch<System> scratch;
  return detail::validate(system, x, scratch);
}

}  // namespace asterism::inline ASTERISM_ABI
