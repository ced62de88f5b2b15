#pragma once

#include <algorithm>
#include <array>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/problem/defect.hpp>
#include <asterism/solver/problem/nearest_neighbours.hpp>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// A spring between nodes `i` and `j`. Undirected: (i, j) and (j, i) are the same spring.
struct Link {
  int i = 0;  ///< a node, from 0
  int j = 0;  ///< another node

  /// The same nodes in the same order.
  friend bool operator==(const Link&, const Link&) = default;
};

/// Which nodes are linked: an immutable list of links between `nodes()` nodes. It changes rarely (a part is
/// added or dropped), while the values of a SpringSystem change every frame.
///
/// `N` is the number of nodes or Eigen::Dynamic, `MaxN` its upper bound or Eigen::Dynamic. With a bound, the
/// links live inside the object (at most MaxN (MaxN - 1) / 2 of them) and nothing touches the heap.
///
/// Duplicated links are allowed and act as springs in parallel (their energies add up). A list that cannot be
/// a topology (index out of range, self link, too many nodes or links for the bounds) is kept up to its first
/// bad link, and `defect()` describes that link; every solver then returns Status::InvalidInput. A topology
/// without a bound has no links left after a move from it.
template <int N = Eigen::Dynamic, int MaxN = N>
class Topology {
  static_assert(N > 0 || N == Eigen::Dynamic);
  static_assert(MaxN > 0 || MaxN == Eigen::Dynamic);
  static_assert(N == Eigen::Dynamic || N == MaxN, "a fixed number of nodes is its own bound");

 public:
  static constexpr int kNodes = N;
  static constexpr int kMaxNodes = MaxN;
  /// Greatest number of links, or Eigen::Dynamic.
  static constexpr int kMaxLinks = MaxN == Eigen::Dynamic ? Eigen::Dynamic : std::max(1, MaxN*(MaxN - 1) / 2);

  /// Every pair of `n` nodes, in the order (0,1), (0,2), ..., (1,2), ... Throws std::bad_alloc if memory runs
  /// out.
  static Topology full(int n = N) {
    Topology topology(n);
    const auto pairs = std::int64_t{topology.nodes()} * (topology.nodes() - 1) / 2;
    if constexpr (kMaxLinks == Eigen::Dynamic) {
      if (pairs > std::numeric_limits<int>::max()) {
        topology.note({"node count", n, "is of more pairs than links can be counted"});
        return topology;
      }
      detail::require_memory(static_cast<double>(sizeof(Link)) * static_cast<double>(pairs));
      topology.links_.reserve(static_cast<std::size_t>(pairs));
    }
    for (int i = 0; i < topology.nodes(); ++i) {
      for (int j = i + 1; j < topology.nodes(); ++j) topology.add({i, j});
    }
    topology.is_full_ = true;
    return topology;
  }

  /// Node `centre` linked to each of the others.
  static Topology star(int n, int centre) {
    Topology topology(n);
    if (centre < 0 || centre >= topology.nodes()) {
      topology.note({"centre", centre, "is out of range"});
      return topology;
    }
    for (int j = 0; j < topology.nodes(); ++j) {
      if (j != centre) topology.add({centre, j});
    }
    return topology;
  }

  /// Nodes are linked if one is among the `k` nearest others of the other. `points` is Dim x n, finite; ties
  /// go to the smaller index. O(n k log n) in a few dimensions, wherever the points are.
  template <typename Derived>
  static Topology k_nearest(const Eigen::MatrixBase<Derived>& points, int k) {
    Topology topology(static_cast<int>(points.cols()));
    if (k < 0) topology.note({"neighbour count", k, "is negative"});
    const typename Derived::PlainObject plain = points;
    if (!detail::all_finite(plain)) topology.note({"points", Defect::kNoIndex, "are not finite"});
    if (topology.defect_) return topology;

    if (topology.nodes() == 0) return topology;
    detail::NearestNeighbours nearest(plain, k);
    std::vector<Link> links;
    detail::require_memory(3.0 * sizeof(Link) * topology.nodes() * std::min(k, topology.nodes() - 1));
    for (int i = 0; i < topology.nodes(); ++i) {
      for (const auto& [distance, j] : nearest.of(i)) links.push_back({std::min(i, j), std::max(i, j)});
    }
    const auto order = [](const Link& a, const Link& b) { return std::pair(a.i, a.j) < std::pair(b.i, b.j); };
    std::sort(links.begin(), links.end(), order);
    links.erase(std::unique(links.begin(), links.end()), links.end());
    for (const Link& link : links) topology.add(link);
    return topology;
  }

  /// The given links between `n` nodes.
  static Topology from_links(int n, std::span<const Link> links) {
    Topology topology(n);
    for (const Link& link : links) topology.add(link);
    return topology;
  }
  static Topology from_links(int n, std::initializer_list<Link> links) {
    return from_links(n, std::span(links.begin(), links.size()));
  }

  int nodes() const {
    if constexpr (N != Eigen::Dynamic) return N;  // for loops over few nodes to be unrolled
    return nodes_;
  }
  int link_count() const {
    if constexpr (kMaxLinks == Eigen::Dynamic) {
      return static_cast<int>(links_.size());
    } else {
      return link_count_;
    }
  }
  /// Made by full(), so that the links' order is known.
  bool is_full() const { return is_full_ && (link_count() > 0 || nodes_ < 2); }
  std::span<const Link> links() const { return {links_.data(), static_cast<std::size_t>(link_count())}; }

  /// The first defect of the list of links that this topology was made from.
  const Defect& defect() const { return defect_; }

 private:
  explicit Topology(int n) : nodes_(fitting(n)) {
    if (n != nodes_) note({"node count", n, n < 0 ? "is negative" : "does not fit the topology's type"});
  }

  static int fitting(int n) {
    if constexpr (N != Eigen::Dynamic) return N;
    return std::clamp(n, 0, MaxN == Eigen::Dynamic ? std::numeric_limits<int>::max() : MaxN);
  }

  void note(Defect defect) {
    if (!defect_) defect_ = defect;
  }

  void add(Link link) {
    if (defect_) return;
    const auto is_node = [this](int index) { return 0 <= index && index < nodes_; };
    if (!is_node(link.i) || !is_node(link.j))
      return note({"link", link_count(), "has an end that is out of range"});
    if (link.i == link.j) return note({"link", link_count(), "joins a node to itself"});
    if constexpr (kMaxLinks == Eigen::Dynamic) {
      links_.push_back(link);
    } else {
      if (link_count_ == kMaxLinks) return note({"link", link_count_, "is beyond the topology's capacity"});
      links_[static_cast<std::size_t>(link_count_++)] = link;
    }
  }

  using Storage = std::conditional_t<kMaxLinks == Eigen::Dynamic, std::vector<Link>,
                                     std::array<Link, static_cast<std::size_t>(std::max(1, kMaxLinks))>>;

  int nodes_ = 0;
  bool is_full_ = false;
  Storage links_{};
  int link_count_ = 0;  // of an array
  Defect defect_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
