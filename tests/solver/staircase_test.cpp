// The staircase: compared with many starts, known minima and the bounds of its former implementation; terms
// in more dimensions; and the inputs that must pass through it unchanged.
#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/solver/method/auto.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/terms/from_springs.hpp>
#include <asterism/system.hpp>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <string_view>

#include "by_terms.hpp"
#include "lowest_energy.hpp"
#include "model_kits.hpp"
#include "random_values.hpp"
#include "test_systems.hpp"

namespace asterism {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using testing::Fixed2;
using testing::Fixed2f;
using testing::Kind;
using testing::lowest_energy;
using testing::Plane;
using testing::random_points;
using testing::random_shapes;
using testing::random_values;
using testing::Rng;
using testing::Space;

constexpr std::string_view kProven = "within the gap of the global minimum";

// What the template that compiled a solver for each lifted type proved of the same systems.
struct Former {
  int proven = 0;
  double mean_bound = 0;  // as a share of the energy
};

template <typename Springs>
void expect_lowest(Kind kind, int nodes, int systems, double share, double accuracy,
                   const Former& former = {}) {
  AnySolver<Springs> staircase = system_solver<Springs>("staircase"), plain = system_solver<Springs>("auto");
  int lowest_found = 0, proven = 0;
  double bounds = 0;
  for (int index = 0; index < systems; ++index) {
    const auto [system, start] = testing::numbered_system<Springs>(kind, Springs::TopologyType::full(nodes),
                                                                   5000 + static_cast<std::uint64_t>(index));
    typename Springs::Points x = start, y = start;
    const Summary summary = staircase.solve(system, x);
    ASSERT_TRUE(summary.usable()) << summary;
    EXPECT_LE(summary.final_energy, plain.solve(system, y).final_energy);
    EXPECT_NEAR(summary.final_energy, static_cast<double>(energy(system, x)),
                accuracy * summary.final_energy);
    const double lowest = lowest_energy(system, start, 60, static_cast<std::uint64_t>(index));
    EXPECT_LE(summary.lower_bound, lowest * (1 + accuracy)) << index;
    EXPECT_GT(summary.lower_bound, 0.5 * summary.final_energy) << index;
    bounds += summary.lower_bound / summary.final_energy / systems;
    lowest_found += summary.final_energy <= lowest * (1 + accuracy) ? 1 : 0;
    if (!(summary.message == kProven)) continue;
    ++proven;
    EXPECT_LE(summary.final_energy, lowest * (1 + accuracy)) << index;
  }
  EXPECT_GE(lowest_found, share * systems);
  EXPECT_GE(proven, former.proven);
  EXPECT_GE(bounds, former.mean_bound - 1e-6);
}

TEST(Staircase, EndsInTheLowestMinimumThatManyStartsFind) {
  expect_lowest<Fixed2>(Kind::Lit, 4, 400, 0.985, 1e-6, {328, 0.993238});
  expect_lowest<Plane>(Kind::Track, 9, 60, 0.99, 1e-6, {53, 0.999645});
  expect_lowest<Space>(Kind::Lit, 5, 60, 0.95, 1e-6, {54, 0.997968});
  expect_lowest<Plane>(Kind::Lit, 20, 20, 0.5, 1e-6, {0, 0.972101});
  expect_lowest<Fixed2f>(Kind::Lit, 4, 100, 0.97, 1e-4);
}

// Two nodes on a line that start in swapped order cannot pass each other there, but can in the plane.
TEST(Staircase, LetsNodesPassEachOther) {
  System system(2, 1);
  system.add_anchors(MatrixXd{{0, 1}}, System::all(1));
  system.add_links(all_pairs(2), System::all(1), System::all(50));
  MatrixXd x{{1, 0}}, alone = x;
  EXPECT_GT(solve("newton", system, alone).final_energy, 0.5);
  const Summary summary = solve("staircase", system, x);
  EXPECT_EQ(summary.status, Status::Converged);
  EXPECT_LT(summary.final_energy, 1e-12);
  EXPECT_EQ(summary.message, kProven);
  EXPECT_EQ(summary.solver, "staircase");
  EXPECT_EQ(summary.initial_energy, energy(system, MatrixXd{{1, 0}}));
  EXPECT_TRUE(x.isApprox(MatrixXd{{0, 1}}, 1e-6));
}

// The third node, at the crossing of two rays, has no stiffness in more dimensions; the others pass each
// other all the same.
TEST(Staircase, TakesNodesThatNothingHoldsInMoreDimensions) {
  System system(3, 2);
  Eigen::RowVectorXi first(2), rays(2);
  first << 0, 1;
  rays << 2, 2;
  system.add_anchors(first, MatrixXd{{0, 1}, {0, 0}}, System::all(1)).values("information") =
      Eigen::Vector4d(1, 0, 0, 100);
  system.add_anchors(rays, MatrixXd{{5, 5}, {5, 5}}, System::all(1)).values("information") =
      MatrixXd{{1, 0}, {0, 0}, {0, 0}, {0, 1}};
  system.add_links(all_pairs(2), System::all(1), System::all(50));
  const MatrixXd start{{1, 0, 7}, {0, 0, 3}};
  MatrixXd x = start, alone = start;
  AlignedOptions options;
  options.align = false;
  EXPECT_GT(solve("newton", system, alone, options).final_energy, 0.5);
  EXPECT_LT(solve("staircase", system, x, options).final_energy, 1e-12);
}

// Nodes that are far from where one fixed node and known distances put them: the placement without strain is
// known in any number of dimensions.
TEST(Staircase, FindsThePlacementWithoutStrain) {
  for (const int dim : {1, 2, 3, 5}) {
    int plain_found = 0, found = 0;
    constexpr int kSystems = 20;
    for (std::uint64_t seed = 0; seed < kSystems; ++seed) {
      Rng rng(100 * static_cast<std::uint64_t>(dim) + seed);
      constexpr int kNodes = 8;
      MatrixXd truth(dim, kNodes), start(dim, kNodes);
      for (double& value : truth.reshaped()) value = rng.uniform(-10, 10);
      for (double& value : start.reshaped()) value = rng.uniform(-10, 10);
      System system(kNodes, dim);
      system.add_anchors(truth, System::all(0.01));
      system.add_links(all_pairs(kNodes), lengths_at(truth, all_pairs(kNodes)), System::all(1));
      start.col(3) = truth.col(3);
      system.fix(3);
      MatrixXd x = start, alone = start;
      AlignedOptions options;
      options.tolerance = 1e-12;
      plain_found += solve(system, alone).final_energy < 1e-9 ? 1 : 0;
      const Summary summary = solve("staircase", system, x, options);
      ASSERT_TRUE(summary.usable()) << summary;
      EXPECT_EQ(x.col(3), start.col(3));
      if (!(summary.final_energy < 1e-9)) continue;
      ++found;
      EXPECT_LT((x - truth).cwiseAbs().maxCoeff(), 1e-3);
      EXPECT_EQ(summary.message, kProven) << summary.lower_bound;
    }
    EXPECT_GE(found, kSystems - 1) << dim;
    if (dim < 3) {
      EXPECT_LT(plain_found, found) << dim;
    }
  }
}

TEST(Staircase, KeepsFixedNodes) {
  int moved = 0;
  for (std::uint64_t index = 0; index < 60; ++index) {
    auto [system, start] = testing::numbered_system<Plane>(Kind::Lit, Topology<>::full(5), index);
    system.fix(1);
    Plane::Points x = start, alone = start;
    const Summary summary = system_solver<Plane>("staircase").solve(system, x);
    ASSERT_TRUE(summary.usable());
    EXPECT_EQ(x.col(1), start.col(1));
    EXPECT_LE(summary.lower_bound, lowest_energy(system, start, 20, index) * (1 + 1e-9));
    moved += summary.final_energy < (1 - 1e-6) * Auto<Plane>().solve(system, alone).final_energy ? 1 : 0;
  }
  EXPECT_GT(moved, 0);
}

TEST(Staircase, TakesComponentsThatNothingHolds) {
  const auto [springs, start] = testing::numbered_system<Plane>(Kind::Lit, Topology<>::full(5), 1);
  System system = to_system(springs);
  system.term(0).values("stiffness").setZero();
  MatrixXd x = start;
  EXPECT_EQ(solve("staircase", system, x).status, Status::InvalidInput);
  EXPECT_EQ(x, start);
  AlignedOptions options;
  options.hold_floating = true;
  const Summary summary = solve("staircase", system, x, options);
  EXPECT_TRUE(summary.usable()) << summary;
  EXPECT_EQ(x.col(0), start.col(0));
  EXPECT_LE(summary.lower_bound, summary.final_energy * (1 + 1e-12));
}

TEST(Staircase, OfLargeSparseSystems) {
  const double former[] = {194.84088 / 196.24966, 1313.11496 / 1320.40501};
  for (const int nodes : {100, 400}) {
    const auto [springs, start] = testing::sparse_system<Plane>(3, nodes);
    const System system = to_system(springs);
    MatrixXd x = start, alone = start;
    const Summary plain = solve(system, alone);
    const Summary summary = solve("staircase", system, x);
    EXPECT_TRUE(summary.usable());
    EXPECT_LE(summary.final_energy, plain.final_energy);
    EXPECT_LE(summary.lower_bound, summary.final_energy);
    const double less = nodes == 400 ? 1e-4 : 1e-6;
    EXPECT_GT(summary.lower_bound, former[nodes == 400 ? 1 : 0] * summary.final_energy * (1 - less));
    EXPECT_GT(summary.lower_bound, certify(system, alone).lower_bound);
  }
}

// Hundreds of places in which nodes have changed places, each of which has to leave the plane.
TEST(Staircase, BoundsThousandsOfNodes) {
  const auto [springs, start] = testing::sparse_system<Plane>(4, 3000);
  const System system = to_system(springs);
  MatrixXd x = start, alone = start;
  const Summary plain = solve(system, alone), summary = solve("staircase", system, x);
  ASSERT_TRUE(summary.usable());
  EXPECT_LT(summary.final_energy, plain.final_energy);
  EXPECT_LE(summary.lower_bound, summary.final_energy);
  EXPECT_TRUE(summary.is_within(0.01)) << summary.lower_bound << " of " << summary.final_energy;
}

// Weak anchors: a minimum in more dimensions to the usual tolerance proves nothing at all of most of these.
TEST(Staircase, BoundsManyPartsOnWeakAnchors) {
  constexpr int kSystems = 10;
  int narrow = 0;
  for (std::uint64_t index = 0; index < kSystems; ++index) {
    auto [springs, start] = testing::numbered_system<Plane>(Kind::Track, Topology<>::full(49), index);
    springs.anchor_stiffness *= 0.01;
    const System system = to_system(springs);
    MatrixXd x = start;
    const Summary summary = solve("staircase", system, x);
    ASSERT_TRUE(summary.usable());
    narrow += summary.is_within(1e-3) ? 1 : 0;
    // Of many starts, none ends below the bound.
    Rng rng(index);
    for (int i = 0; i < 10; ++i) {
      MatrixXd other = start + random_points(rng, 2, 49);
      const Summary found = solve("newton", system, other);
      EXPECT_LE(summary.lower_bound, found.final_energy * (1 + 1e-12)) << "system " << index;
    }
  }
  EXPECT_GE(narrow, 9);
}

// What is asked for proves more: the plane, or space, is divided around the nodes that leave it.
template <typename Springs>
void expect_narrower(int nodes, int systems, int gain) {
  int narrow = 0, before = 0;
  for (std::uint64_t index = 0; index < static_cast<std::uint64_t>(systems); ++index) {
    const auto [springs, start] =
        testing::numbered_system<Springs>(Kind::Track, Topology<>::full(nodes), 2000 + index);
    const System system = to_system(springs);
    MatrixXd x = start, y = start, z = start;
    AlignedOptions options;
    options.gap = 1e-3;
    const Summary summary = solve("staircase", system, x, options), plain = solve("staircase", system, y);
    EXPECT_NEAR(summary.final_energy, plain.final_energy, 1e-9 * plain.final_energy);
    EXPECT_EQ(summary.message == kProven, summary.is_within(options.gap));
    narrow += summary.is_within(options.gap) ? 1 : 0;
    before += plain.is_within(options.gap) ? 1 : 0;
    EXPECT_LE(summary.lower_bound, solve("multi-start", system, z).final_energy * (1 + 1e-12)) << index;
  }
  EXPECT_GE(narrow, before + gain);
}

// The climb ends where the bound suffices, however wide the interval may be.
TEST(Staircase, BoundsFromBelowForEveryGap) {
  for (const double gap : {0.3, 0.03, 1e-3, 1e-5}) {
    int steps = 0, plain_steps = 0, narrow = 0;
    for (std::uint64_t index = 0; index < 40; ++index) {
      const auto [springs, start] = testing::numbered_system<Plane>(index % 2 == 0 ? Kind::Track : Kind::Lit,
                                                                    Topology<>::full(36), index);
      const System system = to_system(springs);
      MatrixXd x = start, y = start, z = start;
      AlignedOptions options;
      options.gap = gap;
      const Summary summary = solve("staircase", system, x, options), plain = solve("staircase", system, y);
      ASSERT_TRUE(summary.usable()) << index;
      const double lowest = std::min(plain.final_energy, solve("multi-start", system, z).final_energy);
      EXPECT_LE(summary.lower_bound, lowest * (1 + 1e-12)) << index << ", gap " << gap;
      if (!summary.is_within(gap) || !plain.is_within(gap)) continue;
      EXPECT_GE(lowest, summary.final_energy * (1 - gap) * (1 - 1e-12)) << index << ", gap " << gap;
      ++narrow;
      steps += summary.iterations;
      plain_steps += plain.iterations;
    }
    EXPECT_GT(narrow, 0);
    EXPECT_LT(steps, plain_steps) << "gap " << gap;
  }
}

TEST(Staircase, DividesThePlane) {
  expect_narrower<Plane>(16, 100, 3);
  expect_narrower<Plane>(36, 50, 4);
  expect_narrower<SpringSystem<double, 3>>(27, 50, 0);
  expect_narrower<SpringSystem<double, 1>>(6, 50, 0);
}

TEST(Staircase, PassesOnWhatItsMethodSays) {
  const auto [springs, start] = testing::numbered_system<Plane>(Kind::Lit, Topology<>::full(6), 2);
  const System system = to_system(springs);
  MatrixXd x = start;
  StaircaseOptions options;
  options.tolerance = -1;
  EXPECT_EQ(solve_staircase(system, x, options).status, Status::InvalidInput);
  options = {};
  std::atomic<bool> stop = true;
  options.stop = &stop;
  EXPECT_EQ(solve_staircase(system, x, options).status, Status::Interrupted);
  EXPECT_EQ(x, start);
  options = {};
  options.max_iterations = 0;
  EXPECT_EQ(solve_staircase(system, x, options).status, Status::MaxIterations);
  MatrixXd again = start;
  solve_staircase(system, x);
  solve_staircase(system, again);
  EXPECT_EQ(again, x) << "the same bits";
}

// The caller of solve_global ends it so when the time is over.
TEST(Staircase, IsStoppedInMoreDimensions) {
  const auto [springs, start] = testing::numbered_system<Plane>(Kind::Lit, Topology<>::full(200), 1);
  const System system = to_system(springs);
  int lifted = 0;
  StaircaseOptions options;
  auto stop = [&lifted](const Iteration& at) {
    EXPECT_GT(at.x.rows(), 2);
    return ++lifted < 3;
  };
  options.on_lifted_iteration = stop;
  MatrixXd x = start, alone = start;
  const Summary summary = solve_staircase(system, x, options);
  EXPECT_EQ(lifted, 3);
  EXPECT_EQ(summary.final_energy, solve(system, alone).final_energy);
  EXPECT_EQ(x, alone);
}

// Of robust anchors, whose lower bound may be 0, too, nothing false is said; and it lowers the energy.
template <typename Springs>
void expect_true_bounds(int nodes) {
  int lifted = 0;
  for (std::uint64_t index = 0; index < 20; ++index) {
    auto [system, start] =
        testing::numbered_system<Springs>(Kind::Lit, Springs::TopologyType::full(nodes), index);
    system.anchor_loss.scale = 0.5 * characteristic_length(system, start);
    typename Springs::Points x = start, alone = start;
    const Summary plain = system_solver<Springs>("auto").solve(system, alone);
    const Summary summary = system_solver<Springs>("staircase").solve(system, x);
    EXPECT_LE(summary.final_energy, plain.final_energy);
    const double lowest = lowest_energy(system, start, 60, index);
    EXPECT_GE(summary.lower_bound, 0);
    EXPECT_LE(summary.lower_bound, lowest * (1 + 1e-9)) << index;
    if (summary.message == kProven) {
      EXPECT_LE(summary.final_energy, lowest * (1 + 1e-6)) << index;
    }
    lifted += summary.iterations > plain.iterations ? 1 : 0;
  }
  EXPECT_GT(lifted, 0);
}

TEST(Staircase, ClaimsNothingFalseOfRobustAnchors) {
  expect_true_bounds<testing::Hubers::System>(4);
  expect_true_bounds<testing::Gemans::System>(5);
}

Eigen::MatrixXi elements(Rng& rng, int nodes, int arity, int count) {
  Eigen::MatrixXi result(arity, count);
  for (int e = 0; e < count; ++e) {
    const int first = static_cast<int>(rng.uniform(0, nodes - 1e-9));
    const int step = static_cast<int>(rng.uniform(1, nodes / 2.0));
    for (int a = 0; a < arity; ++a) result(a, e) = (first + a * step) % nodes;
  }
  return result;
}

// Information that is not a multiple of the identity.
void shape(Rng& rng, Term& term) {
  term.values("information") = random_shapes(rng, term.dim(), term.size(), true);
}

// Every kind of term that is liftable, each in some of the systems; all of them have lower bounds of their
// curvature if `bounded`.
System mixture(Rng& rng, int dim, bool bounded) {
  constexpr int kNodes = 7;
  const auto sometimes = [&rng] { return rng.uniform(0, 1) < 0.4; };
  System system(kNodes, dim);
  Anchors& anchors =
      system.add_anchors(random_points(rng, dim, kNodes, 10), random_values(rng, kNodes, 0.02, 0.2));
  if (sometimes()) shape(rng, anchors);
  if (sometimes())
    system.add_anchors(random_points(rng, dim, kNodes, 10), System::all(0.05)).set_loss(Loss::Huber, 3);
  const Eigen::Matrix2Xi pairs = all_pairs(kNodes);
  Links& links = system.add_links(pairs, random_values(rng, pairs.cols(), 2, 15),
                                  random_values(rng, pairs.cols(), 0.1, 2));
  if (sometimes()) links.values("offset") = random_points(rng, dim, pairs.cols(), 3);
  if (sometimes()) shape(rng, links);
  if (sometimes()) {
    links.set_law(LinkLaw::Interval);
    links.values("upper") = links.values("length").array() + 2;
  }
  if (sometimes())
    system.add_links(elements(rng, kNodes, 2, 5), System::all(8), System::all(1)).set_law(LinkLaw::Repulsion);
  if (sometimes())
    system.add_links(elements(rng, kNodes, 2, 5), System::all(5), System::all(1)).set_law(LinkLaw::Rope);
  if (sometimes())
    system.add_bendings(elements(rng, kNodes, 3, 4), random_values(rng, 4, 1, 9), System::all(0.3));
  if (sometimes()) system.add_differences(elements(rng, kNodes, 3, 4), System::all(0.2));
  if (sometimes()) {
    Offsets& offsets =
        system.add_offsets(elements(rng, kNodes, 2, 4), random_points(rng, dim, 4, 5), System::all(0.4));
    if (sometimes()) shape(rng, offsets);
  }
  if (!bounded) {
    system.add_common_length(elements(rng, kNodes, 2, 5), System::all(0.5));
    if (dim > 1) system.add_angles(elements(rng, kNodes, 3, 3), System::all(1), System::all(2));
    links.set_loss(Loss::GemanMcClure, 3);
  }
  if (sometimes()) system.fix(2);
  return system;
}

TEST(Staircase, BoundsAnyMixtureFromBelow) {
  for (const bool bounded : {true, false}) {
    int positive_bounds = 0, lower = 0, proven = 0;
    for (const int dim : {1, 2, 3, 5}) {
      for (std::uint64_t seed = 1; seed <= 25; ++seed) {
        SCOPED_TRACE(::testing::Message() << "dimension " << dim << ", seed " << seed << " " << bounded);
        Rng rng(seed + 1000 * static_cast<std::uint64_t>(dim));
        const System system = mixture(rng, dim, bounded);
        const MatrixXd start = random_points(rng, dim, system.nodes(), 10);
        MatrixXd x = start, alone = start, best = start;
        AlignedOptions options;
        options.gap = seed % 2 == 0 ? 0 : 1e-3;
        const Summary summary = solve("staircase", system, x, options);
        ASSERT_TRUE(summary.usable()) << summary;
        EXPECT_EQ(summary.final_energy, energy(system, x));
        const double plain = solve(system, alone).final_energy;
        EXPECT_LE(summary.final_energy, plain);
        AnySolver<System> starts = system_solvers().make("multi-start", {{"starts", 60}});
        const double lowest = std::min(starts.solve(system, best).final_energy, summary.final_energy);
        EXPECT_GE(summary.lower_bound, 0);
        EXPECT_LE(summary.lower_bound, lowest * (1 + 1e-9));
        lower += summary.final_energy < plain * (1 - 1e-6) ? 1 : 0;
        positive_bounds += summary.lower_bound > 0.5 * summary.final_energy ? 1 : 0;
        if (!(summary.message == kProven)) continue;
        ++proven;
        EXPECT_LE(summary.final_energy, lowest * (1 + 2e-6 + options.gap));
      }
    }
    EXPECT_GT(lower, 10) << bounded;
    if (!bounded) continue;
    EXPECT_GT(positive_bounds, 60);
    EXPECT_GT(proven, 5);
  }
}

// Information that is a multiple of the identity is lifted as what it is: the links' lengths by it are
// shorter.
TEST(Staircase, TakesIsotropicInformationAsStiffness) {
  const auto [springs, start] = testing::numbered_system<Plane>(Kind::Lit, Topology<>::full(5), 3);
  const System system = to_system(springs);
  System shaped = system;
  shaped.term(1).values("length") *= std::sqrt(0.5);
  for (const int t : {0, 1}) {
    shaped.term(t).values("stiffness") *= 2;
    shaped.term(t).values("information") = Eigen::Vector4d(0.5, 0, 0, 0.5);
  }
  MatrixXd x = start, y = start;
  const Summary plain = solve("staircase", system, x), same = solve("staircase", shaped, y);
  EXPECT_NEAR(same.final_energy, plain.final_energy, 1e-9 * plain.final_energy);
  EXPECT_NEAR(same.lower_bound, plain.lower_bound, 1e-6 * plain.lower_bound);
}

TEST(Staircase, NamesTheTermThatIsNotLiftable) {
  const auto refusal = [](System system) {
    MatrixXd x = MatrixXd::Random(system.dim(), system.nodes());
    const MatrixXd start = x;
    const Summary summary = solve("staircase", system, x);
    EXPECT_EQ(summary.status, Status::InvalidInput);
    EXPECT_EQ(x, start);
    EXPECT_EQ(summary.solver, "staircase");
    return std::string(std::string_view(summary.message));
  };
  const auto anchored = [](int dim) {
    System system(3, dim);
    system.add_anchors(MatrixXd::Zero(dim, 3), System::all(1));
    return system;
  };
  System loads = anchored(2);
  loads.add_loads(Eigen::RowVectorXi::Constant(1, 1), Eigen::Vector2d(1, 1));
  EXPECT_EQ(refusal(loads), "loads: their energy has no lower bound");
  const Eigen::Matrix3Xi triple = Eigen::Vector3i(0, 1, 2);
  System areas = anchored(2);
  areas.add_areas(triple, System::all(1), System::all(1));
  EXPECT_EQ(refusal(areas), "areas: an area has a sign only in the plane");
  System turned = anchored(2);
  turned.add_differences(triple, System::all(1)).values("a") = Eigen::Vector4d(0, 1, -1, 0);
  EXPECT_EQ(refusal(turned), "differences: coefficients that are matrices cannot be given more dimensions");
  System own = anchored(2);
  own.add_elements(
      Eigen::MatrixXi(triple), [](const MatrixXd&, const MatrixXd&, bool, ElementValues&) {}, false);
  EXPECT_EQ(refusal(own), "elements: this kind of term cannot be given more dimensions");
  EXPECT_EQ(refusal(anchored(62)), "a system of more than 61 coordinates has no room for more");
  System most = anchored(61);
  MatrixXd x = MatrixXd::Constant(61, 3, 2);
  EXPECT_EQ(solve("staircase", most, x).status, Status::Converged);
  // Terms without elements ask for nothing.
  System none = anchored(2);
  none.add_loads(Eigen::RowVectorXi(0), MatrixXd(2, 0));
  MatrixXd y = MatrixXd::Ones(2, 3);
  EXPECT_EQ(solve("staircase", none, y).status, Status::Converged);
}

TEST(Staircase, IsMadeByName) {
  AnySolver<System> solver = system_solvers().make("staircase", {{"gap", 1e-3}});
  const auto [springs, start] = testing::numbered_system<Plane>(Kind::Track, Topology<>::full(4), 0);
  MatrixXd x = start;
  const Summary summary = solver.solve(to_system(springs), x);
  EXPECT_TRUE(summary.is_within(1e-3));
}

TEST(SolveGlobal, OfTermsTakesTheStaircaseOrManyStarts) {
  const auto [springs, start] = testing::numbered_system<Plane>(Kind::Lit, Topology<>::full(5), 3);
  System system = to_system(springs);
  MatrixXd x = start;
  Summary summary = solve_global(system, x);
  EXPECT_EQ(summary.solver, "staircase");
  EXPECT_LE(summary.final_energy, lowest_energy(springs, start, 40, 1) * (1 + 1e-3));
  system.add_loads(Eigen::RowVectorXi::Constant(1, 1), Eigen::Vector2d(1, 1));
  x = start;
  summary = solve_global(system, x);
  EXPECT_EQ(summary.solver, "multi-start");
  EXPECT_TRUE(summary.usable());
  GlobalOptions options;
  options.max_seconds = 0;
  x = start;
  summary = solve_global(system, x, options);
  EXPECT_EQ(summary.status, Status::MaxIterations) << summary;
  EXPECT_EQ(summary.message, "the limit of time was reached before the gap");
  options.max_seconds = -1;
  EXPECT_EQ(solve_global(system, x, options).message, "option max_seconds is negative or not a number");
  options = {};
  options.gap = 0;
  EXPECT_EQ(solve_global(system, x, options).message, "option gap is not positive");
}

}  // namespace
}  // namespace asterism
