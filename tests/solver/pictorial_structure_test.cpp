// Pictorial structures against all placements.
#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/solver/discrete/loopy_structure.hpp>
#include <asterism/solver/discrete/m_best_placements.hpp>
#include <asterism/solver/discrete/part_tree.hpp>
#include <asterism/solver/discrete/pictorial_structure.hpp>
#include <asterism/solver/discrete/scaled_structure.hpp>
#include <asterism/testing/random_system.hpp>
#include <atomic>
#include <cmath>
#include <limits>
#include <span>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "map_problem.hpp"

namespace asterism {
namespace {

constexpr float kForbidden = std::numeric_limits<float>::infinity();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct Problem : testing::MapProblem {
  int root = 0;
};

AxisCost random_cost(testing::Rng& rng) {
  AxisCost cost = AxisCost::quadratic(std::pow(10, rng.uniform(-3, 0.5)), rng.uniform(-3, 3));
  if (rng.uniform(0, 1) < 0.3) cost.shape = CostShape::Absolute;
  if (rng.uniform(0, 1) < 0.3) cost.truncation = rng.uniform(0.1, 2);
  return cost;
}

// Every third one is that of a length.
DisplacementCost random_costs(testing::Rng& rng) {
  DisplacementCost cost;
  cost.x = random_cost(rng);
  cost.y = random_cost(rng);
  if (rng.uniform(0, 1) < 0.3) {
    cost = DisplacementCost::spring(rng.uniform(0.1, 1), rng.uniform(0, 3), rng.uniform(-2, 2),
                                    rng.uniform(-2, 2), static_cast<int>(rng.uniform(1, 5)));
  }
  return cost;
}

// A random tree whose parts have random numbers, so that parents need not come before children.
Problem random_problem(testing::Rng& rng, int parts, int most, double forbidden) {
  Problem problem;
  const auto below = [&rng](int n) { return std::min(n - 1, static_cast<int>(rng.uniform(0, n))); };
  std::vector<int> name(static_cast<std::size_t>(parts));
  for (int i = 0; i < parts; ++i) name[static_cast<std::size_t>(i)] = i;
  for (int i = parts - 1; i > 0; --i) {
    std::swap(name[static_cast<std::size_t>(i)], name[static_cast<std::size_t>(below(i + 1))]);
  }
  problem.root = name[0];
  for (int i = 1; i < parts; ++i) {
    Joint joint;
    joint.parent = name[static_cast<std::size_t>(below(i))];
    joint.child = name[static_cast<std::size_t>(i)];
    joint.cost = random_costs(rng);
    problem.joints.insert(problem.joints.begin() + below(i), joint);
  }
  for (int i = 0; i < parts; ++i) {
    const int width = 1 + below(most), height = 1 + below(most), gap = below(3);
    auto& numbers = problem.numbers.emplace_back(static_cast<std::size_t>((width + gap) * height), -100.0F);
    MapView<float> map(numbers.data(), width, height, width + gap);
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        map(x, y) = rng.uniform(0, 1) < forbidden ? kForbidden : static_cast<float>(rng.uniform(-1, 1));
      }
    }
    problem.maps.push_back(map);
  }
  return problem;
}

// The least energy for each position of each part, over all placements.
std::vector<std::vector<double>> brute_force(const Problem& problem) {
  const auto parts = static_cast<int>(problem.maps.size());
  std::vector<std::vector<double>> least;
  for (const auto& map : problem.maps) {
    least.emplace_back(static_cast<std::size_t>(map.width * map.height), kInfinity);
  }
  std::vector<int> place(problem.maps.size());
  Eigen::Matrix2Xi x = Eigen::Matrix2Xi::Zero(2, parts);
  while (true) {
    const double energy = problem.energy(x);
    for (std::size_t i = 0; i < place.size(); ++i) {
      double& known = least[i][static_cast<std::size_t>(place[i])];
      known = std::min(known, energy);
    }
    std::size_t i = 0;
    for (; i < place.size(); ++i) {
      const auto& map = problem.maps[i];
      place[i] = (place[i] + 1) % (map.width * map.height);
      x.col(static_cast<int>(i)) << place[i] % map.width, place[i] / map.width;
      if (place[i] != 0) break;
    }
    if (i == place.size()) return least;
  }
}

