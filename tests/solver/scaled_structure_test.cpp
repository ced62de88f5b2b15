// Structures with layers of scale against all placements.
#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/solver/discrete/pictorial_structure.hpp>
#include <asterism/solver/discrete/scaled_structure.hpp>
#include <asterism/testing/random_system.hpp>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

namespace asterism {
namespace {

constexpr float kForbidden = std::numeric_limits<float>::infinity();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct Problem {
  std::vector<std::vector<float>> numbers;
  std::vector<MapView<const float>> maps;
  std::vector<ScaledJoint> joints;
  std::vector<double> scales;

  int layers() const { return static_cast<int>(scales.size()); }
  const MapView<const float>& map(int part, int layer) const {
    return maps[static_cast<std::size_t>(part * layers() + layer)];
  }
  double energy(const Eigen::Matrix2Xi& x, const Eigen::VectorXi& layer) const {
    double sum = 0;
    for (int i = 0; i < layer.size(); ++i) sum += static_cast<double>(map(i, layer(i))(x(0, i), x(1, i)));
    for (const ScaledJoint& joint : joints) {
      // The displacement in units of the parent's scale.
      const Eigen::Vector2d d = (x.col(joint.child) - x.col(joint.parent)).cast<double>() /
                                scales[static_cast<std::size_t>(layer(joint.parent))];
      sum +=
          joint.cost.x(d.x()) + joint.cost.y(d.y()) + joint.layer(layer(joint.child) - layer(joint.parent));
    }
    return sum;
  }
};

AxisCost random_cost(testing::Rng& rng) {
  AxisCost cost = AxisCost::quadratic(std::pow(10, rng.uniform(-2, 0.5)), rng.uniform(-2, 2));
  if (rng.uniform(0, 1) < 0.3) cost.shape = CostShape::Absolute;
  if (rng.uniform(0, 1) < 0.3) cost.truncation = rng.uniform(0.1, 2);
  return cost;
}

Problem random_problem(testing::Rng& rng, int parts, int layers, int most, double forbidden) {
  Problem problem;
  const auto below = [&rng](int n) { return std::min(n - 1, static_cast<int>(rng.uniform(0, n))); };
  for (int l = 0; l < layers; ++l) problem.scales.push_back(rng.uniform(0.5, 2));
  for (int i = 0; i < parts; ++i) {
    const int width = 1 + below(most), height = 1 + below(most), gap = below(3);
    for (int l = 0; l < layers; ++l) {
      auto& numbers = problem.numbers.emplace_back(static_cast<std::size_t>((width + gap) * height), -100.0F);
      const MapView<float> map(numbers.data(), width, height, width + gap);
      for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
          map(x, y) = rng.uniform(0, 1) < forbidden ? kForbidden : static_cast<float>(rng.uniform(-1, 1));
        }
      }
      problem.maps.push_back(map);
    }
    if (i + 1 == parts) continue;
    // The last part is the root.
    ScaledJoint joint;
    joint.child = i;
    joint.parent = i + 1 + below(parts - 1 - i);
    joint.cost.x = random_cost(rng);
    joint.cost.y = random_cost(rng);
    joint.layer = random_cost(rng);
    problem.joints.push_back(joint);
  }
  return problem;
}

// The least energy for each position of the root in each layer.
std::vector<std::vector<double>> brute_force(const Problem& problem) {
  const int layers = problem.layers(), parts = static_cast<int>(problem.maps.size()) / layers,
            root = parts - 1;
  const MapView<const float>& of_root = problem.map(root, 0);
  std::vector<std::vector<double>> least(
      static_cast<std::size_t>(layers),
      std::vector<double>(static_cast<std::size_t>(of_root.width * of_root.height), kInfinity));
  std::vector<int> place(static_cast<std::size_t>(parts));
  Eigen::Matrix2Xi x = Eigen::Matrix2Xi::Zero(2, parts);
  Eigen::VectorXi layer = Eigen::VectorXi::Zero(parts);
  while (true) {
    double& known = least[static_cast<std::size_t>(layer(root))]
                         [static_cast<std::size_t>(x(1, root) * of_root.width + x(0, root))];
    known = std::min(known, problem.energy(x, layer));
    int i = 0;
    for (; i < parts; ++i) {
      const MapView<const float>& map = problem.map(i, 0);
      const int pixels = map.width * map.height;
      int& at = place[static_cast<std::size_t>(i)];
      at = (at + 1) % (pixels * layers);
      x.col(i) << at % pixels % map.width, at % pixels / map.width;
      layer(i) = at / pixels;
      if (at != 0) break;
    }
    if (i == parts) return least;
  }
}

double least_of(const std::vector<std::vector<double>>& layers) {
  double least = kInfinity;
  for (const auto& layer : layers) least = std::min(least, *std::min_element(layer.begin(), layer.end()));
  return least;
}

