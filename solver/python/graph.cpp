// Shortest paths along a graph and the stress of its drawings; asterism/embedding.py uses them.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <iterator>
#include <limits>
#include <numeric>
#include <queue>
#include <utility>
#include <vector>

#include "bindings.hpp"

namespace asterism::python {

namespace {

using Integers = py::array_t<std::int64_t, py::array::c_style | py::array::forcecast>;
using Numbers = py::array_t<double, py::array::c_style | py::array::forcecast>;

constexpr double kFar = std::numeric_limits<double>::infinity();

/// An undirected graph: the neighbours of each node in one array. embedding.py has checked what it gives.
class Graph {
 public:
  using BoundToPython = void;

  Graph(int nodes, const Integers& ends, const Numbers& lengths)
      : first_(static_cast<std::size_t>(nodes) + 1), distances_(static_cast<std::size_t>(nodes), kFar) {
    const auto pairs = ends.unchecked<2>();
    const auto along = lengths.unchecked<1>();
    const py::ssize_t edges = along.shape(0);
    if (pairs.shape(0) != edges || pairs.shape(1) != 2)
      throw py::value_error("a length for each pair of ends");
    for (py::ssize_t e = 0; e < edges; ++e) {
      for (int end : {0, 1}) {
        if (pairs(e, end) < 0 || pairs(e, end) >= nodes) throw py::index_error("an end is out of range");
        ++first_[static_cast<std::size_t>(pairs(e, end)) + 1];
      }
      if (along(e) != along(0)) is_uniform_ = false;
    }
    std::partial_sum(first_.begin(), first_.end(), first_.begin());
    unit_ = edges > 0 ? along(0) : 1;
    is_uniform_ = is_uniform_ && unit_ > 0;
    neighbours_.resize(first_.back());
    std::vector<std::size_t> place(first_.begin(), first_.end() - 1);
    for (py::ssize_t e = 0; e < edges; ++e) {
      const auto i = static_cast<std::size_t>(pairs(e, 0)), j = static_cast<std::size_t>(pairs(e, 1));
      neighbours_[place[i]++] = {static_cast<int>(j), along(e)};
      neighbours_[place[j]++] = {static_cast<int>(i), along(e)};
    }
  }

  int nodes() const { return static_cast<int>(first_.size()) - 1; }

  /// Number of the connected component of each node; components are numbered by their first nodes.
  std::vector<int> components() const {
    std::vector<int> of(static_cast<std::size_t>(nodes()), -1);
    std::vector<int> reached;
    int count = 0;
    for (int i = 0; i < nodes(); ++i) {
      if (of[at(i)] >= 0) continue;
      of[at(i)] = count;
      reached.assign(1, i);
      while (!reached.empty()) {
        const int node = reached.back();
        reached.pop_back();
        for_each_neighbour(node, [&](int next, double) {
          if (of[at(next)] >= 0) return;
          of[at(next)] = count;
          reached.push_back(next);
        });
      }
      ++count;
    }
    return of;
  }

  /// Lengths of the shortest paths from `source` to all nodes, infinite to those that it does not reach. In
  /// time of the component, not of the graph. Valid until the next call.
  const std::vector<double>& distances_from(int source) {
    double* const to = distances_.data();
    for (const int node : reached_) to[node] = kFar;
    reached_.assign(1, source);
    to[source] = 0;
    if (is_uniform_) {
      for (std::size_t next = 0; next < reached_.size(); ++next) {
        const double beyond = to[reached_[next]] + 1;
        for_each_neighbour(reached_[next], [&](int node, double) {
          if (to[node] != kFar) return;
          to[node] = beyond;
          reached_.push_back(node);
        });
      }
      for (const int node : reached_) to[node] *= unit_;
      return distances_;
    }
    queue_.push({0, source});
    while (!queue_.empty()) {
      const auto [distance, node] = queue_.top();
      queue_.pop();
      if (distance > to[node]) continue;
      for_each_neighbour(node, [&, distance = distance](int next, double length) {
        if (distance + length >= to[next]) return;
        if (to[next] == kFar) reached_.push_back(next);
        to[next] = distance + length;
        queue_.push({to[next], next});
      });
    }
    return distances_;
  }

