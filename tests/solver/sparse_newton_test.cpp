// Newton's method of terms for springs, with its factorisations: IDA's minima, weak anchors.
#include <gtest/gtest.h>

#include <asterism/solver.hpp>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "by_terms.hpp"
#include "solver_fixture.hpp"
#include "test_systems.hpp"

namespace asterism {
namespace {

using testing::Plane;
using testing::Space;

template <typename C>
class SparseNewtonTest : public SolverFixture<C> {};
template <typename System_, template <typename> typename Solver_>
struct Case {
  using System = System_;
  using Solver = Solver_<System>;
};
using Cases = ::testing::Types<
#ifdef ASTERISM_TEST_CHOLMOD
    Case<Plane, testing::CholmodNewton>, Case<Space, testing::CholmodNewton>,
#endif
    Case<Plane, testing::SparseNewton>, Case<Space, testing::SparseNewton>>;
TYPED_TEST_SUITE(SparseNewtonTest, Cases);

TYPED_TEST(SparseNewtonTest, FindsIdasMinimumFromItsBasin) {
  ASTERISM_USE_FIXTURE;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    auto [system, start] = testing::sparse_system<System>(seed, 150);
    EXPECT_TRUE(solve_ida(system, start).usable());
    testing::Rng rng(seed);
    start += testing::random_points<System>(rng, system.nodes(), -0.01, 0.01);
    Points by_ida = start;
    const Summary ida = solve_ida(system, by_ida);
    const Summary summary = Solver().solve(system, start);
    this->expect_converged(summary);
    EXPECT_NEAR(summary.final_energy, ida.final_energy, 1e-8 * ida.final_energy);
    EXPECT_LT((start - by_ida).norm(), 1e-3);
    EXPECT_EQ(summary.positive_definite, true);
    EXPECT_LT(summary.iterations, 12);
  }
}

TYPED_TEST(SparseNewtonTest, EnergyNeverRises) {
  ASTERISM_USE_FIXTURE;
  const auto [system, start] = testing::sparse_system<System>(1, 300);
  Solver solver;
  double last = std::numeric_limits<double>::max();
  for (int iterations = 0; iterations <= 60; ++iterations) {
    solver.options.max_iterations = iterations;
    Points x = start;
    const Summary summary = solver.solve(system, x);
    EXPECT_LE(summary.iterations, iterations);
    EXPECT_LE(summary.final_energy,
              last + double(detail::rounding_of_energy(system, x, static_cast<Scalar>(last))));
    last = std::min(last, summary.final_energy);
    if (summary.status == Status::Converged) break;
  }
}

TYPED_TEST(SparseNewtonTest, WeakAnchorsWhereIdaGetsStuck) {
  ASTERISM_USE_FIXTURE;
  for (const double ratio : {1e-2, 1e-4, 1e-6, 1e-8}) {
    auto [system, start] = testing::sparse_system<System>(2, 200);
    system.anchor_stiffness *= static_cast<Scalar>(ratio);
    Points x = start;
    const Summary summary = Solver().solve(system, x);
    this->expect_converged(summary);
    EXPECT_LT(summary.iterations, 300);
    if (ratio > 1e-5) continue;
    SolverOptions options;
    options.max_iterations = 300;
    EXPECT_NE(Ida<System>(system, options).solve(system, start).status, Status::Converged);
  }
}

TYPED_TEST(SparseNewtonTest, SameResultsWhenReused) {
  ASTERISM_USE_FIXTURE;
  Solver solver;
  for (const int n : {60, 60, 80, 60, 7}) {
    for (std::uint64_t seed = 1; seed <= 2; ++seed) {
      auto [system, start] = testing::sparse_system<System>(seed, n);
      for (const Scalar change : {Scalar(1), Scalar(0.3)}) {
        system.anchor_stiffness *= change;
        Points x = start;
        Points fresh = start;
        const Summary summary = solver.solve(system, x);
        Solver().solve(system, fresh);
        this->expect_converged(summary);
        EXPECT_EQ(x, fresh);
      }
    }
  }
}

TYPED_TEST(SparseNewtonTest, LeavesIndefiniteStarts) {
  ASTERISM_USE_FIXTURE;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    auto [system, start] = testing::sparse_system<System>(seed, 100);
    start *= Scalar(0.3);  // all links too short
    Solver solver;
    solver.options.align = false;
    const Summary summary = solver.solve(system, start);
    this->expect_converged(summary);
    EXPECT_EQ(summary.positive_definite, true);
  }
}