TEST(ScaledStructure, HasTheLeastEnergyOfAllPlacementsAndLayers) {
  testing::Rng rng(1);
  ScaledStructure structure;
  ScaledPlacement best;
  std::vector<ScaledPlacement> placements;
  for (int trial = 0; trial < 400; ++trial) {
    const int parts = 1 + trial % 3, layers = 1 + trial / 3 % 3;
    const Problem problem = random_problem(rng, parts, layers, parts < 3 ? 5 : 3, trial % 5 == 0 ? 0.6 : 0);
    auto least = brute_force(problem);
    const PictorialSummary summary = structure.solve(problem.joints, problem.scales, problem.maps, best);
    if (std::isinf(least_of(least))) {
      EXPECT_EQ(summary.message, "maps forbid every placement");
      EXPECT_EQ(structure.root(), -1);
      continue;
    }
    ASSERT_TRUE(summary.usable()) << summary;
    ASSERT_EQ(structure.root(), parts - 1);
    ASSERT_NEAR(summary.energy, least_of(least), 1e-5);
    EXPECT_NEAR(problem.energy(best.positions, best.layers), best.energy, 1e-9);
    for (int l = 0; l < layers; ++l) {
      const MapView<const float> marginals = structure.root_min_marginals(l);
      for (int k = 0; k < marginals.width * marginals.height; ++k) {
        const double wanted = least[static_cast<std::size_t>(l)][static_cast<std::size_t>(k)];
        const float measured = marginals(k % marginals.width, k / marginals.width);
        if (std::isinf(wanted)) {
          EXPECT_EQ(measured, kForbidden);
        } else {
          ASSERT_NEAR(measured, wanted, 1e-5);
        }
      }
    }
    const double distance = rng.uniform(0, 2);
    const int found = structure.best_placements(50, distance, placements);
    const MapView<const float>& map = problem.map(parts - 1, 0);
    for (int k = 0; k < found; ++k) {
      const ScaledPlacement& one = placements[static_cast<std::size_t>(k)];
      ASSERT_NEAR(one.energy, least_of(least), 1e-5) << k;
      EXPECT_NEAR(problem.energy(one.positions, one.layers), one.energy, 1e-9);
      for (auto& layer : least) {
        for (int p = 0; p < map.width * map.height; ++p) {
          const double dx = p % map.width - one.positions(0, parts - 1),
                       dy = p / map.width - one.positions(1, parts - 1);
          if (std::hypot(dx, dy) <= distance) layer[static_cast<std::size_t>(p)] = kInfinity;
        }
      }
    }
    EXPECT_TRUE(std::isinf(least_of(least))) << "all were asked for";
  }
  EXPECT_TRUE(structure.root_min_marginals(-1).empty());
  EXPECT_TRUE(structure.root_min_marginals(3).empty());
}

// One layer is a pictorial structure, also with lengths.
TEST(ScaledStructure, OfOneLayerIsAPictorialStructure) {
  testing::Rng rng(2);
  const Problem problem = random_problem(rng, 4, 1, 30, 0);
  std::vector<ScaledJoint> scaled;
  std::vector<Joint> joints;
  for (const ScaledJoint& given : problem.joints) {
    scaled.push_back(given);
    scaled.back().layer = {};
    scaled.back().cost = DisplacementCost::spring(0.2, 5, 3, -2, 6);
    // At scale 2, lengths are twice as large, and the weight is a quarter.
    joints.push_back({given.parent, given.child, DisplacementCost::spring(0.05, 10, 6, -4, 12)});
  }
  ScaledPlacement of_scales;
  PartPlacement plain;
  const std::vector<double> scales{2};
  const PictorialSummary summary = ScaledStructure().solve(scaled, scales, problem.maps, of_scales);
  const PictorialSummary wanted = PictorialStructure().solve(joints, problem.maps, plain);
  ASSERT_TRUE(summary.usable()) << summary;
  ASSERT_TRUE(wanted.usable()) << wanted;
  EXPECT_NEAR(of_scales.energy, plain.energy, 1e-6);
  EXPECT_EQ(of_scales.positions, plain.positions);
}

TEST(ScaledStructure, RefusesBadInputByName) {
  testing::Rng rng(3);
  const Problem good = random_problem(rng, 3, 2, 5, 0);
  ScaledStructure structure;
  ScaledPlacement best;
  best.energy = 17;
  const auto expect = [&](const Problem& problem, const std::string& message) {
    const PictorialSummary summary = structure.solve(problem.joints, problem.scales, problem.maps, best);
    EXPECT_EQ(summary.status, Status::InvalidInput);
    EXPECT_EQ(summary.message, message);
    EXPECT_EQ(best.energy, 17);
    EXPECT_EQ(structure.root(), -1);
    std::vector<ScaledPlacement> placements;
    EXPECT_EQ(structure.best_placements(1, 1, placements), 0);
  };
  Problem bad = good;
  bad.scales.clear();
  expect(bad, "scales are none");
  bad = good;
  bad.scales[1] = 0;
  expect(bad, "scale 1 is not between 1/1000 and 1000");
  bad = good;
  bad.maps.pop_back();
  expect(bad, "maps are not as many for each part as scales");
  bad = good;
  bad.maps.clear();
  expect(bad, "maps are none");
  bad = good;
  bad.maps[3].height += 1;
  bad.maps[3].row_stride = 0;
  expect(bad, "map 3 is not of the size of the part's first layer");
  bad = good;
  bad.maps[2].data = nullptr;
  expect(bad, "map 2 is empty");
  bad = good;
  bad.joints.pop_back();
  expect(bad, "joints are not one fewer than parts: no tree of all");
  bad = good;
  bad.joints[1].parent = 3;
  expect(bad, "joint 1 has an end that is out of range");
  bad = good;
  bad.joints[1].child = bad.joints[0].child;
  bad.joints[1].parent = 2;
  expect(bad, "joint 1 gives its child a second parent");
  bad = good;
  bad.joints[0].layer.weight = -1;
  expect(bad, "joint 0 has a cost of layers that is not valid");
  bad = good;
  bad.joints[0].cost.x.weight = 1e38;
  bad.scales[0] = 0.01;
  bad.joints[0].cost.x.shape = CostShape::Quadratic;
  expect(bad, "joint 0 has a cost that is out of range at one of the scales");
}

}  // namespace
}  // namespace asterism
