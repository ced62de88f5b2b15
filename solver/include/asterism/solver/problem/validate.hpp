#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/numbers.hpp>
#include <asterism/solver/matrix/diagonalise.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace detail {

/// Scratch of the search for connected components: one entry for each node, and one for all anchors.
template <typename System>
using ComponentScratch =
    Eigen::Matrix<int, Eigen::Dynamic, 1, Eigen::ColMajor,
                  System::kMaxNodes == Eigen::Dynamic ? Eigen::Dynamic : System::kMaxNodes + 1, 1>;

/// The representative of a node's set (union-find); shortens the path to it.
template <typename Up>
int root(Up& up, int node) {
  while (up[node] != node) node = up[node] = up[up[node]];
  return node;
}

/// Whether links connect all of n nodes. `up` is scratch.
template <typename Up>
bool is_connected(int n, std::span<const Link> links, Up& up) {
  up.setLinSpaced(n, 0, n - 1);
  int sets = n;
  for (const Link& link : links) {
    const int from = root(up, link.i);
    const int to = root(up, link.j);
    sets -= from != to ? 1 : 0;
    up[from] = to;
  }
  return sets <= 1;
}

/// Joins the connected components, those with anchor stiffness or a fixed node all to the set of number n;
/// links of zero stiffness do not connect.
template <typename System>
void join_components(const System& system, ComponentScratch<System>& parent) {
  const int n = system.nodes();
  parent.setLinSpaced(n + 1, 0, n);
  for (int i = 0; i < n; ++i) {
    if (system.anchor_stiffness[i] > 0 || system.is_fixed(i)) parent[root(parent, i)] = root(parent, n);
  }
  int l = 0;
  for (const Link& link : system.links()) {
    if (system.link_stiffness[l++] > 0) parent[root(parent, link.i)] = root(parent, link.j);
  }
}

/// Calls visit(i) for the first node of each connected component without anchor stiffness or a fixed node;
/// links of zero stiffness do not connect.
template <typename System, typename Visit>
void for_each_floating_component(const System& system, ComponentScratch<System>& parent, Visit&& visit) {
  if (is_positive(system.anchor_stiffness)) return;
  join_components(system, parent);
  const auto root = [&parent](int node) { return detail::root(parent, node); };
  const int n = system.nodes();
  for (int i = 0; i < n; ++i) {
    if (root(i) == root(n)) continue;
    visit(i);
    parent[root(i)] = root(n);
  }
}

/// The first of those nodes, or -1.
template <typename System>
int first_floating_node(const System& system, ComponentScratch<System>& scratch) {
  int first = -1;
  for_each_floating_component(system, scratch, [&first](int i) { first = first < 0 ? i : first; });
  return first;
}

/// The first node with a load in any of those components, which it would move without end, or -1.
template <typename System>
int first_floating_load(const System& system, ComponentScratch<System>& scratch) {
  if (!system.has_loads()) return -1;
  join_components(system, scratch);
  for (int i = 0; i < system.nodes(); ++i) {
    if (!is_zero(system.loads.col(i)) && root(scratch, i) != root(scratch, system.nodes())) return i;
  }
  return -1;
}

/// The first of `count` shapes, of anchors or links, that is not a symmetric matrix with eigenvalues from 0
/// to 1, or -1.
template <int kDim, typename Shapes>
int first_bad_shape(const Shapes& shapes, int count) {
  using Scalar = typename Shapes::Scalar;
  using Block = Eigen::Matrix<Scalar, kDim, kDim, Eigen::ColMajor>;
  constexpr Scalar kRounding = 64 * std::numeric_limits<Scalar>::epsilon();
  for (int i = 0; i < count; ++i) {
    Block shape = shapes.template block<kDim, kDim>(0, kDim * i);
    if (!all_finite(shape) || !((shape - shape.transpose()).cwiseAbs().array() <= kRounding).all()) return i;
    Block modes;
    diagonalise(shape, modes);
    if (!(shape.diagonal().minCoeff() >= -kRounding && shape.diagonal().maxCoeff() <= 1 + kRounding))
      return i;
  }
  return -1;
}

/// The first problem of the parameters of a loss or potential; none if it has no parameters.
template <typename Function>
Defect parameter_defect(const char* subject, const Function& function) {
  if constexpr (requires { function.problem(); }) {
    if (const char* problem = function.problem()) return {subject, Defect::kNoIndex, problem};
  }
  return {};
}

template <typename Matrix>
int first_column_not_finite(const Matrix& points) {
  if (all_finite(points)) return -1;
  int i = 0;
  while (all_finite(points.col(i))) ++i;
  return i;
}

/// The first entry that is not a finite number >= 0, or -1.
template <typename Vector>
int first_bad_entry(const Vector& values) {
  if (all_finite_and_positive(values)) [[likely]]
    return -1;
  for (int i = 0; i < values.size(); ++i) {
    if (!(values[i] >= 0 && is_finite(values[i]))) return i;
  }
  return -1;
}

/// Whether all values are NaN, as the constructor of a system leaves them.
template <typename Values>
bool is_unset(const Values& values) {
  const auto* const first = values.data();
  return std::all_of(first, first + values.size(), [](auto value) { return is_nan(value); });
}