TEST(PictorialStructure, HasTheLeastEnergyOfAllPlacements) {
  testing::Rng rng(1);
  PictorialStructure structure;
  PartPlacement best;
  for (int trial = 0; trial < 2000; ++trial) {
    const int parts = 1 + trial % 5;
    const int most = parts <= 2 ? 9 : parts == 3 ? 5 : parts == 4 ? 4 : 3;
    const double forbidden = trial % 3 == 0 ? rng.uniform(0, 0.9) : 0;
    const Problem problem = random_problem(rng, parts, most, forbidden);
    const auto least = brute_force(problem);
    const double lowest = *std::min_element(least[0].begin(), least[0].end());
    const PictorialSummary summary = structure.solve(problem.joints, problem.maps, best);
    if (std::isinf(lowest)) {
      EXPECT_EQ(summary.status, Status::InvalidInput);
      EXPECT_EQ(summary.message, "maps forbid every placement");
      EXPECT_EQ(structure.root(), -1);
      continue;
    }
    ASSERT_TRUE(summary.usable()) << summary;
    ASSERT_EQ(structure.root(), problem.root);
    ASSERT_NEAR(summary.energy, lowest, 1e-5);
    EXPECT_EQ(summary.energy, best.energy);
    ASSERT_NEAR(problem.energy(best.positions), best.energy, 1e-12 * (1 + std::abs(best.energy)));

    for (int i = 0; i < parts; ++i) {
      const auto& map = problem.maps[static_cast<std::size_t>(i)];
      std::vector<float> marginals(static_cast<std::size_t>(map.width * map.height));
      ASSERT_TRUE(structure.min_marginals(i, {marginals.data(), map.width, map.height}).empty());
      for (std::size_t k = 0; k < marginals.size(); ++k) {
        const double wanted = least[static_cast<std::size_t>(i)][k];
        if (std::isinf(wanted)) {
          EXPECT_EQ(marginals[k], kForbidden);
        } else {
          ASSERT_NEAR(marginals[k], wanted, 1e-6 * (10 + std::abs(wanted)))
              << "part " << i << " of " << parts << ", pixel " << k;
        }
      }
    }
  }
}

TEST(PictorialStructure, FurtherPlacementsAreTheBestWithOtherRoots) {
  testing::Rng rng(2);
  PictorialStructure structure;
  PartPlacement best;
  std::vector<PartPlacement> placements;
  for (int trial = 0; trial < 600; ++trial) {
    const Problem problem = random_problem(rng, 3, 6, trial % 4 == 0 ? 0.4 : 0);
    if (!structure.solve(problem.joints, problem.maps, best).usable()) continue;
    auto least = brute_force(problem)[static_cast<std::size_t>(problem.root)];
    const auto& map = problem.maps[static_cast<std::size_t>(problem.root)];
    const double distance = rng.uniform(0, 3);
    const int found = structure.best_placements(100, distance, placements);
    EXPECT_EQ(placements[0].positions, best.positions);
    for (int k = 0; k < found; ++k) {
      const PartPlacement& one = placements[static_cast<std::size_t>(k)];
      EXPECT_NEAR(problem.energy(one.positions), one.energy, 1e-9);
      ASSERT_NEAR(one.energy, *std::min_element(least.begin(), least.end()), 1e-5) << "placement " << k;
      const Eigen::Vector2i at = one.positions.col(problem.root);
      for (int y = 0; y < map.height; ++y) {
        for (int x = 0; x < map.width; ++x) {
          if (std::hypot(x - at.x(), y - at.y()) <= distance)
            least[static_cast<std::size_t>(y * map.width + x)] = kInfinity;
        }
      }
    }
    EXPECT_EQ(*std::min_element(least.begin(), least.end()), kInfinity) << "all were asked for";
    EXPECT_EQ(structure.best_placements(2, distance, placements), std::min(2, found));
  }
  EXPECT_EQ(structure.best_placements(0, 1, placements), 0);
  EXPECT_EQ(structure.best_placements(3, -1, placements), 0);
  EXPECT_EQ(PictorialStructure().best_placements(3, 1, placements), 0);
}

