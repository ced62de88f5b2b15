#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/solver/spring_system.hpp>
#include <asterism/solver/topology.hpp>
#include <set>
#include <string_view>
#include <utility>
#include <vector>

#include "../../bench/random_system.hpp"

namespace asterism {
namespace {

std::set<std::pair<int, int>> pairs_of(std::span<const Link> links) {
  std::set<std::pair<int, int>> pairs;
  for (const Link& link : links) pairs.insert(std::minmax(link.i, link.j));
  return pairs;
}

TEST(Topology, FullLinksEveryPairOnce) {
  const auto topology = Topology<>::full(5);
  EXPECT_FALSE(topology.defect());
  EXPECT_EQ(topology.nodes(), 5);
  EXPECT_EQ(topology.link_count(), 10);
  EXPECT_EQ(pairs_of(topology.links()).size(), 10u);
  EXPECT_EQ(topology.links()[0], (Link{0, 1}));
  EXPECT_EQ(topology.links()[9], (Link{3, 4}));
  EXPECT_EQ(Topology<1>::full().link_count(), 0);
  EXPECT_EQ(Topology<4>::full().link_count(), 6);
}

TEST(Topology, StarLinksTheCentreToTheOthers) {
  const auto topology = Topology<Eigen::Dynamic, 8>::star(5, 2);
  EXPECT_FALSE(topology.defect());
  EXPECT_EQ(pairs_of(topology.links()), (std::set<std::pair<int, int>>{{0, 2}, {1, 2}, {2, 3}, {2, 4}}));
  EXPECT_TRUE(Topology<>::star(5, 5).defect());
  EXPECT_TRUE(Topology<>::star(5, -1).defect());
}

template <int Dim>
void expect_nearest_neighbours_as_by_brute_force() {
  using System = SpringSystem<double, Dim>;
  bench::Rng rng(7);
  constexpr int kNodes = 150;
  constexpr int kNeighbours = 5;
  auto points = bench::random_points<System>(rng, kNodes, 0, 1);
  points.col(17) = points.col(3);  // coincident points are neighbours like others
  std::set<std::pair<int, int>> expected;
  for (int i = 0; i < kNodes; ++i) {
    std::vector<std::pair<double, int>> others;
    for (int j = 0; j < kNodes; ++j) {
      if (j != i) others.emplace_back((points.col(i) - points.col(j)).squaredNorm(), j);
    }
    std::sort(others.begin(), others.end());
    for (int m = 0; m < kNeighbours; ++m)
      expected.insert(std::minmax(i, others[static_cast<std::size_t>(m)].second));
  }
  const auto topology = Topology<>::k_nearest(points, kNeighbours);
  EXPECT_FALSE(topology.defect());
  EXPECT_EQ(static_cast<std::size_t>(topology.link_count()), expected.size());
  EXPECT_EQ(pairs_of(topology.links()), expected);
}

TEST(Topology, NearestNeighboursAsByBruteForce) {
  expect_nearest_neighbours_as_by_brute_force<1>();
  expect_nearest_neighbours_as_by_brute_force<2>();
  expect_nearest_neighbours_as_by_brute_force<3>();
}

TEST(Topology, NearestNeighboursOfAGridBreakTiesByIndex) {
  Eigen::Matrix2Xd grid(2, 4);
  grid << 0, 1, 0, 1, 0, 0, 1, 1;
  EXPECT_EQ(pairs_of(Topology<>::k_nearest(grid, 1).links()),
            (std::set<std::pair<int, int>>{{0, 1}, {0, 2}, {1, 3}}));
  EXPECT_EQ(Topology<>::k_nearest(grid, 9).link_count(), 6);
  EXPECT_EQ(Topology<>::k_nearest(grid, 0).link_count(), 0);
  EXPECT_TRUE(Topology<>::k_nearest(grid, -1).defect());
  grid(0, 0) = std::nan("");
  EXPECT_TRUE(Topology<>::k_nearest(grid, 1).defect());
}

TEST(Topology, KeepsAListUpToItsFirstBadLink) {
  const Link self[] = {{0, 1}, {2, 2}, {1, 2}};
  const auto with_self = Topology<>::from_links(3, self);
  EXPECT_EQ(with_self.link_count(), 1);
  EXPECT_EQ(with_self.defect().index, 1);
  EXPECT_EQ(std::string_view(with_self.defect().problem), "joins a node to itself");
  for (const Link bad : {Link{0, 3}, Link{-1, 0}, Link{3, 0}}) {
    const Link links[] = {{0, 1}, {1, 2}, bad};
    const auto topology = Topology<>::from_links(3, links);
    EXPECT_EQ(topology.link_count(), 2);
    EXPECT_EQ(topology.defect().index, 2);
  }
}

TEST(Topology, RefusesWhatItsTypeCannotHold) {
  EXPECT_TRUE(Topology<4>::full(5).defect());
  EXPECT_TRUE(Topology<4>::full(3).defect());
  EXPECT_EQ(Topology<4>::full(3).nodes(), 4);
  EXPECT_TRUE((Topology<Eigen::Dynamic, 4>::full(5).defect()));
  EXPECT_FALSE((Topology<Eigen::Dynamic, 4>::full(3).defect()));
  EXPECT_TRUE(Topology<>::full(-2).defect());
  const Link repeated[] = {{0, 1}, {1, 0}};
  EXPECT_FALSE(Topology<>::from_links(2, repeated).defect());
  EXPECT_EQ(Topology<2>::from_links(2, repeated).defect().index, 1);  // room for one link
}

TEST(Topology, HasNoLinksLeftOnceMovedFrom) {
  auto full = Topology<>::full(5);
  const auto taken = std::move(full);
  EXPECT_EQ(taken.link_count(), 10);
  EXPECT_TRUE(taken.is_full());
  EXPECT_EQ(full.link_count(), 0);  // NOLINT(bugprone-use-after-move)
  EXPECT_TRUE(full.links().empty());
  EXPECT_FALSE(full.is_full());

  SpringSystem<double, 2> system(taken);
  system.anchors.setRandom();
  system.anchor_stiffness.setOnes();
  system.rest_length.setOnes();
  system.link_stiffness.setOnes();
  Eigen::Matrix2Xd x = system.anchors;
  const SpringSystem<double, 2> kept = std::move(system);
  EXPECT_EQ(solve(system, x).status, Status::InvalidInput);  // NOLINT(bugprone-use-after-move)
  EXPECT_TRUE(solve(kept, x).usable());
}

TEST(SpringSystem, StartsUnset) {
  const SpringSystem<float, 3, 4> system(Topology<4>::full());
  EXPECT_TRUE(system.anchors.hasNaN());
  EXPECT_TRUE(system.anchor_stiffness.hasNaN());
  EXPECT_EQ(system.rest_length.size(), 6);
  EXPECT_TRUE(system.rest_length.hasNaN());
  EXPECT_TRUE(system.link_stiffness.hasNaN());
}

TEST(SpringSystem, RestLengthsAreDistances) {
  SpringSystem<double, 2> system(Topology<>::star(3, 1));
  Eigen::Matrix2Xd points(2, 3);
  points << 3, 0, 5, 4, 0, 12;
  system.set_rest_lengths(points);
  EXPECT_DOUBLE_EQ(system.rest_length[0], 5);
  EXPECT_DOUBLE_EQ(system.rest_length[1], 13);
}

}  // namespace
}  // namespace asterism
