// Pictorial structures use the heap in the first solve of its sizes only.
#include <gtest/gtest.h>

#include <asterism/solver/discrete/loopy_structure.hpp>
#include <asterism/solver/discrete/m_best_placements.hpp>
#include <asterism/solver/discrete/pictorial_structure.hpp>
#include <asterism/solver/discrete/scaled_structure.hpp>
#include <asterism/testing/random_system.hpp>
#include <vector>

#include "counting_allocator.hpp"

namespace asterism {
namespace {

using testing::allocations_in;

TEST(DiscreteHeap, IsUsedByTheFirstSolveOnly) {
  constexpr int kParts = 4, kWidth = 61, kHeight = 47;
  testing::Rng rng(1);
  std::vector<std::vector<float>> numbers(kParts);
  std::vector<MapView<const float>> maps;
  std::vector<Joint> joints;
  const auto fill = [&] {
    for (auto& map : numbers) {
      map.resize(kWidth * kHeight);
      for (float& number : map) number = static_cast<float>(rng.uniform(0, 1));
    }
  };
  fill();
  for (int i = 0; i < kParts; ++i) {
    maps.emplace_back(numbers[static_cast<std::size_t>(i)].data(), kWidth, kHeight);
    if (i > 0)
      joints.push_back({i / 2, i, {AxisCost::quadratic(0.02, 3.3 * i), AxisCost::absolute(0.1, -8)}});
  }
  PictorialStructure structure;
  PartPlacement best;
  std::vector<PartPlacement> further;
  std::vector<float> marginals(kWidth * kHeight);
  bool good = true;
  const auto all = [&] {
    good &= structure.solve(joints, maps, best).usable();
    good &= structure.best_placements(5, 4, further) == 5;
    for (int i = 0; i < kParts; ++i) {
      good &= structure.min_marginals(i, {marginals.data(), kWidth, kHeight}).empty();
    }
  };
  EXPECT_GT(allocations_in(all), 0);
  fill();
  EXPECT_EQ(allocations_in(all), 0);
  // Nor do other costs, and errors.
  EXPECT_EQ(allocations_in([&] {
              joints[1].cost = {AxisCost::quadratic(1e-4, -30), AxisCost::quadratic(1e-4, 90)};
              all();
              joints[2].child = 0;
              good &= !structure.solve(joints, maps, best).usable();
            }),
            0);
  EXPECT_TRUE(good);

  MBestPlacements m_best;
  const std::vector<Joint> star(joints.begin(), joints.begin() + 1);
  const auto rank = [&] {
    good &= m_best.solve(star, {maps.data(), 2}, 4, 3, further).usable() && m_best.found() == 4;
  };
  EXPECT_GT(allocations_in(rank), 0);
  EXPECT_EQ(allocations_in(rank), 0);
  EXPECT_TRUE(good);

  ScaledStructure scaled;
  ScaledPlacement of_scales;
  std::vector<ScaledPlacement> more;
  const std::vector<ScaledJoint> scaled_joints{{joints[0], AxisCost::quadratic(0.1, 0)}};
  const std::vector<double> scales{1, 1.2};
  const auto solve_scales = [&] {
    good &= scaled.solve(scaled_joints, scales, maps, of_scales).usable();
    good &= scaled.best_placements(3, 4, more) == 3;
  };
  EXPECT_GT(allocations_in(solve_scales), 0);
  fill();
  EXPECT_EQ(allocations_in(solve_scales), 0);
  EXPECT_TRUE(good);

  LoopyStructure loopy;
  loopy.options.max_iterations = 3;
  joints.push_back({3, 2, {AxisCost::quadratic(0.03, 1), AxisCost::quadratic(0.1, 2.5)}});
  const auto solve = [&] { good &= loopy.solve(joints, maps, best).usable(); };
  EXPECT_GT(allocations_in(solve), 0);
  fill();
  joints[0].cost.x.offset = -40;
  EXPECT_EQ(allocations_in(solve), 0);
  EXPECT_TRUE(good);

  DistanceTransform transform;
  const auto run = [&] {
    good &= transform.run(maps[0], joints[0].cost, {marginals.data(), kWidth, kHeight}).empty();
  };
  EXPECT_GT(allocations_in(run), 0);
  EXPECT_EQ(allocations_in(run), 0);
  EXPECT_TRUE(good);
}

}  // namespace
}  // namespace asterism