  /// f(j, length) for the nodes j > `source` of its component in ascending order, with the lengths of the
  /// shortest paths.
  template <typename F>
  void for_each_after(int source, F&& f) {
    const std::vector<double>& to = distances_from(source);
    // To sort the nodes, or to look at all.
    if (reached_.size() < distances_.size() / 16) {
      after_.clear();
      std::copy_if(reached_.begin(), reached_.end(), std::back_inserter(after_),
                   [source](int node) { return node > source; });
      std::sort(after_.begin(), after_.end());
      for (const int node : after_) f(node, to[at(node)]);
      return;
    }
    for (int node = source + 1; node < nodes(); ++node) {
      if (to[at(node)] != kFar) f(node, to[at(node)]);
    }
  }

  /// The nodes of the component of the last source, the source first.
  const std::vector<int>& reached() const { return reached_; }

  template <typename F>
  void for_each_neighbour(int node, F&& f) const {
    for (std::size_t k = first_[at(node)]; k < first_[at(node) + 1]; ++k)
      f(neighbours_[k].node, neighbours_[k].length);
  }

  bool busy = false;

 private:
  struct Neighbour {
    int node;
    double length;
  };
  using Entry = std::pair<double, int>;

  static std::size_t at(int node) { return static_cast<std::size_t>(node); }

