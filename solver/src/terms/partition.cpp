#include "partition.hpp"

#include <utility>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

Incidence::Incidence(const System& system) : first_(static_cast<std::size_t>(system.nodes()) + 1, 0) {
  for (int t = 0; t < system.term_count(); ++t) {
    const Eigen::MatrixXi& nodes = system.term(t).nodes();
    nodes_.push_back({nodes.data(), static_cast<int>(nodes.rows())});
    for (Eigen::Index k = 0; k < nodes.size(); ++k) ++first_[nodes.data()[k]];
  }
  std::ptrdiff_t sum = 0;
  for (std::ptrdiff_t& first : first_) sum += std::exchange(first, sum);
  elements_.resize(static_cast<std::size_t>(sum));
  Indexed<std::ptrdiff_t> next(first_);
  for (int t = 0; t < system.term_count(); ++t) {
    for (int e = 0; e < system.term(t).size(); ++e) {
      for (const int node : nodes_of({t, e})) elements_[static_cast<std::size_t>(next[node]++)] = {t, e};
    }
  }
}

Partition::Partition(const Incidence& incidence, int size) {
  constexpr int kNone = -1;
  const int n = incidence.nodes();
  Indexed<int> owner(static_cast<std::size_t>(n), kNone);
  Indexed<int> seen(static_cast<std::size_t>(n), kNone);
  std::vector<int> frontier;  // nodes next to a subdomain, oldest first
  std::vector<int> grown;
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
      for (const Incidence::Element& element : incidence.of(grown[next])) {
        for (const int node : incidence.nodes_of(element)) {
          if (owner[node] == kNone) {
            if (std::exchange(seen[node], count) != count) grown.push_back(node);
          } else if (owner[node] != count) {
            beside = owner[node];
          }
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

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