// Across its axis, nothing holds the free end of a compressed link.
TYPED_TEST(SparseNewtonTest, CurvatureThatIsNoneIsRaised) {
  ASTERISM_USE_FIXTURE;
  System system(System::TopologyType::from_links(2, std::vector<Link>{{0, 1}}));
  system.anchors.setZero();
  system.anchor_stiffness << 1, 0;
  system.rest_length[0] = 100;
  system.link_stiffness[0] = 1;
  Points x = Points::Zero(System::kDim, 2);
  x(0, 1) = 1;
  Solver solver;
  solver.options.align = false;
  const Summary summary = solver.solve(system, x);
  this->expect_converged(summary);
  EXPECT_LT(summary.final_energy, 1e-6 * summary.initial_energy);
  EXPECT_LE(summary.factorizations, 3 * (summary.iterations + 1));
}

TYPED_TEST(SparseNewtonTest, SmallAndDisconnected) {
  ASTERISM_USE_FIXTURE;
  const auto on_anchors = [&](int n, const std::vector<Link>& links) {
    testing::Rng rng(4);
    auto [system, start] = testing::random_system<System>(rng, System::TopologyType::from_links(n, links));
    const Summary summary = Solver().solve(system, start);
    this->expect_converged(summary);
    for (int i = 0; i < n; ++i) {
      bool linked = false;
      for (const Link& link : links) linked |= link.i == i || link.j == i;
      if (!linked) {
        EXPECT_LT((start.col(i) - system.anchors.col(i)).norm(), 1e-5);
      }
    }
  };
  on_anchors(1, {});
  on_anchors(5, {});
  on_anchors(2, {{1, 0}});
  on_anchors(7, {{0, 1}, {1, 2}, {4, 5}, {5, 4}});
}

TYPED_TEST(SparseNewtonTest, FixedNodesStay) {
  ASTERISM_USE_FIXTURE;
  auto [system, start] = testing::sparse_system<System>(3, 100);
  for (const int i : {0, 17, 18, 99}) system.fix(i);
  Points x = start;
  this->expect_converged(Solver().solve(system, x));
  for (const int i : {0, 17, 18, 99}) EXPECT_EQ(x.col(i), start.col(i));
  EXPECT_GT((x - start).norm(), 1);
}

TYPED_TEST(SparseNewtonTest, BadInputIsRefused) {
  ASTERISM_USE_FIXTURE;
  auto [system, start] = testing::sparse_system<System>(3, 20);
  system.link_stiffness[3] = -1;
  const Points before = start;
  EXPECT_EQ(Solver().solve(system, start).status, Status::InvalidInput);
  EXPECT_EQ(start, before);
}

TEST(SparseNewton, EscapesSaddles) {
  testing::Rng rng(5);
  auto [system, start] = testing::random_system<Plane>(rng, Topology<>::full(6));
  start.row(1).setZero();
  system.anchors.row(1).setZero();
  testing::SparseNewton<Plane> solver;
  solver.options.escape_saddles = false;
  auto x = start;
  const Summary saddle = solver.solve(system, x);
  EXPECT_EQ(saddle.status, Status::Converged) << saddle;
  EXPECT_EQ(saddle.positive_definite, false);
  solver.options.escape_saddles = true;
  x = start;
  const Summary minimum = solver.solve(system, x);
  EXPECT_EQ(minimum.status, Status::Converged) << minimum;
  EXPECT_EQ(minimum.positive_definite, true);
  EXPECT_LT(minimum.final_energy, 0.9 * saddle.final_energy);
}

TEST(SparseNewton, RobustAndAnisotropicAnchors) {
  using Robust = SpringSystem<double, 2, Eigen::Dynamic, Eigen::Dynamic,
                              Model<Hooke, GemanMcClure, AnchorShape::Anisotropic>>;
  const auto plain = testing::sparse_system<Plane>(6, 100);
  Robust system(plain.system.topology());
  system.anchors = plain.system.anchors;
  system.rest_length = plain.system.rest_length;
  system.link_stiffness = plain.system.link_stiffness;
  for (int i = 0; i < 100; ++i) {
    system.set_anchor_information(
        i, Eigen::Vector2d(plain.system.anchor_stiffness[i], 1).asDiagonal().toDenseMatrix());
  }
  auto x = plain.start;
  const Summary summary = testing::SparseNewton<Robust>().solve(system, x);
  EXPECT_EQ(summary.status, Status::Converged) << summary;
  EXPECT_EQ(summary.positive_definite, true);
}

