// Graphs, their drawings, rules and the places of new points, as a C++ program calls them.

#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/solver/graph/drawing.hpp>
#include <asterism/solver/graph/graph.hpp>
#include <asterism/solver/graph/placement.hpp>
#include <asterism/solver/graph/rules.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/testing/random_system.hpp>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <limits>
#include <stdexcept>
#include <vector>

namespace asterism {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

Graph random_graph(testing::Rng& rng, int nodes, int edges, bool uniform) {
  std::vector<Graph::Edge> list;
  for (int e = 0; e < edges; ++e) {
    const auto end = [&] { return std::min(nodes - 1, static_cast<int>(rng.uniform(0, nodes))); };
    list.push_back({end(), end(), uniform ? 2.5 : rng.uniform(0, 3)});
  }
  return {nodes, list};
}

// All distances, by Floyd and Warshall.
Eigen::MatrixXd distances(const Graph& graph) {
  const int n = graph.nodes();
  Eigen::MatrixXd d = Eigen::MatrixXd::Constant(n, n, kInfinity);
  for (int i = 0; i < n; ++i) {
    d(i, i) = 0;
    for (std::size_t k = 0; k < graph.neighbours(i).size(); ++k) {
      double& entry = d(i, graph.neighbours(i)[k]);
      entry = std::min(entry, graph.is_uniform() ? graph.unit() : graph.lengths(i)[k]);
    }
  }
  for (int k = 0; k < n; ++k) {
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j < n; ++j) d(i, j) = std::min(d(i, j), d(i, k) + d(k, j));
    }
  }
  return d;
}

TEST(ShortestPaths, AreThoseOfFloydAndWarshall) {
  testing::Rng rng(1);
  for (int round = 0; round < 40; ++round) {
    const Graph graph = random_graph(rng, 30, 20 + round, round % 2 == 0);
    const Eigen::MatrixXd expected = distances(graph);
    const std::vector<int> components = graph.components();
    ShortestPaths paths(graph);
    for (int source = 0; source < graph.nodes(); ++source) {
      paths.find(source);
      ASSERT_EQ(paths.nodes()[0], source);
      EXPECT_EQ(static_cast<Eigen::Index>(paths.nodes().size()),
                (expected.col(source).array() < kInfinity).count());
      EXPECT_TRUE(std::is_sorted(paths.lengths().begin(), paths.lengths().end()));
      for (std::size_t k = 0; k < paths.nodes().size(); ++k) {
        const int node = paths.nodes()[k];
        EXPECT_NEAR(paths.lengths()[k], expected(node, source), 1e-12);
        EXPECT_EQ(components[static_cast<std::size_t>(node)], components[static_cast<std::size_t>(source)]);
      }
      const std::vector<double> all(paths.lengths().begin(), paths.lengths().end());
      paths.find(source, 5);
      ASSERT_EQ(paths.nodes().size(), std::min<std::size_t>(5, all.size()));
      for (std::size_t k = 0; k < paths.nodes().size(); ++k) EXPECT_EQ(paths.lengths()[k], all[k]);
    }
  }
}

TEST(Graph, RefusesEdgesThatAreNone) {
  const auto make = [](Graph::Edge edge) { return Graph(3, std::vector{edge}); };
  EXPECT_THROW(make({0, 3, 1}), std::invalid_argument);
  EXPECT_THROW(make({-1, 1, 1}), std::invalid_argument);
  EXPECT_THROW(make({0, 1, -1}), std::invalid_argument);
  EXPECT_THROW(make({0, 1, kInfinity}), std::invalid_argument);
  EXPECT_THROW(make({0, 1, std::nan("")}), std::invalid_argument);
  EXPECT_EQ(Graph(0, {}).nodes(), 0);
}

double stress(const Eigen::MatrixXd& d, const std::vector<double>& x) {
  const Eigen::Map<const Eigen::Matrix2Xd> at(x.data(), 2, d.rows());
  double sum = 0;
  for (Eigen::Index i = 0; i < d.rows(); ++i) {
    for (Eigen::Index j = 0; j < i; ++j) sum += std::pow(1 - (at.col(i) - at.col(j)).norm() / d(i, j), 2);
  }
  return sum;
}

Graph grid(int side) {
  std::vector<Graph::Edge> edges;
  for (int i = 0; i < side * side; ++i) {
    if (i % side + 1 < side) edges.push_back({i, i + 1, 1});
    if (i + side < side * side) edges.push_back({i, i + side, 1});
  }
  return {side * side, edges};
}

