// Shortest paths along a graph and the stress of its drawings; asterism/embedding.py uses them.

#include <algorithm>
#include <asterism/solver/base/split_mix.hpp>
#include <asterism/solver/graph/drawing.hpp>
#include <asterism/solver/graph/graph.hpp>
#include <asterism/solver/graph/rules.hpp>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "bindings.hpp"
#include "interrupts.hpp"

template <>
inline constexpr bool kIsBoundToPython<asterism::DrawingRules> = true;

namespace asterism::python {

namespace {

using Integers = py::array_t<std::int64_t, py::array::c_style | py::array::forcecast>;
using Numbers = py::array_t<double, py::array::c_style | py::array::forcecast>;

constexpr double kFar = std::numeric_limits<double>::infinity();

std::size_t at(int node) { return static_cast<std::size_t>(node); }

std::vector<Graph::Edge> edges_of(int nodes, const Integers& ends, const Numbers& lengths) {
  const auto pairs = ends.unchecked<2>();
  const auto along = lengths.unchecked<1>();
  if (pairs.shape(0) != along.shape(0) || pairs.shape(1) != 2)
    throw py::value_error("a length for each pair of ends");
  std::vector<Graph::Edge> edges;
  edges.reserve(static_cast<std::size_t>(along.shape(0)));
  for (py::ssize_t e = 0; e < along.shape(0); ++e) {
    for (const int end : {0, 1}) {
      if (pairs(e, end) < 0 || pairs(e, end) >= nodes) throw py::index_error("an end is out of range");
    }
    edges.push_back({static_cast<int>(pairs(e, 0)), static_cast<int>(pairs(e, 1)), along(e)});
  }
  return edges;
}

/// asterism._Graph: a graph and a search of paths in it. embedding.py has checked what it gives.
class SearchedGraph {
 public:
  using BoundToPython = void;

  SearchedGraph(int nodes, const Integers& ends, const Numbers& lengths)
      : graph_(nodes, edges_of(nodes, ends, lengths)), paths_(graph_), distances_(at(nodes), kFar) {}
  SearchedGraph(const SearchedGraph&) = delete;
  SearchedGraph& operator=(const SearchedGraph&) = delete;

  const Graph& graph() const { return graph_; }
  int nodes() const { return graph_.nodes(); }

  /// Lengths of the shortest paths from `source` to all nodes, infinite to those that it does not reach. In
  /// time of the component, not of the graph. Valid until the next call.
  const std::vector<double>& distances_from(int source) {
    for (const int node : paths_.nodes()) distances_[at(node)] = kFar;
    paths_.find(source);
    for (std::size_t k = 0; k < reached().size(); ++k) distances_[at(reached()[k])] = paths_.lengths()[k];
    return distances_;
  }

