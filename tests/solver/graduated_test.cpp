// Graduated non-convexity against solves from a cold start, on systems with outliers.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/method/graduated.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/testing/random_system.hpp>
#include <cstdint>

namespace asterism {
namespace {

using testing::random_points;
using testing::Rng;

using TruncatedSystem = SpringSystem<double, 2, Eigen::Dynamic, 10, Model<Hooke, Truncated>>;
using RobustLinks = SpringSystem<double, 2, Eigen::Dynamic, 10, Model<RobustHooke<GemanMcClure>>>;

/// A shape of ten nodes, some of whose anchors are anywhere; links want the shape's offsets.
struct Case {
  TruncatedSystem system;
  TruncatedSystem::Points truth;
};

Case with_outliers(std::uint64_t seed, int outliers) {
  constexpr int kNodes = 10;
  Rng rng(seed);
  TruncatedSystem system(TruncatedSystem::TopologyType::full(kNodes));
  const auto truth = random_points<TruncatedSystem>(rng, kNodes, -30, 30);
  system.set_rest_offsets(truth);
  system.link_stiffness.setConstant(1);
  system.anchor_stiffness.setConstant(0.3);
  system.anchors = truth + random_points<TruncatedSystem>(rng, kNodes, -1, 1);
  for (int i = 0; i < outliers; ++i)
    system.anchors.col(i) = random_points<TruncatedSystem>(rng, 1, -200, 200);
  system.anchor_loss.scale = 5;
  return {system, truth};
}

template <typename Solver>
int found(int outliers) {
  int count = 0;
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    const Case test = with_outliers(seed, outliers);
    auto x = test.system.anchors;
    Solver solver;
    const double before = energy(test.system, x);
    const Summary summary = solver.solve(test.system, x);
    EXPECT_TRUE(summary.usable()) << summary;
    EXPECT_LE(summary.final_energy, before);
    EXPECT_NEAR(summary.final_energy, energy(test.system, x), 1e-12 * summary.final_energy);
    count += (x - test.truth).colwise().norm().maxCoeff() < 3;
  }
  return count;
}

using NewtonAlone = Newton<TruncatedSystem>;
using GraduatedNewton = Graduated<TruncatedSystem, NewtonAlone>;

TEST(Graduated, FindsThePlacementAmongOutliers) {
  EXPECT_EQ(found<GraduatedNewton>(0), 100);
  for (const int outliers : {2, 4}) {
    const int cold = found<NewtonAlone>(outliers);
    EXPECT_EQ(found<GraduatedNewton>(outliers), 100) << outliers;
    EXPECT_LT(cold, 80) << outliers;  // otherwise the cases are too easy to tell
  }
}

// One length of fifteen is measured wrongly; the others agree.
TEST(Graduated, FindsAWrongDistance) {
  RobustLinks system(RobustLinks::TopologyType::full(6));
  Rng rng(7);
  int graduated = 0, cold = 0;
  for (int trial = 0; trial < 50; ++trial) {
    const auto truth = random_points<RobustLinks>(rng, 6, -20, 20);
    system.anchors = truth + random_points<RobustLinks>(rng, 6, -3, 3);
    system.anchor_stiffness.setConstant(0.01);
    system.set_rest_lengths(truth);
    system.link_stiffness.setOnes();
    system.rest_length[3] += 60;
    system.link_potential.loss.scale = 2;
    RobustLinks::Points x = system.anchors + random_points<RobustLinks>(rng, 6, -15, 15);
    auto y = x;
    Graduated<RobustLinks, Newton<RobustLinks>> solver;
    ASSERT_TRUE(solver.solve(system, x).usable());
    ASSERT_TRUE(Newton<RobustLinks>().solve(system, y).usable());
    graduated += energy(system, x) <= energy(system, truth) * 1.01;
    cold += energy(system, y) <= energy(system, truth) * 1.01;
  }
  EXPECT_GT(graduated, cold + 5);  // both may end in a mirror image
}

TEST(Graduated, StopsOnRequestWithTheGivenPlacement) {
  const Case test = with_outliers(2, 4);
  GraduatedNewton solver;
  int calls = 0;
  const auto stop = [&calls](const Iteration&) { return ++calls < 8; };
  solver.options.on_iteration = stop;
  auto x = test.system.anchors;
  const Summary summary = solver.solve(test.system, x);
  EXPECT_EQ(summary.status, Status::Interrupted) << summary;
  EXPECT_EQ(x, test.system.anchors);
  EXPECT_EQ(summary.final_energy, summary.initial_energy);
}

TEST(Graduated, RefusesBadInput) {
  Case test = with_outliers(1, 2);
  GraduatedNewton solver;
  auto x = test.system.anchors;
  solver.options.factor = 1;
  EXPECT_EQ(solver.solve(test.system, x).status, Status::InvalidInput);
  solver.options.factor = 1.4;
  test.system.anchor_stiffness[2] = -1;
  const Summary summary = solver.solve(test.system, x);
  EXPECT_EQ(summary.status, Status::InvalidInput);
  EXPECT_EQ(std::string_view(summary.message), "anchor stiffness 2 is negative or not finite");
  EXPECT_EQ(x, test.system.anchors);
  test.system.anchor_stiffness[2] = 1;
  test.system.anchor_loss.sharpness = 0;
  EXPECT_EQ(solver.solve(test.system, x).status, Status::InvalidInput);
}

}  // namespace
}  // namespace asterism