// All placements with their energies, the least first; none that is forbidden.
std::vector<std::pair<double, Eigen::Matrix2Xi>> all_placements(const Problem& problem) {
  std::vector<std::pair<double, Eigen::Matrix2Xi>> all;
  std::vector<int> place(problem.maps.size());
  Eigen::Matrix2Xi x = Eigen::Matrix2Xi::Zero(2, static_cast<int>(place.size()));
  while (true) {
    const double energy = problem.energy(x);
    if (energy < kInfinity) all.emplace_back(energy, x);
    std::size_t i = 0;
    for (; i < place.size(); ++i) {
      const auto& map = problem.maps[i];
      place[i] = (place[i] + 1) % (map.width * map.height);
      x.col(static_cast<int>(i)) << place[i] % map.width, place[i] / map.width;
      if (place[i] != 0) break;
    }
    if (i == place.size()) break;
  }
  std::sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  return all;
}

TEST(MBestPlacements, AreTheBestThatDifferByADistance) {
  testing::Rng rng(6);
  MBestPlacements search;
  std::vector<PartPlacement> placements;
  constexpr int kCount = 12;
  int several = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const int parts = 1 + trial % 4;
    const Problem problem = random_problem(rng, parts,
                                           parts < 3    ? 6
                                           : parts == 3 ? 4
                                                        : 3,
                                           trial % 4 == 0 ? 0.4 : 0);
    const double distance = trial % 3 == 0 ? 0 : rng.uniform(0.5, 3);
    auto left = all_placements(problem);
    const PictorialSummary summary = search.solve(problem.joints, problem.maps, kCount, distance, placements);
    if (left.empty()) {
      EXPECT_EQ(summary.status, Status::InvalidInput);
      EXPECT_EQ(search.found(), 0);
      continue;
    }
    ASSERT_TRUE(summary.usable()) << summary;
    EXPECT_NEAR(summary.energy, left.front().first, 1e-5);
    for (int k = 0; k < search.found(); ++k) {
      const PartPlacement& one = placements[static_cast<std::size_t>(k)];
      EXPECT_NEAR(problem.energy(one.positions), one.energy, 1e-9);
      ASSERT_FALSE(left.empty());
      ASSERT_NEAR(one.energy, left.front().first, 1e-5)
          << "placement " << k << " of " << parts << " parts, distance " << distance;
      std::erase_if(left, [&](const auto& other) {
        return (other.second - one.positions).template cast<double>().colwise().norm().maxCoeff() <= distance;
      });
    }
    several += search.found() > 3 && distance > 0;
    EXPECT_TRUE(search.found() == kCount || left.empty()) << search.found();
  }
  EXPECT_GT(several, 50);
  const Problem problem = random_problem(rng, 2, 4, 0);
  EXPECT_EQ(search.solve(problem.joints, problem.maps, 0, 1, placements).message, "count 0 is below 1");
  EXPECT_EQ(search.solve(problem.joints, problem.maps, 2, -1, placements).message,
            "distance is negative or NaN");
  EXPECT_EQ(search.solve({}, problem.maps, 2, 1, placements).message,
            "joints are not one fewer than maps: no tree of all");
  EXPECT_EQ(search.found(), 0);
}

Problem large_star(testing::Rng& rng, int parts, int width, int height) {
  Problem problem;
  for (int i = 0; i < parts; ++i) {
    auto& numbers = problem.numbers.emplace_back();
    for (int k = 0; k < width * height; ++k) numbers.push_back(static_cast<float>(rng.uniform(0, 1)));
    problem.maps.emplace_back(numbers.data(), width, height);
    if (i > 0) {
      problem.joints.push_back(
          {0, i, {AxisCost::quadratic(0.02, 9 * i), AxisCost::quadratic(0.05, 12 - 7 * i)}});
    }
  }
  return problem;
}