/// A crumpled sheet of springs in space without bending stiffness, on anchors of stiffness `share`.
testing::RandomSystem<Space> crumpled_cloth(double share) {
  constexpr int kSide = 16;
  std::vector<Link> links;
  Space::Points grid = Space::Points::Zero(3, kSide * kSide);
  for (int i = 0; i < kSide * kSide; ++i) {
    grid.col(i) << i % kSide, i / kSide, 0;
    if (i % kSide > 0) links.push_back({i - 1, i});
    if (i >= kSide) links.push_back({i - kSide, i});
  }
  testing::Rng rng(4);
  Space system(Topology<>::from_links(kSide * kSide, links));
  system.anchors = 0.8 * grid + testing::random_points<Space>(rng, kSide * kSide, -0.3, 0.3);
  system.anchor_stiffness.setConstant(share);
  system.rest_length.setOnes();
  system.link_stiffness.setOnes();
  return {system, grid + testing::random_points<Space>(rng, kSide * kSide, -0.3, 0.3)};
}

// Weaker anchors hardly move the minimum and need hardly more steps, whereas direct steps from the start take
// thousands.
TEST(Continuation, FollowsTheMinimumAsAnchorsWeaken) {
  for (const double share : {1e-4, 1e-6, 1e-8}) {
    const auto [system, start] = crumpled_cloth(share);
    testing::SparseNewton<Space> solver;
    auto x = start;
    const Summary summary = solver.solve(system, x);
    ASSERT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_LT(summary.iterations, 200) << share;
    // The forces of weaker anchors are below the tolerance before the last negative curvature is gone.
    if (share > 1e-7) {
      EXPECT_EQ(summary.positive_definite, true);
    }
    // A solve from the solution does not begin again.
    auto again = x;
    EXPECT_LE(solver.solve(system, again).iterations, 1);
    EXPECT_EQ(again, x);
    // Never worse than the start, for any limit.
    for (const int limit : {0, 1, 2, 5}) {
      solver.options.max_iterations = limit;
      auto y = start;
      const Summary few = solver.solve(system, y);
      EXPECT_LE(few.final_energy, few.initial_energy);
      EXPECT_LE(few.iterations, limit);
    }
    solver.options.max_iterations = 2 * summary.iterations;
    solver.options.continuation = false;
    auto straight = start;
    const Summary without = solver.solve(system, straight);
    if (share == 1e-6) {
      EXPECT_EQ(without.status, Status::MaxIterations) << share;
    }
  }
}

// The energies and gradients reported during continuation are those of the given system.
TEST(Continuation, ReportsTheGivenSystem) {
  const auto [system, start] = crumpled_cloth(1e-6);
  testing::SparseNewton<Space> solver;
  int reports = 0;
  auto check = [&, &system = system](const Iteration& at) {
    const Space::Points x = at.x;
    EXPECT_NEAR(at.energy, energy(system, x), 1e-12 * at.energy);
    EXPECT_NEAR(at.gradient_norm, gradient(system, x).norm(), 1e-9 * (1 + at.gradient_norm));
    ++reports;
    return true;
  };
  solver.options.on_iteration = check;
  auto x = start;
  const Summary summary = solver.solve(system, x);
  EXPECT_EQ(summary.status, Status::Converged);
  EXPECT_GE(reports, 10);
}

#ifdef ASTERISM_TEST_CHOLMOD
TEST(CholmodProof, IsThatOfEigensFactor) {
  for (const bool is_taut : {false, true}) {
    auto [system, x] = testing::sparse_system<Plane>(1, 300);
    if (is_taut) system.rest_length *= 0.2;
    testing::SparseNewton<Plane>().solve(system, x);
    const Certificate expected = certify(system, x);
    const Certificate certificate = Certifier<Plane, CholmodProof>(system).certify(system, x);
    EXPECT_EQ(certificate.proof, expected.proof);
    EXPECT_EQ(certificate.certified(), is_taut);
    EXPECT_NEAR(certificate.lower_bound, expected.lower_bound, 1e-6 * expected.energy);
  }
}
#endif

}  // namespace
}  // namespace asterism