  /// f(j, length) for the nodes j > `source` of its component in ascending order, with the lengths of the
  /// shortest paths.
  template <typename F>
  void for_each_after(int source, F&& f) {
    const std::vector<double>& to = distances_from(source);
    // To sort the nodes, or to look at all.
    if (reached().size() < distances_.size() / 16) {
      after_.clear();
      std::copy_if(reached().begin(), reached().end(), std::back_inserter(after_),
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
  std::span<const int> reached() const { return paths_.nodes(); }

  bool busy = false;

 private:
  Graph graph_;
  ShortestPaths paths_;
  std::vector<double> distances_;  // from the last source, kFar for nodes that are not reached
  std::vector<int> after_;
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
py::tuple stress_sums(SearchedGraph& graph, const Eigen::Map<const typename System<Dim>::Points>& x,
                      double power) {
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

template <typename T, typename Array>
std::vector<T> values_of(const Array& array) {
  std::vector<T> result;
  result.reserve(static_cast<std::size_t>(array.size()));
  std::transform(array.data(), array.data() + array.size(), std::back_inserter(result),
                 [](auto value) { return static_cast<T>(value); });
  return result;
}

/// asterism._Rules: embedding.py has checked what it gives.
DrawingRules rules_of(const Numbers& sizes, const Integers& orders, const Numbers& gaps, const Numbers& fixed,
                      const Integers& aligned, const Integers& groups) {
  DrawingRules rules;
  const auto rows = orders.unchecked<2>();  // before, after, axis
  const auto least = gaps.unchecked<1>();
  if (rows.shape(1) != 3 || rows.shape(0) != least.shape(0)) throw py::value_error("a gap for each order");
  for (py::ssize_t k = 0; k < rows.shape(0); ++k)
    rules.separations.push_back(
        {static_cast<int>(rows(k, 0)), static_cast<int>(rows(k, 1)), static_cast<int>(rows(k, 2)), least(k)});
  rules.sizes = values_of<double>(sizes);
  rules.fixed = values_of<double>(fixed);
  rules.aligned = values_of<int>(aligned);
  rules.groups = values_of<int>(groups);
  return rules;
}

}  // namespace

void bind_graph(py::module_& m) {
  py::class_<DrawingRules> of_drawings(m, "_Rules");
  def_reduce(of_drawings);
  of_drawings.def(py::init(&rules_of), py::arg("sizes"), py::arg("orders"), py::arg("gaps"), py::arg("fixed"),
                  py::arg("aligned"), py::arg("groups"));
  m.def(
      "_apply_rules",  // (N, dim) and the summary
      [](const Numbers& start, const DrawingRules& rules) {
        const auto dim = static_cast<int>(start.shape(1));
        std::vector<double> x(start.data(), start.data() + start.size());
        RuleOptions options;
        const Summary summary = interruptible([&](const std::atomic<bool>& stop) {
          options.stop = &stop;
          return apply_rules(dim, x, rules, options);
        });
        return py::make_tuple(py::array_t<double>(Shape{start.shape(0), start.shape(1)}, x.data()), summary);
      },
      py::arg("x"), py::arg("rules"));
  py::class_<SearchedGraph> graph(m, "_Graph");
  def_reduce(graph);
  graph
      .def(py::init<int, const Integers&, const Numbers&>(), py::arg("nodes"), py::arg("ends"),
           py::arg("lengths"))
      .def("components",
           [](const SearchedGraph& self) {
             const std::vector<int> of = self.graph().components();
             return py::array_t<int>(static_cast<py::ssize_t>(of.size()), of.data());
           })
      .def(
          "distances",  // (C, S, T), for each row of sources (C, S) to that of targets (C, T)
          [](SearchedGraph& self, const Integers& sources, const Integers& targets) {
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
          [](SearchedGraph& self, int count, std::uint64_t seed) {
            const Exclusive exclusive(self.busy, "this graph");
            Pairs found;
            asterism::detail::SplitMix64 random(seed);
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
              for (const int j : self.graph().neighbours(i)) {
                int& by = last[at(j)];
                if (j > i && by != i) add(j, 1);
                by = i;
              }
              const double share = static_cast<double>(others) / (2.0 * count);
              for (int k = 0; k < count; ++k) {
                const int j = self.reached()[1 + random.below(others)];
                if (last[static_cast<std::size_t>(j)] != i) add(j, share);
              }
            });
            return found.arrays();
          },
          py::arg("count"), py::arg("seed"))
      .def(
          "pairs",  // (L, 2) and (L,): all pairs i < j that a path joins, and the lengths of the shortest
                    // ones
          [](SearchedGraph& self, py::ssize_t count) {
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
          [](SearchedGraph& self, const py::array_t<double>& x, double power) {
            const Exclusive exclusive(self.busy, "this graph");
            return x.shape(1) == 3 ? stress_sums<3>(self, map_points<3>(x), power)
                                   : stress_sums<2>(self, map_points<2>(x), power);
          },
          py::arg("x"), py::arg("power"))
      .def(
          "pivot_start",  // (N, dim): where draw may start
          [](const SearchedGraph& self, int dim) {
            const std::vector<double> x = interruptible(
                [&](const std::atomic<bool>& stop) { return pivot_start(self.graph(), dim, &stop); });
            return py::array_t<double>(Shape{self.nodes(), dim}, x.data());
          },
          py::arg("dim"))
      .def(
          "draw",  // (N, dim) and the summary, of draw_graph
          [](const SearchedGraph& self, const Numbers& start, const Numbers& positions,
             const Numbers& weights, double power, std::uint64_t seed, int iterations, int threads,
             bool is_refining, const DrawingRules& rules) {
            const auto dim = static_cast<int>(start.shape(1));
            if (start.shape(0) != self.nodes() || dim < 2 || dim > 3 || positions.size() != start.size() ||
                weights.size() != self.nodes())
              throw py::value_error("a row and a weight for each node");
            std::vector<double> x(start.data(), start.data() + start.size());
            const DrawingAnchors anchors{{positions.data(), x.size()}, {weights.data(), at(self.nodes())}};
            DrawingOptions options{power, iterations, seed, threads, is_refining, nullptr};
            const Summary summary = interruptible([&](const std::atomic<bool>& stop) {
              options.stop = &stop;
              return draw_graph(self.graph(), dim, x, anchors, options, rules);
            });
            return py::make_tuple(py::array_t<double>(Shape{self.nodes(), dim}, x.data()), summary);
          },
          py::arg("start"), py::arg("anchors"), py::arg("anchor_weights"), py::arg("power"), py::arg("seed"),
          py::arg("iterations"), py::arg("threads"), py::arg("is_refining"),
          py::arg("rules") = DrawingRules());
}

}  // namespace asterism::python
