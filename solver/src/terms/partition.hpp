#pragma once

#include <asterism/solver/base/indexed.hpp>
#include <asterism/solver/terms/system.hpp>
#include <cstddef>
#include <span>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// The elements of a system by their nodes. The system has to outlive it, with the same elements.
class Incidence {
 public:
  struct Element {
    int term;
    int number;  // in its term
  };

  Incidence() = default;
  explicit Incidence(const System& system);

  /// The elements of a node, by term and number. An element that has the node twice comes twice.
  std::span<const Element> of(int node) const {
    return {elements_.data() + first_[node], elements_.data() + first_[node + 1]};
  }
  std::span<const int> nodes_of(const Element& element) const {
    const Nodes& nodes = nodes_[element.term];
    return {nodes.data + std::ptrdiff_t{nodes.arity} * element.number, static_cast<std::size_t>(nodes.arity)};
  }
  int nodes() const { return static_cast<int>(first_.size()) - 1; }

 private:
  struct Nodes {
    const int* data;
    int arity;
  };
  Indexed<Nodes> nodes_;           // of each term's elements
  Indexed<std::ptrdiff_t> first_;  // of each node's elements
  std::vector<Element> elements_;
};

/// A partition of nodes into connected subdomains of some `size` nodes each, grown breadth first one beside
/// the other. order[k] is the k-th node, subdomain s has those from first[s] to first[s + 1].
struct Partition {
  Indexed<int> order;
  Indexed<int> first;

  Partition() = default;
  Partition(const Incidence& incidence, int size);

  int count() const { return static_cast<int>(first.size()) - 1; }
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
