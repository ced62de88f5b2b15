#pragma once

#include <algorithm>
#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/indexed.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/spring_element.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/executor.hpp>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// Sums over the springs of a large system, on several threads. Nodes are divided into chunks of consecutive
/// ones, and links by the chunk of their lower node. A link between two chunks adds to the node of its own
/// chunk, and to the other one after all chunks are done. Whether and how a system is divided depends on its
/// topology alone, and sums are made chunk by chunk, so that results do not depend on the number of threads.
///
/// A system stays in one chunk if it is small, if its links are not in the order of their lower nodes, or if
/// more than a quarter of them are between chunks, as where near nodes do not have near numbers.
template <typename System>
class SpringChunks {
 public:
  using Scalar = typename System::Scalar;
  using Point = typename System::Point;
  using Points = typename System::Points;
  static constexpr int kDim = System::kDim;
  /// Whether any system of this type can have several chunks.
  static constexpr bool kPossible = System::kMaxNodes == Eigen::Dynamic;
  /// Nodes of a chunk.
  static constexpr int kSize = 1 << 13;

  /// Divides the topology of `system`, for up to `threads` threads.
  void set(const System& system, int threads) {
    threads_ = threads;
    nodes_ = system.nodes();
    links_ = system.link_count();
    count_ = 1;
    if constexpr (kPossible) {
      if (nodes_ >= 4 * kSize) divide(system.links());
    }
  }

  int count() const { return count_; }

  /// Calls f(first, count) with the nodes of each chunk.
  template <typename F>
  void for_each(F&& f) const {
    for_each_chunk([&](int c) { f(first_of(c), first_of(c + 1) - first_of(c)); });
  }

  /// The sum of f(first, count) over the chunks.
  template <typename F>
  Scalar sum(F&& f) {
    return sum_of_chunks([&](int c) { return f(first_of(c), first_of(c + 1) - first_of(c)); });
  }

  /// Columns of points, one for each node; all of them where there is only one chunk.
  template <typename Matrix>
  static decltype(auto) columns(Matrix& points, [[maybe_unused]] int first, [[maybe_unused]] int count) {
    if constexpr (kPossible) {
      return points.middleCols(first, count);
    } else {
      return (points);
    }
  }

  /// The sum of the products of all coordinates.
  Scalar dot(const Points& a, const Points& b) {
    return sum([&](int first, int count) {
      return columns(a, first, count).cwiseProduct(columns(b, first, count)).sum();
    });
  }

  Scalar energy(const System& system, const Points& x) {
    if (count_ == 1) return asterism::energy(system, x);
    return sum_of_chunks([&](int c) {
      Scalar energy = 0;
      for (int i = first_of(c); i < first_of(c + 1); ++i)
        energy += node_force(system, i, x, anchor_offset(system, i, x)).energy;
      for (int l = first_link_of(c); l < first_link_of(c + 1); ++l) {
        const Link link = system.links()[static_cast<std::size_t>(l)];
        energy += link_force(system, l, spring(system, link, link_difference(system, l, link, x))).energy;
      }
      return energy;
    });
  }

  Scalar energy_and_gradient(const System& system, const Points& x, Points& gradient) {
    if (count_ == 1) return asterism::energy_and_gradient(system, x, gradient);
    gradient.resize(kDim, nodes_);
    return scatter<1, true>(
        system, gradient,
        [&](int i, Scalar& energy) {
          const auto node = node_force(system, i, x, anchor_offset(system, i, x));
          gradient.col(i) = node.gradient;
          energy += node.energy;
        },
        [&](int l, const Link& link, Scalar& energy) -> Point {
          const Spring<System> here = spring(system, link, link_difference(system, l, link, x));
          const auto force = link_force(system, l, here);
          energy += force.energy;
          return force.tension * here.direction;
        },
        [&](int i) {
          if (system.is_fixed(i)) gradient.col(i).setZero();
        });
  }

