// Structures with cycles against all placements.
#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/solver/discrete/loopy_structure.hpp>
#include <asterism/testing/random_system.hpp>
#include <atomic>
#include <chrono>
#include <cmath>
#include <limits>
#include <thread>
#include <vector>

#include "map_problem.hpp"

namespace asterism {
namespace {

struct Problem : testing::MapProblem {
  double least_energy() const {
    double least = std::numeric_limits<double>::infinity();
    std::vector<int> place(maps.size());
    Eigen::Matrix2Xi x = Eigen::Matrix2Xi::Zero(2, static_cast<int>(maps.size()));
    while (true) {
      least = std::min(least, energy(x));
      std::size_t i = 0;
      for (; i < place.size(); ++i) {
        place[i] = (place[i] + 1) % (maps[i].width * maps[i].height);
        x.col(static_cast<int>(i)) << place[i] % maps[i].width, place[i] / maps[i].width;
        if (place[i] != 0) break;
      }
      if (i == place.size()) return least;
    }
  }
};

Problem random_problem(testing::Rng& rng, int parts, int joints, int most) {
  Problem problem;
  const auto below = [&rng](int n) { return std::min(n - 1, static_cast<int>(rng.uniform(0, n))); };
  for (int i = 0; i < parts; ++i) {
    const int width = 1 + below(most), height = 1 + below(most);
    auto& numbers = problem.numbers.emplace_back();
    for (int k = 0; k < width * height; ++k) {
      const bool is_forbidden = k > 0 && rng.uniform(0, 1) < 0.1;
      const auto number = static_cast<float>(rng.uniform(-1, 1));
      numbers.push_back(is_forbidden ? std::numeric_limits<float>::infinity() : number);
    }
    problem.maps.emplace_back(numbers.data(), width, height);
  }
  while (parts > 1 && static_cast<int>(problem.joints.size()) < joints) {
    Joint joint;
    joint.parent = below(parts);
    joint.child = below(parts);
    if (joint.parent == joint.child) continue;
    const auto cost = [&] { return AxisCost::quadratic(rng.uniform(0.01, 0.5), rng.uniform(-2, 2)); };
    joint.cost.x = cost();
    joint.cost.y = cost();
    if (rng.uniform(0, 1) < 0.3) joint.cost.x.shape = CostShape::Absolute;
    problem.joints.push_back(joint);
  }
  return problem;
}

TEST(LoopyStructure, BoundsTheLeastEnergyFromBothSides) {
  testing::Rng rng(1);
  LoopyStructure structure;
  structure.options.tolerance = 1e-4;
  PartPlacement best;
  int closed = 0;
  constexpr int kTrials = 300;
  for (int trial = 0; trial < kTrials; ++trial) {
    const int parts = 2 + trial % 3;
    const Problem problem =
        random_problem(rng, parts, static_cast<int>(rng.uniform(0, 2 * parts)), parts < 4 ? 5 : 4);
    const double least = problem.least_energy();
    const LoopySummary summary = structure.solve(problem.joints, problem.maps, best);
    ASSERT_TRUE(summary.usable()) << summary;
    ASSERT_LE(summary.lower_bound, least + 1e-5) << summary;
    ASSERT_GE(summary.energy, least - 1e-9) << summary;
    EXPECT_EQ(summary.energy, best.energy);
    EXPECT_NEAR(problem.energy(best.positions), best.energy, 1e-9);
    if (summary.status == Status::Converged) {
      ++closed;
      EXPECT_NEAR(summary.energy, least, 2e-4);
    }
  }
  EXPECT_GT(closed, kTrials / 2);
}

TEST(LoopyStructure, KeepsToTheWindowsOfLengths) {
  testing::Rng rng(4);
  LoopyStructure structure;
  PartPlacement best;
  int closed = 0, proven_impossible = 0, not_found = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const int parts = 2 + trial % 3;
    Problem problem = random_problem(rng, parts, parts + trial % 2, parts < 4 ? 5 : 4);
    for (Joint& joint : problem.joints) {
      joint.cost = DisplacementCost::spring(rng.uniform(0.05, 1), rng.uniform(0, 4), rng.uniform(-2, 2),
                                            rng.uniform(-2, 2), static_cast<int>(rng.uniform(1, 4)));
    }
    const double least = problem.least_energy();
    best.energy = 17;
    const LoopySummary summary = structure.solve(problem.joints, problem.maps, best);
    if (!summary.usable()) {
      EXPECT_EQ(best.energy, 17);
      if (summary.status == Status::InvalidInput) {
        ++proven_impossible;
        EXPECT_EQ(least, std::numeric_limits<double>::infinity()) << summary;
      } else {
        ++not_found;
        EXPECT_EQ(summary.message, "no placement was found that the windows of the lengths allow");
      }
      continue;
    }
    ASSERT_LE(summary.lower_bound, least + 1e-5) << summary;
    ASSERT_GE(summary.energy, least - 1e-9) << summary;
    EXPECT_NEAR(problem.energy(best.positions), best.energy, 1e-9);
    closed += summary.status == Status::Converged;
  }
  EXPECT_GT(closed, 150);
  EXPECT_GT(proven_impossible, 0);
  EXPECT_LT(not_found, 30);
}

TEST(LoopyStructure, OfATreeIsAsGoodAsThePictorialStructure) {
  testing::Rng rng(2);
  LoopyStructure loopy;
  PictorialStructure tree;
  PartPlacement best, wanted;
  for (int trial = 0; trial < 20; ++trial) {
    Problem problem = random_problem(rng, 5, 0, 30);
    for (int i = 1; i < 5; ++i) {
      problem.joints.push_back({i / 2, i, {AxisCost::quadratic(0.03, 3), AxisCost::quadratic(0.2, -i)}});
    }
    const LoopySummary summary = loopy.solve(problem.joints, problem.maps, best);
    ASSERT_TRUE(tree.solve(problem.joints, problem.maps, wanted).usable());
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_NEAR(summary.energy, wanted.energy, 1e-3);
    EXPECT_NEAR(summary.lower_bound, wanted.energy, 1e-3);
  }
}

TEST(LoopyStructure, LeavesThePlacementAsItWasIfItIsStopped) {
  Problem problem;  // of two places and three parts, no two of which want the same one: the bound stays below
  const std::vector<float> nothing(2, 0.0F);
  for (int i = 0; i < 3; ++i) {
    problem.maps.emplace_back(nothing.data(), 2, 1);
    problem.joints.push_back({i, (i + 1) % 3, DisplacementCost::spring(1, 1, 0, 0, 2)});
  }
  LoopyStructure structure;
  structure.options.tolerance = 0;
  structure.options.progress = 0;
  structure.options.max_iterations = std::numeric_limits<int>::max();
  std::atomic<bool> stop = false;
  structure.options.stop = &stop;
  PartPlacement best;
  best.energy = 17;
  best.positions = Eigen::Matrix2Xi::Constant(2, 3, 5);
  std::thread stopper([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    stop = true;
  });
  const LoopySummary summary = structure.solve(problem.joints, problem.maps, best);
  stopper.join();
  ASSERT_EQ(summary.status, Status::Interrupted) << summary;
  EXPECT_GT(summary.iterations, 1);
  EXPECT_EQ(best.energy, 17);
  EXPECT_EQ(best.positions, (Eigen::Matrix2Xi::Constant(2, 3, 5)));
}

TEST(LoopyStructure, RefusesBadInputByName) {
  testing::Rng rng(3);
  const Problem good = random_problem(rng, 3, 3, 5);
  LoopyStructure structure;
  PartPlacement best;
  best.energy = 17;
  const auto expect = [&](const Problem& problem, const char* message) {
    const LoopySummary summary = structure.solve(problem.joints, problem.maps, best);
    EXPECT_EQ(summary.status, Status::InvalidInput);
    EXPECT_EQ(summary.message, message);
    EXPECT_FALSE(summary.usable());
    EXPECT_EQ(best.energy, 17);
  };
  Problem bad = good;
  bad.maps.clear();
  expect(bad, "maps are none");
  bad = good;
  bad.maps[1].data = nullptr;
  expect(bad, "map 1 is empty");
  bad = good;
  const std::vector<float> forbidden(25, std::numeric_limits<float>::infinity());
  bad.maps[2].data = forbidden.data();
  expect(bad, "map 2 forbids every position");
  bad = good;
  bad.joints[1].parent = 3;
  expect(bad, "joint 1 has an end that is out of range");
  bad = good;
  bad.joints[2].child = bad.joints[2].parent;
  expect(bad, "joint 2 joins a part to itself");
  bad = good;
  bad.joints[0].cost.y.weight = -2;
  expect(bad, "joint 0 has a weight that is negative or not finite");
  structure.options.tolerance = -1;
  expect(good, "option tolerance is negative or not finite");
  structure.options = {};
  structure.options.max_iterations = 0;
  expect(good, "option max_iterations is below 1");
}

}  // namespace
}  // namespace asterism
