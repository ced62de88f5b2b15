#include <algorithm>
#include <asterism/solver/base/counted.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/graph/graph.hpp>
#include <cmath>
#include <functional>
#include <numeric>
#include <stdexcept>
#include <string>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

std::size_t at(int node) { return static_cast<std::size_t>(node); }

}  // namespace

Graph::Graph(int nodes, std::span<const Edge> edges) : first_(at(nodes) + 1) {
  bool is_uniform = true;
  for (const Edge& edge : edges) {
    for (const int end : {edge.from, edge.to}) {
      if (end < 0 || end >= nodes)
        detail::raise(std::invalid_argument("edge " + std::to_string(&edge - edges.data()) + " ends at " +
                                            std::to_string(end) + ", which is not a node (" +
                                            detail::counted(nodes, "node") + ")"));
      ++first_[at(end) + 1];
    }
    if (!(edge.length >= 0 && std::isfinite(edge.length)))
      detail::raise(std::invalid_argument("the length of an edge is not >= 0 and finite"));
    if (edge.length != edges.front().length) is_uniform = false;
  }
  std::partial_sum(first_.begin(), first_.end(), first_.begin());
  if (!edges.empty()) unit_ = edges.front().length;
  ends_.resize(first_.back() + 1);  // one more, so that there is a first one
  if (!is_uniform) lengths_.resize(first_.back() + 1);
  std::vector<std::size_t> place(first_.begin(), first_.end() - 1);
  for (const Edge& edge : edges) {
    for (const auto& [from, to] : {std::pair(edge.from, edge.to), std::pair(edge.to, edge.from)}) {
      const std::size_t k = place[at(from)]++;
      ends_[k] = to;
      if (!is_uniform) lengths_[k] = edge.length;
    }
  }
}

std::vector<int> Graph::components() const {
  std::vector<int> of(at(nodes()), -1);
  std::vector<int> reached;
  int count = 0;
  for (int i = 0; i < nodes(); ++i) {
    if (of[at(i)] >= 0) continue;
    of[at(i)] = count;
    reached.assign(1, i);
    while (!reached.empty()) {
      const int node = reached.back();
      reached.pop_back();
      for (const int next : neighbours(node)) {
        if (of[at(next)] >= 0) continue;
        of[at(next)] = count;
        reached.push_back(next);
      }
    }
    ++count;
  }
  return of;
}

Graph Graph::renumbered(std::span<const int> order) const {
  std::vector<int> number(order.size());
  for (std::size_t k = 0; k < order.size(); ++k) number[at(order[k])] = static_cast<int>(k);
  Graph result;
  result.unit_ = unit_;
  result.first_.reserve(first_.size());
  result.first_.push_back(0);
  result.ends_.reserve(ends_.size());
  result.lengths_.reserve(lengths_.size());
  for (const int node : order) {
    for (const int next : neighbours(node)) result.ends_.push_back(number[at(next)]);
    result.first_.push_back(result.ends_.size());
    if (is_uniform()) continue;
    const std::span<const double> along = lengths(node);
    result.lengths_.insert(result.lengths_.end(), along.begin(), along.end());
  }
  result.ends_.push_back(0);
  if (!is_uniform()) result.lengths_.push_back(0);
  return result;
}

ShortestPaths::ShortestPaths(const Graph& graph)
    : graph_(&graph),
      seen_(at(graph.nodes())),
      best_(graph.is_uniform() ? 0 : at(graph.nodes())),
      nodes_(at(graph.nodes()) + 1) {}

void ShortestPaths::find(int source, std::size_t most) {
  if (++search_ == 0) {
    std::fill(seen_.begin(), seen_.end(), 0);
    search_ = 1;
  }
  nodes_[0] = source;
  lengths_.assign(1, 0);
  see(source);
  if (graph_->is_uniform()) {
    find_by_breadth(most);
  } else {
    find_by_length(most);
  }
}

/// Whether this search had not seen the node.
bool ShortestPaths::see(int node) {
  if (seen_[at(node)] == search_) return false;
  seen_[at(node)] = search_;
  return true;
}

void ShortestPaths::find_by_breadth(std::size_t most) {
  std::size_t count = 1;
  double edges = 0;
  for (std::size_t next = 0; next < count && count < most;) {
    // One level more. The loop over the edges has no branch, which would often be mispredicted.
    for (const std::size_t end = count; next < end && count < most; ++next) {
      const std::span<const int> ends = graph_->neighbours(nodes_[next]);
      for (std::size_t k = 0; k < ends.size() && count < most;) {
        for (const std::size_t stop = std::min(ends.size(), k + (most - count)); k < stop; ++k) {
          nodes_[count] = ends[k];
          std::uint32_t& seen = seen_[at(ends[k])];
          count += seen != search_ ? 1 : 0;
          seen = search_;
        }
      }
    }
    lengths_.resize(count, ++edges * graph_->unit());
  }
  count_ = count;
}

void ShortestPaths::find_by_length(std::size_t most) {
  const int source = nodes_.front();
  count_ = 0;
  lengths_.clear();
  best_[at(source)] = 0;
  queue_.assign(1, {0, source});
  while (!queue_.empty() && count_ < most) {
    const auto [length, node] = queue_.front();
    std::pop_heap(queue_.begin(), queue_.end(), std::greater());
    queue_.pop_back();
    if (length > best_[at(node)]) continue;
    nodes_[count_++] = node;
    lengths_.push_back(length);
    const std::span<const int> ends = graph_->neighbours(node);
    const std::span<const double> along = graph_->lengths(node);
    for (std::size_t k = 0; k < ends.size(); ++k) {
      double& best = best_[at(ends[k])];
      if (!see(ends[k]) && length + along[k] >= best) continue;
      best = length + along[k];
      queue_.emplace_back(best, ends[k]);
      std::push_heap(queue_.begin(), queue_.end(), std::greater());
    }
  }
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