/// asterism::validate without the search for floating components.
template <typename System>
Defect validate_values(const System& system, const typename System::Points& x) {
  if (system.defect()) return system.defect();
  const int n = system.nodes();
  if (n == 0) return {"system", Defect::kNoIndex, "has no nodes"};
  if (system.anchors.cols() != n) return {"anchors", Defect::kNoIndex, "must have one column for each node"};
  if (system.anchor_stiffness.size() != n)
    return {"anchor stiffness", Defect::kNoIndex, "must have one entry for each node"};
  if (system.rest_length.size() != system.link_count())
    return {"rest length", Defect::kNoIndex, "must have one entry for each link"};
  if (system.link_stiffness.size() != system.link_count())
    return {"link stiffness", Defect::kNoIndex, "must have one entry for each link"};
  if (system.has_offsets() && system.rest_offset.cols() != system.link_count())
    return {"rest offset", Defect::kNoIndex, "must have one column for each link, or none"};
  if (system.has_loads() && system.loads.cols() != n)
    return {"loads", Defect::kNoIndex, "must have one column for each node, or none"};
  if (x.cols() != n) return {"x", Defect::kNoIndex, "must have one column for each node"};

  constexpr auto kNotFinite = "is not finite";
  constexpr auto kNotDefinite = "is not symmetric and positive semi-definite";
  if (const int i = first_column_not_finite(system.anchors); i >= 0) {
    if (is_unset(system.anchors)) return {"anchors", Defect::kNoIndex, "were not set (anchor 0 is NaN)"};
    return {"anchor", i, kNotFinite};
  }
  const auto bad_entry = [](const char* subject, const auto& values) -> Defect {
    const int i = first_bad_entry(values);
    if (i < 0) return {};
    if (is_unset(values)) return {subject, Defect::kNoIndex, "was not set (entry 0 is NaN)"};
    return {subject, i, "is negative or not finite"};
  };
  if (const Defect defect = bad_entry("anchor stiffness", system.anchor_stiffness)) return defect;
  if (const Defect defect = bad_entry("rest length", system.rest_length)) return defect;
  if (const Defect defect = bad_entry("link stiffness", system.link_stiffness)) return defect;
  if (const int l = first_column_not_finite(system.rest_offset); l >= 0)
    return {"rest offset", l, kNotFinite};
  if (const int i = first_column_not_finite(system.loads); i >= 0) return {"load", i, kNotFinite};
  if constexpr (System::kAnisotropic) {
    if (system.anchor_shape.cols() != System::kDim * n)
      return {"anchor shape", Defect::kNoIndex, "must have one matrix for each node"};
    if (const int i = first_bad_shape<System::kDim>(system.anchor_shape, n); i >= 0)
      return {"information matrix of anchor", i, kNotDefinite};
  }
  if (const Defect defect = parameter_defect("anchor loss", system.anchor_loss)) return defect;
  if (const Defect defect = parameter_defect("link potential", system.link_potential)) return defect;
  if (const int i = first_column_not_finite(x); i >= 0) return {"x of node", i, kNotFinite};
  return {};
}

/// Whether any of the numbers first, ..., first + count - 1 lies in the memory of the system.
template <typename System>
bool shares_memory(const System& system, const typename System::Scalar* first, Eigen::Index count) {
  const auto begin = reinterpret_cast<std::uintptr_t>(first);
  const auto end = begin + sizeof(typename System::Scalar) * static_cast<std::size_t>(count);
  const auto meets = [begin, end](const void* data, std::size_t size) {
    const auto other = reinterpret_cast<std::uintptr_t>(data);
    return begin < other + size && other < end;
  };
  if (meets(&system, sizeof system)) return true;
  if constexpr (System::kMaxNodes == Eigen::Dynamic) {  // what is not in the object itself
    const auto is_in = [&meets](const auto& matrix) {
      return meets(matrix.data(), sizeof(typename System::Scalar) * static_cast<std::size_t>(matrix.size()));
    };
    if (is_in(system.anchors) || is_in(system.anchor_stiffness) || is_in(system.rest_length) ||
        is_in(system.link_stiffness) || is_in(system.rest_offset) || is_in(system.loads) ||
        meets(system.links().data(), system.links().size_bytes()))
      return true;
    if constexpr (System::kAnisotropic) return is_in(system.anchor_shape);
  }
  return false;
}

constexpr const char* kNoLoads = "the method does not support loads";
constexpr Defect kSharesMemory{"x", Defect::kNoIndex,
                               "shares memory with the system, such as its anchors: pass a copy"};

template <typename System>
Defect validate_components(const System& system, ComponentScratch<System>& scratch) {
  if (const int i = first_floating_node(system, scratch); i >= 0) {
    return {"node", i, "is in a connected component without anchor stiffness"};
  }
  return {};
}

}  // namespace detail

/// Why a solver would refuse `system` and `x`: NaN, infinity, a negative stiffness or rest length, a bad
/// link, a wrong size, an invalid information matrix, a scale that is not positive, or a connected
/// component (links of zero stiffness do not connect) without anchor stiffness or a fixed node. Solvers also
/// refuse an x that shares memory with the system, because they would overwrite it.
template <typename System>
Defect validate(const System& system, const typename System::Points& x) {
  if (const Defect defect = detail::validate_values(system, x)) return defect;
  detail::ComponentScratch<System> scratch;
  return detail::validate_components(system, scratch);
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
