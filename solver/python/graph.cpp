// Shortest paths along a graph and the stress of its drawings; asterism/embedding.py uses them.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
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
      : first_(static_cast<std::size_t>(nodes) + 1) {
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

  /// Lengths of the shortest paths from `source` to all nodes, infinite to those that it does not reach.
  void distances_from(int source, double* to) {
    std::fill(to, to + nodes(), kFar);
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
      return;
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
  std::vector<int> reached_;
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

/// Of all pairs that a path joins: sum w (d - r)^2, sum w r (d - r) and sum w r^2, with w = d^-power and r
/// the distance in the drawing.
template <int Dim>
py::tuple stress_sums(Graph& graph, const Eigen::Map<const typename System<Dim>::Points>& x, double power) {
  double sums[3] = {};
  std::vector<double> to(static_cast<std::size_t>(graph.nodes()));
  for_each_interruptible(graph.nodes(), graph.nodes(), [&](py::ssize_t i) {
    graph.distances_from(static_cast<int>(i), to.data());
    double of_node[3] = {};
    for (int j = static_cast<int>(i) + 1; j < graph.nodes(); ++j) {
      const double d = to[static_cast<std::size_t>(j)];
      if (d == kFar) continue;
      const double weight = power == 2 ? 1 / (d * d) : std::pow(d, -power);
      const double r = (x.col(i) - x.col(j)).norm();
      of_node[0] += weight * (d - r) * (d - r);
      of_node[1] += weight * r * (d - r);
      of_node[2] += weight * r * r;
    }
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
          "distances",  // (S, N), from each source
          [](Graph& self, const Integers& sources) {
            const Exclusive exclusive(self.busy, "this graph");
            const auto from = sources.unchecked<1>();
            for (py::ssize_t s = 0; s < from.shape(0); ++s) {
              if (from(s) < 0 || from(s) >= self.nodes()) throw py::index_error("a source is out of range");
            }
            py::array_t<double> result(Shape{from.shape(0), self.nodes()});
            double* to = result.mutable_data();
            for_each_interruptible(from.shape(0), self.nodes(), [&](py::ssize_t s) {
              self.distances_from(static_cast<int>(from(s)), to + s * self.nodes());
            });
            return result;
          },
          py::arg("sources"))
      .def(
          "partners",  // (L, 2), (L,) and (L,): pairs, lengths of the shortest paths, and for how many pairs
                       // each stands
          [](Graph& self, int count, std::uint64_t seed) {
            const Exclusive exclusive(self.busy, "this graph");
            Pairs found;
            std::vector<double> to(static_cast<std::size_t>(self.nodes()));
            std::vector<int> last(static_cast<std::size_t>(self.nodes()),
                                  -1);  // source whose neighbour a node is
            for_each_interruptible(self.nodes(), self.nodes(), [&](py::ssize_t index) {
              const int i = static_cast<int>(index);
              self.distances_from(i, to.data());
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
            std::vector<double> to(static_cast<std::size_t>(self.nodes()));
            for_each_interruptible(self.nodes(), self.nodes(), [&](py::ssize_t i) {
              self.distances_from(static_cast<int>(i), to.data());
              for (int j = static_cast<int>(i) + 1; j < self.nodes(); ++j) {
                if (to[static_cast<std::size_t>(j)] == kFar) continue;
                if (count-- <= 0) throw std::out_of_range("more pairs than counted");
                *end++ = static_cast<int>(i);
                *end++ = j;
                *length++ = to[static_cast<std::size_t>(j)];
              }
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
