#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/export.hpp>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <utility>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// An undirected graph of nodes 0 .. nodes() - 1. The neighbours of each node follow each other in one array.
class ASTERISM_API Graph {
 public:
  /// Joins two nodes.
  struct Edge {
    int from;       ///< a node
    int to;         ///< another one
    double length;  ///< >= 0 and finite
  };

  /// Several edges may join the same two nodes. Throws std::invalid_argument for an end that is no node, and
  /// for a length that is not >= 0 and finite.
  Graph(int nodes, std::span<const Edge> edges);

  int nodes() const { return static_cast<int>(first_.size()) - 1; }
  /// All edges have the same length.
  bool is_uniform() const { return lengths_.empty(); }
  /// The length of all edges, 1 if there are none.
  double unit() const { return unit_; }
  std::span<const int> neighbours(int node) const {
    return {&ends_[0] + first(node), &ends_[0] + first(node + 1)};
  }
  /// The lengths of the edges to the neighbours, in the same order. Only if the graph is not uniform.
  std::span<const double> lengths(int node) const {
    return {&lengths_[0] + first(node), &lengths_[0] + first(node + 1)};
  }
  /// The number of the connected component of each node; components are numbered by their first nodes.
  std::vector<int> components() const;
  /// This graph with other numbers: node k is node order[k] of this one. `order` has each node once.
  Graph renumbered(std::span<const int> order) const;

 private:
  Graph() = default;
  std::size_t first(int node) const { return first_[static_cast<std::size_t>(node)]; }

  std::vector<std::size_t> first_;  // of each node in ends_
  std::vector<int> ends_;
  std::vector<double> lengths_;  // of the edges to ends_; empty if they are all unit_
  double unit_ = 1;
};

/// Finds shortest paths from one node at a time, by breadth-first search if the graph is uniform and
/// otherwise by Dijkstra's algorithm, in time of what it reaches and not of the graph. The graph has to
/// outlive it.
class ASTERISM_API ShortestPaths {
 public:
  /// No limit for find.
  static constexpr std::size_t kAll = std::numeric_limits<std::size_t>::max();

  /// For this graph, by reference.
  explicit ShortestPaths(const Graph& graph);

  /// Finds the `most` nodes of the component that are nearest to the source, itself included.
  void find(int source, std::size_t most = kAll);
  /// The nodes found by ascending distance: first the source. Valid until the next call.
  std::span<const int> nodes() const { return {nodes_.data(), count_}; }
  /// The lengths of the shortest paths to them.
  std::span<const double> lengths() const { return lengths_; }

 private:
  using Entry = std::pair<double, int>;

  void find_by_breadth(std::size_t most);
  void find_by_length(std::size_t most);
  bool see(int node);

  const Graph* graph_;
  std::vector<std::uint32_t> seen_;  // the number of the search that saw a node last
  std::uint32_t search_ = 0;
  std::vector<double> best_;  // of the nodes seen: the shortest length so far; only for lengths that differ
  std::vector<int> nodes_;    // those found, and room for all and one more
  std::size_t count_ = 0;
  std::vector<double> lengths_;
  std::vector<Entry> queue_;  // a heap, the nearest first
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