TEST(DrawGraph, LowersTheStressOfAllPairs) {
  const Graph graph = grid(12);
  const Eigen::MatrixXd d = distances(graph);
  const std::vector<double> start = pivot_start(graph, 2);
  DrawingOptions options;
  options.threads = 1;
  std::vector<double> x = start;
  const Summary summary = draw_graph(graph, 2, x, {}, options);
  EXPECT_EQ(summary.status, Status::MaxIterations);
  EXPECT_LT(summary.final_energy, summary.initial_energy);
  EXPECT_LT(stress(d, x), 0.9 * stress(d, start));
  // A minimum: along its gradient by finite differences, the stress hardly falls.
  std::vector<double> moved = x;
  for (std::size_t k = 0; k < x.size(); ++k) {
    std::vector<double> up = x, down = x;
    up[k] += 1e-5, down[k] -= 1e-5;
    const double g = (stress(d, up) - stress(d, down)) / 2e-5;
    moved[k] -= 1e-2 * g;
  }
  EXPECT_GT(stress(d, moved), 0.97 * stress(d, x));
  options.threads = 2;
  std::vector<double> y = start;
  draw_graph(graph, 2, y, {}, options);
  EXPECT_EQ(x, y);
}

TEST(DrawGraph, HoldsNodesAndStops) {
  const Graph graph = grid(5);
  const std::vector<double> start = pivot_start(graph, 2);
  std::vector<double> positions(50, 0), weights(25, 0), x = start;
  positions[0] = 40, positions[1] = 7, weights[0] = kInfinity;
  draw_graph(graph, 2, x, {positions, weights}, {});
  EXPECT_EQ(x[0], 40);
  EXPECT_EQ(x[1], 7);
  EXPECT_NEAR(std::hypot(x[2] - 40, x[3] - 7), 1, 0.3);  // its neighbour came along
  positions.pop_back();
  EXPECT_EQ(draw_graph(graph, 2, x, {positions, weights}, {}).status, Status::InvalidInput);
  EXPECT_EQ(draw_graph(graph, 3, x, {}, {}).status, Status::InvalidInput);
  const std::atomic<bool> stop = true;
  DrawingOptions options;
  options.stop = &stop;
  EXPECT_EQ(draw_graph(graph, 2, x, {}, options).status, Status::Interrupted);
}

TEST(DrawGraph, RefusesWhatIsNotFinite) {
  const Graph graph = grid(3);
  const std::vector<double> start = pivot_start(graph, 2);
  const std::vector<double> at(18, 0), by(9, 1);
  std::vector<double> x = start, positions = at, weights = by;
  const auto expect = [&](const char* message) {
    const std::vector<double> before = x;
    const Summary summary = draw_graph(graph, 2, x, {positions, weights}, {});
    EXPECT_EQ(summary.status, Status::InvalidInput);
    EXPECT_EQ(summary.message, message);
    EXPECT_TRUE(std::equal(x.begin(), x.end(), before.begin(),
                           [](double a, double b) { return a == b || (std::isnan(a) && std::isnan(b)); }));
  };
  for (const double bad : {kInfinity, std::nan("")}) {
    x[4] = bad;
    expect("x must be finite");
    x = start;
    positions[17] = bad;
    expect("anchors must be finite");
    weights[8] = 0;  // of no anchor
    EXPECT_TRUE(draw_graph(graph, 2, x, {positions, weights}, {}).usable());
    positions = at, weights = by, x = start;
  }
  for (const double bad : {-1.0, std::nan("")}) {
    weights = by;
    weights[3] = bad;
    expect("the weights of anchors must be at least 0");
  }
}

TEST(ApplyRules, RefusesHalfAPoint) {
  std::vector<double> x = {0, 0, 1, 0, 2};
  const Summary summary = apply_rules(2, x, {});
  EXPECT_EQ(summary.status, Status::InvalidInput);
  EXPECT_EQ(summary.message, "expected dim coordinates for each point");
}

