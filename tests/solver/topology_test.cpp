#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/solver/method/auto.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/testing/random_system.hpp>
#include <cmath>
#include <ctime>
#include <set>
#include <string_view>
#include <utility>
#include <vector>

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

/// A distribution of points, compared with brute force and timed. One line per distribution.
struct Distribution {
  const char* name;
  void (*place)(testing::Rng& rng, int i, Eigen::Ref<Eigen::VectorXd> point);
};

constexpr Distribution kDistributions[] = {
    {"anywhere",
     [](testing::Rng& rng, int, auto point) {
       for (double& c : point) c = rng.uniform(0, 1);
     }},
    {"coincident", [](testing::Rng&, int, auto point) { point.setConstant(0.3); }},
    {"a few coincident",
     [](testing::Rng& rng, int i, auto point) {
       for (double& c : point) c = i % 9 == 0 ? 0.5 : rng.uniform(0, 1);
     }},
    {"on two points", [](testing::Rng&, int i, auto point) { point.setConstant(i % 2); }},
    {"on a line",
     [](testing::Rng& rng, int, auto point) {
       point.setZero();
       point[0] = rng.uniform(0, 1);
     }},
    {"evenly on a line", [](testing::Rng&, int i, auto point) { point.setConstant(i); }},
    {"on a grid",
     [](testing::Rng&, int i, auto point) {
       for (double& c : point) {
         c = i % 32;
         i /= 32;
       }
     }},
    {"one far outlier",
     [](testing::Rng& rng, int i, auto point) {
       for (double& c : point) c = i == 0 ? 1e300 : rng.uniform(0, 1);
     }},
    {"clustered at many scales",
     [](testing::Rng& rng, int i, auto point) {
       for (double& c : point) c = std::ldexp(rng.uniform(0.5, 1), -(i % 200));
     }},
    {"squares that underflow",
     [](testing::Rng& rng, int, auto point) {
       for (double& c : point) c = 1e-200 * rng.uniform(0, 1);
     }},
    {"squares that overflow",
     [](testing::Rng& rng, int, auto point) {
       for (double& c : point) c = 1e200 * rng.uniform(-1, 1);
     }},
};

Eigen::MatrixXd placed(const Distribution& distribution, int dim, int n) {
  testing::Rng rng(7);
  Eigen::MatrixXd points(dim, n);
  for (int i = 0; i < n; ++i) distribution.place(rng, i, points.col(i));
  return points;
}

template <int Dim>
void expect_nearest_neighbours_as_by_brute_force(const Distribution& distribution, int neighbours) {
  SCOPED_TRACE(distribution.name);
  constexpr int kNodes = 150;
  const Eigen::Matrix<double, Dim, Eigen::Dynamic, Dim == 1 ? Eigen::RowMajor : Eigen::ColMajor> points =
      placed(distribution, Dim, kNodes);
  std::set<std::pair<int, int>> expected;
  for (int i = 0; i < kNodes; ++i) {
    std::vector<std::pair<double, int>> others;
    for (int j = 0; j < kNodes; ++j) {
      if (j != i) others.emplace_back((points.col(i) - points.col(j)).squaredNorm(), j);
    }
    std::sort(others.begin(), others.end());
    for (int m = 0; m < neighbours; ++m)
      expected.insert(std::minmax(i, others[static_cast<std::size_t>(m)].second));
  }
  const auto topology = Topology<>::k_nearest(points, neighbours);
  EXPECT_FALSE(topology.defect());
  EXPECT_EQ(static_cast<std::size_t>(topology.link_count()), expected.size());
  EXPECT_EQ(pairs_of(topology.links()), expected);
}

TEST(Topology, NearestNeighboursAsByBruteForce) {
  for (const Distribution& distribution : kDistributions) {
    for (const int k : {1, 5, 149}) {
      expect_nearest_neighbours_as_by_brute_force<1>(distribution, k);
      expect_nearest_neighbours_as_by_brute_force<2>(distribution, k);
      expect_nearest_neighbours_as_by_brute_force<3>(distribution, k);
      expect_nearest_neighbours_as_by_brute_force<6>(distribution, k);
    }
  }
}

// For any distribution the time is within a small multiple of that for uniform points; comparing all pairs
// takes hundreds of times as long.
TEST(Topology, NearestNeighboursTakeNoLongerOfOddPoints) {
  constexpr int kNodes = 8000;
  const auto seconds = [](const Eigen::MatrixXd& points) {
    const auto begin = std::clock();
    EXPECT_GE(Topology<>::k_nearest(points, 6).link_count(), kNodes * 6 / 2);
    return double(std::clock() - begin) / CLOCKS_PER_SEC;
  };
  for (const int dim : {2, 3}) {
    const double usual = seconds(placed(kDistributions[0], dim, kNodes));
    for (const Distribution& distribution : kDistributions) {
      EXPECT_LT(seconds(placed(distribution, dim, kNodes)), 10 * usual + 0.1) << distribution.name;
    }
  }
}

TEST(Topology, FullRefusesMoreLinksThanCanBeCounted) { EXPECT_TRUE(Topology<>::full(70000).defect()); }

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

TEST(Topology, TakesLinksInBraces) {
  const auto topology = Topology<>::from_links(3, {{0, 1}, {2, 1}});
  EXPECT_EQ(topology.link_count(), 2);
  EXPECT_FALSE(topology.defect());
  EXPECT_EQ(Topology<>::from_links(3, {}).link_count(), 0);
}

TEST(Topology, RefusesWhatItsTypeCannotHold) {
  EXPECT_TRUE(Topology<4>::full(5).defect());
  EXPECT_TRUE(Topology<4>::full(3).defect());
  EXPECT_EQ(Topology<4>::full(3).nodes(), 4);
  EXPECT_TRUE((Topology<Eigen::Dynamic, 4>::full(5).defect()));
  EXPECT_FALSE((Topology<Eigen::Dynamic, 4>::full(3).defect()));
  const auto reason = [](const Defect& defect) { return std::string(std::string_view(Message(defect))); };
  EXPECT_EQ(reason(Topology<>::full(-1).defect()), "node count -1 is negative");
  EXPECT_EQ(reason(Topology<4>::full(5).defect()), "node count 5 does not fit the topology's type");
  EXPECT_EQ(reason(Topology<>::star(3, -1).defect()), "centre -1 is out of range");
  EXPECT_EQ(reason(Topology<>::k_nearest(Eigen::Matrix2d::Zero(), -1).defect()),
            "neighbour count -1 is negative");
  const Link repeated[] = {{0, 1}, {1, 0}};
  EXPECT_FALSE(Topology<>::from_links(2, repeated).defect());
  EXPECT_EQ(Topology<2>::from_links(2, repeated).defect().index, 1);  // space for one link
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
