#pragma once

#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <concepts>
#include <cstddef>
#include <span>
#include <utility>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// A std::vector indexed by int, like nodes and links.
template <typename T>
class Indexed : public std::vector<T> {
 public:
  using std::vector<T>::vector;

  template <std::integral Index>
  T& operator[](Index i) {
    return std::vector<T>::operator[](static_cast<std::size_t>(i));
  }
  template <std::integral Index>
  const T& operator[](Index i) const {
    return std::vector<T>::operator[](static_cast<std::size_t>(i));
  }
};

/// Adjacency of nodes: node i's neighbours and the links to them.
class Neighbours {
 public:
  struct Neighbour {
    int node;
    int link;
  };

  Neighbours() = default;
  Neighbours(int n, std::span<const Link> links)
      : first_(static_cast<std::size_t>(n) + 1, 0), neighbours_(2 * links.size()) {
    for (const Link& link : links) ++first_[link.i], ++first_[link.j];
    int sum = 0;
    for (int& first : first_) sum += std::exchange(first, sum);
    Indexed<int> next(first_);
    int l = 0;
    for (const Link& link : links) {
      neighbours_[next[link.i]++] = {link.j, l};
      neighbours_[next[link.j]++] = {link.i, l};
      ++l;
    }
  }

  std::span<const Neighbour> of(int i) const {
    return {neighbours_.data() + first_[i], neighbours_.data() + first_[i + 1]};
  }

 private:
  Indexed<int> first_;
  Indexed<Neighbour> neighbours_;
};

/// A partition of nodes into connected subdomains of some `size` nodes each, grown breadth first one beside
/// the other. order[k] is the k-th node, subdomain s has those from first[s] to first[s + 1].
struct Partition {
  Indexed<int> order;
  Indexed<int> first;

  Partition() = default;
  Partition(int n, const Neighbours& neighbours, int size) {
    constexpr int kNone = -1;
    Indexed<int> owner(static_cast<std::size_t>(n), kNone);
    Indexed<int> seen(static_cast<std::size_t>(n), kNone);
    Indexed<int> frontier;  // nodes next to a subdomain, oldest first
    Indexed<int> grown;
    std::size_t oldest = 0;
    int count = 0;
    int unseen = 0;
    while (true) {
      while (oldest < frontier.size() && owner[frontier[oldest]] != kNone) ++oldest;
      while (oldest == frontier.size() && unseen < n && owner[unseen] != kNone) ++unseen;
      if (oldest == frontier.size() && unseen == n) break;
      grown.assign(1, oldest < frontier.size() ? frontier[oldest] : unseen);
      seen[grown[0]] = count;
      int beside = kNone;
      for (std::size_t next = 0; next < grown.size() && next < static_cast<std::size_t>(size); ++next) {
        owner[grown[next]] = count;
        for (const auto [node, link] : neighbours.of(grown[next])) {
          if (owner[node] == kNone) {
            if (std::exchange(seen[node], count) != count) grown.push_back(node);
          } else if (owner[node] != count) {
            beside = owner[node];
          }
        }
      }
      if (grown.size() > static_cast<std::size_t>(size)) {
        frontier.insert(frontier.end(), grown.begin() + size, grown.end());
      } else if (beside != kNone && grown.size() < static_cast<std::size_t>(size / 4)) {
        for (const int node : grown) owner[node] = beside;  // what is left between others
        continue;
      }
      ++count;
    }
    first.assign(static_cast<std::size_t>(count) + 1, 0);
    for (const int s : owner) ++first[s];
    int sum = 0;
    for (int& f : first) sum += std::exchange(f, sum);
    order.resize(static_cast<std::size_t>(n));
    Indexed<int> next(first);
    for (int i = 0; i < n; ++i) order[next[owner[i]]++] = i;
  }

  int count() const { return static_cast<int>(first.size()) - 1; }
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