TEST(ApplyRules, KeepsBoxesApartAndNodesInOrder) {
  testing::Rng rng(3);
  constexpr int kNodes = 60;
  DrawingRules rules;
  std::vector<double> x;
  for (int i = 0; i < kNodes; ++i) {
    for (const double most : {3.0, 1.0}) {
      rules.sizes.push_back(rng.uniform(0.2, most));
      x.push_back(rng.uniform(0, 8));
    }
  }
  rules.separations = {{0, 1, 0, 5}, {1, 2, 1, 2}};
  ASSERT_EQ(apply_rules(2, x, rules).status, Status::Converged);
  const auto at = [](const std::vector<double>& values, int i, int axis) {
    return values[static_cast<std::size_t>(2 * i + axis)];
  };
  for (int i = 0; i < kNodes; ++i) {
    for (int j = 0; j < i; ++j) {
      const auto apart = [&](int axis) {
        return std::abs(at(x, i, axis) - at(x, j, axis)) -
               (at(rules.sizes, i, axis) + at(rules.sizes, j, axis)) / 2;
      };
      EXPECT_GE(std::max(apart(0), apart(1)), -1e-9) << i << ' ' << j;
    }
  }
  EXPECT_GE(at(x, 1, 0) - at(x, 0, 0), 5 - 1e-9);
  EXPECT_GE(at(x, 2, 1) - at(x, 1, 1), 2 - 1e-9);

  const std::vector<double> before = x;
  rules.separations = {{0, 1, 0, 5}, {1, 0, 0, 5}};  // each right of the other
  const Summary refused = apply_rules(2, x, rules);
  EXPECT_EQ(refused.status, Status::InvalidInput);
  EXPECT_FALSE(refused.message.empty());
  EXPECT_EQ(x, before);
}

TEST(PlacePoints, AreWhereTheStressIsLeast) {
  testing::Rng rng(4);
  for (const int dim : {1, 2, 3, 5}) {
    const auto draw = [&](int columns) {
      Eigen::MatrixXd m(dim, columns);
      for (double& value : m.reshaped()) value = rng.uniform(-5, 5);
      return m;
    };
    constexpr int kHeld = 20, kNew = 30;
    const Eigen::MatrixXd held = draw(kHeld), true_places = draw(kNew);
    Eigen::MatrixXd distances(kHeld, kNew), weights(kHeld, 1);
    for (int m = 0; m < kNew; ++m) {
      for (int k = 0; k < kHeld; ++k)
        distances(k, m) = (true_places.col(m) - held.col(k)).norm() * rng.uniform(0.95, 1.05);
    }
    for (double& w : weights.reshaped()) w = rng.uniform(0.5, 2);
    distances(3, 5) = std::nan("");
    distances.col(7).setConstant(std::nan(""));
    const Eigen::MatrixXd places = place_points(held, distances, weights);
    const auto stress = [&](int m, const Eigen::VectorXd& x) {
      double sum = 0;
      for (int k = 0; k < kHeld; ++k) {
        if (distances(k, m) >= 0) sum += weights(k) * std::pow(distances(k, m) - (x - held.col(k)).norm(), 2);
      }
      return sum;
    };
    for (int m = 0; m < kNew; ++m) {
      SCOPED_TRACE(::testing::Message() << dim << ' ' << m);
      if (m == 7) {
        EXPECT_TRUE(places.col(m).array().isNaN().all());
        continue;
      }
      EXPECT_LE(stress(m, places.col(m)), stress(m, true_places.col(m)));
      for (int c = 0; c < dim; ++c) {
        const Eigen::VectorXd step = 1e-5 * Eigen::VectorXd::Unit(dim, c);
        EXPECT_NEAR((stress(m, places.col(m) + step) - stress(m, places.col(m) - step)) / 2e-5, 0, 1e-4);
      }
    }
    const Eigen::MatrixXd no_starts;
    PlacementOptions options;
    options.threads = 2;
    const Eigen::MatrixXd threaded = place_points(held, distances, weights, no_starts, options);
    EXPECT_TRUE(((places.array() == threaded.array()) || places.array().isNaN()).all());
    const std::atomic<bool> stop = true;
    options.stop = &stop;
    EXPECT_TRUE(place_points(held, distances, weights, no_starts, options).array().isNaN().all());
    EXPECT_THROW(place_points(held, distances.topRows(3), weights), std::invalid_argument);
    EXPECT_THROW(place_points(held, distances, weights.topRows(3)), std::invalid_argument);
    EXPECT_THROW(place_points(held, distances, weights, draw(3)), std::invalid_argument);
  }
}

}  // namespace
}  // namespace asterism