TEST(PictorialStructure, EnergyIsNoLowerThanThatOfTheChildrenOnTheirOwn) {
  testing::Rng rng(3);
  const Problem problem = large_star(rng, 5, 70, 51);
  PartPlacement best;
  PictorialStructure structure;
  ASSERT_TRUE(structure.solve(problem.joints, problem.maps, best).usable());
  double bound = 0;
  for (const auto& numbers : problem.numbers) bound += *std::min_element(numbers.begin(), numbers.end());
  EXPECT_GE(best.energy, bound);
  // No part can be moved alone to a better place.
  for (int i = 0; i < 5; ++i) {
    for (int y = 0; y < 51; ++y) {
      for (int x = 0; x < 70; ++x) {
        Eigen::Matrix2Xi moved = best.positions;
        moved.col(i) << x, y;
        ASSERT_GE(problem.energy(moved), best.energy - 1e-5);
      }
    }
  }
  // All marginals have the same least number.
  for (int i = 0; i < 5; ++i) {
    std::vector<float> marginals(70 * 51);
    ASSERT_TRUE(structure.min_marginals(i, {marginals.data(), 70, 51}).empty());
    EXPECT_NEAR(*std::min_element(marginals.begin(), marginals.end()), best.energy, 1e-5);
  }
  const PictorialResult result = pictorial_structure(problem.joints, problem.maps);
  EXPECT_EQ(result.best.positions, best.positions);
  EXPECT_EQ(result.root, 0);
  EXPECT_NEAR(result.min_marginals(best.positions(1, 0), best.positions(0, 0)), best.energy, 1e-5);
}

TEST(PictorialStructure, MovesWithItsMaps) {
  testing::Rng rng(4);
  Problem problem = large_star(rng, 3, 40, 40);
  PartPlacement best, moved;
  PictorialStructure structure;
  ASSERT_TRUE(structure.solve(problem.joints, problem.maps, best).usable());
  // The map of part 2 begins at (5, 3) of the others.
  problem.maps[2] = MapView<const float>(problem.numbers[2].data() + 5 + 3 * 40, 35, 37, 40);
  problem.joints[1].cost.x.offset -= 5;
  problem.joints[1].cost.y.offset -= 3;
  ASSERT_TRUE(structure.solve(problem.joints, problem.maps, moved).usable());
  ASSERT_TRUE(best.positions(0, 2) >= 5 && best.positions(1, 2) >= 3)
      << "the best place is in the part's map";
  moved.positions.col(2) += Eigen::Vector2i(5, 3);
  EXPECT_EQ(moved.positions, best.positions);
  EXPECT_NEAR(moved.energy, best.energy, 1e-9);
}

// Every solver of the discrete room, with a flag that is set: no result, and `best` as it was.
TEST(PictorialStructure, StopsOnRequest) {
  testing::Rng rng(8);
  const Problem problem = random_problem(rng, 4, 6, 0);
  std::atomic<bool> stop{true};
  const auto expect_stopped = [](const auto& summary, const PartPlacement& best) {
    EXPECT_EQ(summary.status, Status::Interrupted);
    EXPECT_EQ(summary.message, "stopped on request");
    EXPECT_FALSE(summary.usable());
    EXPECT_EQ(best.energy, 17);
  };
  PartPlacement best;
  best.energy = 17;
  PictorialStructure tree;
  tree.stop = &stop;
  expect_stopped(tree.solve(problem.joints, problem.maps, best), best);
  LoopyStructure graph;
  graph.options.stop = &stop;
  expect_stopped(graph.solve(problem.joints, problem.maps, best), best);
  ScaledPlacement best_in_layers;
  best_in_layers.energy = 17;
  std::vector<ScaledJoint> joints;
  for (const Joint& joint : problem.joints) joints.push_back({joint, {}});
  const std::vector<double> scales{1};
  ScaledStructure layers;
  layers.stop = &stop;
  expect_stopped(layers.solve(joints, scales, problem.maps, best_in_layers), best_in_layers);

  // In the midst of further placements.
  std::vector<PartPlacement> placements;
  stop = false;
  ASSERT_TRUE(tree.solve(problem.joints, problem.maps, best).usable());
  stop = true;
  EXPECT_EQ(tree.best_placements(5, 0, placements), 0);
  MBestPlacements several;
  several.stop = &stop;
  EXPECT_EQ(several.solve(problem.joints, problem.maps, 5, 0, placements).status, Status::Interrupted);
  EXPECT_EQ(several.found(), 0);
}