  /// `out` has kWidth columns for each node. Calls begin(i, sum), which sets those of node i, for each node,
  /// and adds of_link(l, link, sum) to those of the first node of each link and, with kOpposite, minus that
  /// to those of the second one, else the same. Then calls end(i) for each node. Returns the sum of what the
  /// calls add to `sum`. Calls for nodes and links of different chunks may be at the same time.
  template <int kWidth, bool kOpposite, typename Out, typename Begin, typename OfLink, typename End>
  Scalar scatter(const System& system, Out& out, Begin&& begin, OfLink&& of_link, End&& end) {
    const std::span<const Link> links = system.links();
    const auto add = [](auto&& to, const auto& value, bool is_first) {
      if (is_first || !kOpposite) {
        to += value;
      } else {
        to -= value;
      }
    };
    const auto at = [&](int i) { return out.template middleCols<kWidth>(kWidth * i); };
    if constexpr (kPossible) outgoing_.resize(kDim, kWidth * static_cast<Eigen::Index>(upper_.size()));
    const Scalar sum = sum_of_chunks([&](int c) {
      Scalar of_chunk = 0;
      const int last = first_of(c + 1);
      for (int i = first_of(c); i < last; ++i) begin(i, of_chunk);
      [[maybe_unused]] int slot = first_slot_of(c);
      for (int l = first_link_of(c); l < first_link_of(c + 1); ++l) {
        const Link& link = links[static_cast<std::size_t>(l)];
        const auto value = of_link(l, link, of_chunk);
        if constexpr (kPossible) {
          if (std::max(link.i, link.j) >= last) [[unlikely]] {
            const bool is_first = link.i < link.j;
            add(at(is_first ? link.i : link.j), value, is_first);
            auto kept = outgoing_.template middleCols<kWidth>(kWidth * slot++);
            kept.setZero();
            add(kept, value, !is_first);
            continue;
          }
        }
        add(at(link.i), value, true);
        add(at(link.j), value, false);
      }
      return of_chunk;
    });
    for_each_chunk([&](int c) {
      if constexpr (kPossible) {
        if (count_ > 1) {
          for (int k = incoming_first_[c]; k < incoming_first_[c + 1]; ++k) {
            const int slot = incoming_[k];
            at(upper_[slot]) += outgoing_.template middleCols<kWidth>(kWidth * slot);
          }
        }
      }
      for (int i = first_of(c); i < first_of(c + 1); ++i) end(i);
    });
    return sum;
  }

  /// Calls f(l) for each link.
  template <typename F>
  void for_each_link(F&& f) const {
    for_each_chunk([&](int c) {
      for (int l = first_link_of(c); l < first_link_of(c + 1); ++l) f(l);
    });
  }

 private:
  int first_of(int c) const { return c < count_ ? c * kSize : nodes_; }
  int first_link_of(int c) const {
    if constexpr (kPossible) {
      if (count_ > 1) return link_first_[c];
    }
    return c == 0 ? 0 : links_;
  }
  int first_slot_of([[maybe_unused]] int c) const {
    if constexpr (kPossible) {
      if (count_ > 1) return slot_first_[c];
    }
    return 0;
  }

  template <typename F>
  void for_each_chunk(F&& f) const {
    if (count_ == 1) return f(0);
    for_each_task(threads_, count_, [&](int, int c) { f(c); });
  }
  template <typename F>
  Scalar sum_of_chunks(F&& f) {
    if constexpr (kPossible) {
      if (count_ > 1) {
        partial_.resize(static_cast<std::size_t>(count_));
        for_each_chunk([&](int c) { partial_[c] = f(c); });
        Scalar sum = 0;
        for (const Scalar of_chunk : partial_) sum += of_chunk;
        return sum;
      }
    }
    return f(0);
  }

  // Counts the links of each chunk and those to other chunks, and lists the latter by the chunk that they
  // lead to.
  void divide(std::span<const Link> links) {
    const int chunks = (nodes_ + kSize - 1) / kSize;
    upper_.clear();
    link_first_.assign(static_cast<std::size_t>(chunks) + 1, links_);
    slot_first_.assign(static_cast<std::size_t>(chunks) + 1, 0);
    incoming_first_.assign(static_cast<std::size_t>(chunks) + 1, 0);
    const std::size_t most = links.size() / 4;
    int own = -1;
    for (int l = 0; const Link& link : links) {
      const int c = std::min(link.i, link.j) / kSize;
      const int upper = std::max(link.i, link.j);
      if (c < own || upper_.size() > most) {
        upper_.clear();
        return;
      }
      while (own < c) link_first_[++own] = l, slot_first_[own] = static_cast<int>(upper_.size());
      if (upper / kSize != c) {
        upper_.push_back(upper);
        ++incoming_first_[upper / kSize];
      }
      ++l;
    }
    while (own < chunks) link_first_[++own] = links_, slot_first_[own] = static_cast<int>(upper_.size());
    int sum = 0;
    for (int& first : incoming_first_) sum += std::exchange(first, sum);
    incoming_.resize(upper_.size());
    Indexed<int> next(incoming_first_);
    for (int slot = 0; const int upper : upper_) incoming_[next[upper / kSize]++] = slot++;
    count_ = chunks;
  }

  int threads_ = 1;
  int count_ = 1;
  int nodes_ = 0;
  int links_ = 0;
  // Of several chunks. A link to another chunk has a slot; slots are in the order of links.
  Indexed<int> link_first_;
  Indexed<int> slot_first_;
  Indexed<int> upper_;  // a slot's node in the other chunk
  Indexed<int> incoming_first_;
  Indexed<int> incoming_;  // slots by the chunk of that node
  Indexed<Scalar> partial_;
  Eigen::Matrix<Scalar, kDim, Eigen::Dynamic, (kDim == 1 ? Eigen::RowMajor : Eigen::ColMajor)> outgoing_;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
