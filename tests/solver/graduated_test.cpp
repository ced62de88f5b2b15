// Graduated non-convexity against solves from a cold start, on systems with outliers.
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <asterism/solver/terms/registry.hpp>
#include <asterism/system.hpp>
#include <asterism/testing/random_system.hpp>
#include <cstdint>
#include <ostream>
#include <string>
#include <string_view>

namespace asterism {
namespace {

using Eigen::MatrixXd;
using testing::Rng;

MatrixXd random_points(Rng& rng, int n, double size) {
  MatrixXd x(2, n);
  for (double& value : x.reshaped()) value = rng.uniform(-size, size);
  return x;
}

/// A shape of ten nodes, some of whose anchors are anywhere; springs want the shape's offsets.
struct Case {
  System system;
  MatrixXd seen, truth;
};

Case with_outliers(std::uint64_t seed, int outliers, Loss loss) {
  constexpr int kNodes = 10;
  Rng rng(seed);
  const MatrixXd truth = random_points(rng, kNodes, 30);
  MatrixXd seen = truth + random_points(rng, kNodes, 1);
  for (int i = 0; i < outliers; ++i) seen.col(i) = random_points(rng, 1, 200);
  System system(kNodes, 2);
  system.add_anchors(seen, System::all(0.3)).set_loss(loss, 5);
  system.add_offsets(all_pairs(kNodes), offsets_at(truth, all_pairs(kNodes)), System::all(1));
  return {system, seen, truth};
}

int found(std::string_view method, int outliers, Loss loss) {
  int count = 0;
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    const Case test = with_outliers(seed, outliers, loss);
    MatrixXd x = test.seen;
    const double before = energy(test.system, x);
    const Summary summary = solve(method, test.system, x);
    EXPECT_TRUE(summary.usable()) << summary;
    EXPECT_EQ(summary.initial_energy, before);
    EXPECT_LE(summary.final_energy, before);
    EXPECT_NEAR(summary.final_energy, energy(test.system, x), 1e-12 * summary.final_energy);
    count += (x - test.truth).colwise().norm().maxCoeff() < 3;
  }
  return count;
}

TEST(Graduated, FindsThePlacementAmongOutliers) {
  for (const Loss loss : {Loss::Truncated, Loss::GemanMcClure}) {
    EXPECT_EQ(found("graduated", 0, loss), 100);
    for (const int outliers : {2, 4}) {
      EXPECT_EQ(found("graduated", outliers, loss), 100) << outliers;
      if (loss == Loss::Truncated) {
        EXPECT_LT(found("newton", outliers, loss), 80)
            << outliers;  // otherwise the cases are too easy to tell
      }
    }
  }
}

// One length of fifteen is measured wrongly; the others agree.
TEST(Graduated, FindsAWrongDistance) {
  Rng rng(7);
  int graduated = 0, cold = 0;
  for (int trial = 0; trial < 50; ++trial) {
    const MatrixXd truth = random_points(rng, 6, 20);
    const MatrixXd seen = truth + random_points(rng, 6, 3);
    Eigen::VectorXd lengths = lengths_at(truth, all_pairs(6));
    lengths[3] += 60;
    System system(6, 2);
    system.add_anchors(seen, System::all(0.01));
    system.add_links(all_pairs(6), lengths, System::all(1)).set_loss(Loss::GemanMcClure, 2);
    MatrixXd x = seen + random_points(rng, 6, 15), y = x;
    ASSERT_TRUE(solve("graduated", system, x).usable());
    ASSERT_TRUE(solve("newton", system, y).usable());
    graduated += energy(system, x) <= energy(system, truth) * 1.01;
    cold += energy(system, y) <= energy(system, truth) * 1.01;
  }
  EXPECT_GT(graduated, cold + 5);  // both may end in a mirror image
}

TEST(Graduated, StopsOnRequestWithTheGivenPlacement) {
  const Case test = with_outliers(2, 4, Loss::Truncated);
  AlignedOptions options;
  int calls = 0;
  const auto stop = [&calls](const Iteration&) { return ++calls < 8; };
  options.on_iteration = stop;
  MatrixXd x = test.seen;
  const Summary summary = solve("graduated", test.system, x, options);
  EXPECT_EQ(summary.status, Status::Interrupted) << summary;
  EXPECT_EQ(x, test.seen);
  EXPECT_EQ(summary.final_energy, summary.initial_energy);
}

TEST(Graduated, RefusesBadInput) {
  Case test = with_outliers(1, 2, Loss::Truncated);
  MatrixXd x = test.seen;
  EXPECT_THROW(system_solvers().make("graduated", {{"factor", 1.0}}), std::invalid_argument);
  Term& anchors = test.system.term(0);
  anchors.values("stiffness")(0) = -1;
  const Summary summary = solve("graduated", test.system, x);
  EXPECT_EQ(summary.status, Status::InvalidInput);
  EXPECT_EQ(std::string(std::string_view(summary.message)),
            "anchors: stiffness of element 0 is negative or not finite: -1");
  EXPECT_EQ(x, test.seen);
  anchors.values("stiffness")(0) = 1;
  anchors.values("sharpness")(0) = 0;
  EXPECT_EQ(solve("graduated", test.system, x).status, Status::InvalidInput);
}

}  // namespace
}  // namespace asterism