  std::vector<std::size_t> first_;  // of node i in neighbours_
  std::vector<Neighbour> neighbours_;
  bool is_uniform_ = true;  // all edges have the length unit_: breadth-first search
  double unit_ = 1;
  std::vector<double> distances_;  // from the last source, kFar for nodes that are not in reached_
  std::vector<int> reached_, after_;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> queue_;
};

/// f(i) for 0 .. count - 1 without the GIL, which is taken now and then for Ctrl-C.
template <typename F>
void for_each_interruptible(py::ssize_t count, int nodes, F&& f) {
  const py::ssize_t stride = std::max<py::ssize_t>(1, 1000000 / std::max(nodes, 1));
  const py::gil_scoped_release release;
  for (py::ssize_t i = 0; i < count; ++i) {
    f(i);
    if (i % stride != stride - 1) continue;
    const py::gil_scoped_acquire acquire;
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
  }
}

/// SplitMix64 (Steele, Lea and Flood 2014).
std::uint64_t random(std::uint64_t& state) {
  std::uint64_t z = state += 0x9e3779b97f4a7c15ULL;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

struct Pairs {
  std::vector<std::int64_t> ends;
  std::vector<double> lengths;
  std::vector<double> shares;

  void add(int i, int j, double length, double share) {
    ends.insert(ends.end(), {i, j});
    lengths.push_back(length);
    shares.push_back(share);
  }
  py::tuple arrays() const {
    const auto count = static_cast<py::ssize_t>(lengths.size());
    return py::make_tuple(py::array_t<std::int64_t>(Shape{count, 2}, ends.data()),
                          py::array_t<double>(count, lengths.data()),
                          py::array_t<double>(count, shares.data()));
  }
};

/// Of all pairs that a path joins: sum w (d - r)^2, sum w r d and sum w r^2, with w = d^-power and r
/// the distance in the drawing.
template <int Dim>
py::tuple stress_sums(Graph& graph, const Eigen::Map<const typename System<Dim>::Points>& x, double power) {
  double sums[3] = {};
  for_each_interruptible(graph.nodes(), graph.nodes(), [&](py::ssize_t i) {
    double of_node[3] = {};
    graph.for_each_after(static_cast<int>(i), [&](int j, double d) {
      const double weight = power == 2 ? 1 / (d * d) : std::pow(d, -power);
      const double r = (x.col(i) - x.col(j)).norm();
      of_node[0] += weight * (d - r) * (d - r);
      of_node[1] += weight * r * d;
      of_node[2] += weight * r * r;
    });
    for (int k = 0; k < 3; ++k) sums[k] += of_node[k];
  });
  return py::make_tuple(sums[0], sums[1], sums[2]);
}

}  // namespace

void bind_graph(py::module_& m) {
  py::class_<Graph> graph(m, "_Graph");
  def_reduce(graph);
  graph
      .def(py::init<int, const Integers&, const Numbers&>(), py::arg("nodes"), py::arg("ends"),
           py::arg("lengths"))
      .def("components",
           [](const Graph& self) {
             const std::vector<int> of = self.components();
             return py::array_t<int>(static_cast<py::ssize_t>(of.size()), of.data());
           })
      .def(
          "distances",  // (C, S, T), for each row of sources (C, S) to that of targets (C, T)
          [](Graph& self, const Integers& sources, const Integers& targets) {
            const Exclusive exclusive(self.busy, "this graph");
            const auto from = sources.unchecked<2>(), to = targets.unchecked<2>();
            const auto is_known = [&](std::int64_t node) { return node >= 0 && node < self.nodes(); };
            const bool are_known = std::all_of(sources.data(), sources.data() + sources.size(), is_known) &&
                                   std::all_of(targets.data(), targets.data() + targets.size(), is_known);
            if (!are_known || from.shape(0) != to.shape(0))
              throw py::index_error("a source or a target is out of range");
            py::array_t<double> result(Shape{from.shape(0), from.shape(1), to.shape(1)});
            double* next = result.mutable_data();
            for_each_interruptible(sources.size(), self.nodes(), [&](py::ssize_t s) {
              const py::ssize_t row = s / from.shape(1);
              const auto& lengths = self.distances_from(static_cast<int>(from(row, s % from.shape(1))));
              for (py::ssize_t t = 0; t < to.shape(1); ++t)
                *next++ = lengths[static_cast<std::size_t>(to(row, t))];
            });
            return result;
          },
          py::arg("sources"), py::arg("targets"))
      .def(
          "partners",  // (L, 2), (L,) and (L,): pairs, lengths of the shortest paths, and for how many pairs
                       // each stands
          [](Graph& self, int count, std::uint64_t seed) {
            const Exclusive exclusive(self.busy, "this graph");
            Pairs found;
            std::vector<int> last(static_cast<std::size_t>(self.nodes()),
                                  -1);  // source whose neighbour a node is
            for_each_interruptible(self.nodes(), self.nodes(), [&](py::ssize_t index) {
              const int i = static_cast<int>(index);
              const std::vector<double>& to = self.distances_from(i);
              const auto add = [&](int j, double share) {
                found.add(i, j, to[static_cast<std::size_t>(j)], share);
              };
              const auto others = static_cast<std::uint64_t>(self.reached().size()) - 1;
              if (others <= 2 * static_cast<std::uint64_t>(count)) {  // all pairs are no more
                for (const int j : self.reached()) {
                  if (j > i) add(j, 1);
                }
                return;
              }
              self.for_each_neighbour(i, [&](int j, double) {
                int& by = last[static_cast<std::size_t>(j)];
                if (j > i && by != i) add(j, 1);
                by = i;
              });
              const double share = static_cast<double>(others) / (2.0 * count);
              for (int k = 0; k < count; ++k) {
                const int j = self.reached()[static_cast<std::size_t>(1 + random(seed) % others)];
                if (last[static_cast<std::size_t>(j)] != i) add(j, share);
              }
            });
            return found.arrays();
          },
          py::arg("count"), py::arg("seed"))
      .def(
          "pairs",  // (L, 2) and (L,): all pairs i < j that a path joins, and the lengths of the shortest
                    // ones
          [](Graph& self, py::ssize_t count) {
            const Exclusive exclusive(self.busy, "this graph");
            py::array_t<int> ends(Shape{count, 2});
            py::array_t<double> lengths(count);
            int* end = ends.mutable_data();
            double* length = lengths.mutable_data();
            for_each_interruptible(self.nodes(), self.nodes(), [&](py::ssize_t i) {
              self.for_each_after(static_cast<int>(i), [&](int j, double along) {
                if (count-- <= 0) throw std::out_of_range("more pairs than counted");
                *end++ = static_cast<int>(i);
                *end++ = j;
                *length++ = along;
              });
            });
            return py::make_tuple(ends, lengths);
          },
          py::arg("count"))
      .def(
          "stress_sums",
          [](Graph& self, const py::array_t<double>& x, double power) {
            const Exclusive exclusive(self.busy, "this graph");
            return x.shape(1) == 3 ? stress_sums<3>(self, map_points<3>(x), power)
                                   : stress_sums<2>(self, map_points<2>(x), power);
          },
          py::arg("x"), py::arg("power"));
}

}  // namespace asterism::python