// A chain, a star, and a chain from its end: in linear time, as a quadratic one would take an hour.
TEST(PictorialStructure, PlansTreesOfAMillionParts) {
  constexpr int kParts = 1000000;
  detail::PartTree tree;
  for (const int shape : {0, 1, 2}) {
    std::vector<Joint> joints(kParts - 1);
    for (int k = 0; k < kParts - 1; ++k) {
      Joint& joint = joints[static_cast<std::size_t>(k)];
      joint.parent = shape == 0 ? k : shape == 1 ? 0 : kParts - 1 - k;
      joint.child = shape == 2 ? kParts - 2 - k : k + 1;
    }
    const std::span<const Joint> given(joints);
    ASSERT_FALSE(tree.plan(given, kParts));
    int wrong = 0;
    for (int k = 0; k < kParts; ++k) {
      wrong += tree.order[static_cast<std::size_t>(k)] != (shape == 2 ? kParts - 1 - k : k);
    }
    EXPECT_EQ(wrong, 0);
    joints.back().parent = joints.back().child;  // as if it were a cycle of one
    EXPECT_EQ(tree.plan(std::span<const Joint>(joints), kParts).index, kParts - 2);
  }
}

TEST(PictorialStructure, RefusesBadInputByName) {
  testing::Rng rng(5);
  const Problem good = large_star(rng, 4, 6, 5);
  PictorialStructure structure;
  PartPlacement best;
  best.energy = 17;
  const auto expect = [&](const Problem& problem, const std::string& message) {
    const PictorialSummary summary = structure.solve(problem.joints, problem.maps, best);
    EXPECT_EQ(summary.status, Status::InvalidInput);
    EXPECT_EQ(summary.message, message);
    EXPECT_EQ(best.energy, 17);
    EXPECT_EQ(structure.root(), -1);
    std::vector<float> marginals(30);
    EXPECT_EQ(structure.min_marginals(0, {marginals.data(), 6, 5}), "there is no solution");
    std::ostringstream text;
    text << summary;
    EXPECT_EQ(text.str(), "invalid input: " + message);
    EXPECT_EQ(pictorial_structure(problem.joints, problem.maps).message, message);
  };
  Problem bad = good;
  bad.maps.clear();
  expect(bad, "maps are none");
  bad = good;
  bad.maps[2].width = 0;
  expect(bad, "map 2 is empty");
  bad = good;
  std::vector<float> numbers(30, std::numeric_limits<float>::quiet_NaN());
  bad.maps[3].data = numbers.data();
  expect(bad, "map 3 has a number that is NaN or minus infinity");
  bad = good;
  bad.joints.pop_back();
  expect(bad, "joints are not one fewer than maps: no tree of all");
  bad = good;
  bad.joints[1].child = 4;
  expect(bad, "joint 1 has an end that is out of range");
  bad = good;
  bad.joints[1].parent = -1;
  expect(bad, "joint 1 has an end that is out of range");
  bad = good;
  bad.joints[0].parent = 1;
  expect(bad, "joint 0 joins a part to itself");
  bad = good;
  bad.joints[2].child = 1;
  expect(bad, "joint 2 gives its child a second parent");
  bad = good;
  bad.joints[1].parent = 3;
  bad.joints[2].parent = 2;
  expect(bad, "joint 1 is part of a cycle or hangs on one");
  bad = good;
  bad.joints[2].cost.y.weight = kInfinity;
  expect(bad, "joint 2 has a weight that is negative or not finite");

  ASSERT_TRUE(structure.solve(good.joints, good.maps, best).usable());
  std::vector<float> marginals(30);
  EXPECT_EQ(structure.min_marginals(4, {marginals.data(), 6, 5}), "part 4 is out of range");
  EXPECT_EQ(structure.min_marginals(1, {marginals.data(), 5, 5}),
            "result is not of the size of the part's map");
}

}  // namespace
}  // namespace asterism
