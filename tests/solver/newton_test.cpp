#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/full_links.hpp>
#include <asterism/solver/energy/hessian.hpp>
#include <asterism/solver/energy/newton_matrix.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/method/ida.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/problem/model.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <cmath>
#include <limits>
#include <vector>

#include "listed_links.hpp"
#include "matrices.hpp"
#include "test_systems.hpp"

namespace asterism {
namespace {

using Fixed = testing::Fixed2;

template <typename System>
double least_eigenvalue(const System& system, const typename System::Points& x) {
  return testing::eigenvalues(hessian(system, x).template cast<double>())[0];
}

// Newton's matrix against the library's Hessian and Eigen's inverse. Where the compiled library's vectors
// fill it, energies are rounded in another way.
template <typename System>
void expect_like_eigen(int nodes, int systems, double scale = 1) {
  using Points = typename System::Points;
  using Vector = Eigen::VectorXd;
  testing::Rng rng(2);
  int definite = 0;
  for (int round = 0; round < systems; ++round) {
    const auto kind = testing::kKinds[static_cast<std::size_t>(round) % testing::kKinds.size()];
    auto [system, x] = testing::random_system<System>(rng, System::TopologyType::full(nodes), kind);
    x *= scale;
    system.anchors *= scale;
    system.rest_length *= scale;
    SCOPED_TRACE(::testing::Message() << nodes << " nodes, system " << round);
    detail::NewtonMatrix<System> matrix;
    matrix.reset(node_stiffness(system));
    Points gradient, expected_gradient, step, direction;
    const double E = matrix.assemble(system, x, false, gradient);
    const double expected_E = energy_and_gradient(system, x, expected_gradient);
    const double rounding = matrix.rounds_alike() ? 0 : 1e-13;
    EXPECT_NEAR(E, expected_E, rounding * expected_E);
    EXPECT_LE((gradient - expected_gradient).norm(),
              rounding * (expected_gradient.norm() + expected_E / scale));
    const auto H = hessian(system, x);
    const bool is_definite = testing::eigenvalues(H)[0] > 0;
    EXPECT_EQ(matrix.factorize(), is_definite);
    const Vector g = gradient.reshaped();
    if (is_definite) {
      ++definite;
      const double decrement = matrix.solve(step);
      const Vector p = testing::inverse(H) * g;
      EXPECT_LT((step.reshaped() - p).norm(), 1e-9 * p.norm());
      EXPECT_NEAR(decrement, g.dot(p), 1e-9 * decrement);
      EXPECT_EQ(matrix.negative_curvature(direction), 0);
      Points other;
      matrix.solve(gradient, other);
      EXPECT_LT((other - step).norm(), 1e-9 * step.norm());
    } else {
      const double curvature = matrix.negative_curvature(direction);
      EXPECT_LT(curvature, 0);
      const Vector v = direction.reshaped();
      EXPECT_LE(v.dot(H * v), curvature + 1e-8 * H.norm() * v.squaredNorm());
      EXPECT_GT(matrix.solve(step), 0);  // repaired: a descent direction
      EXPECT_GT(g.dot(step.reshaped()), 0);
    }
    matrix.assemble(system, x, true, gradient);
    EXPECT_TRUE(matrix.factorize());
  }
  EXPECT_GT(definite, systems / 10);
  EXPECT_LT(definite, systems);
}

TEST(NewtonMatrix, AgreesWithTheLibrarysHessianAndEigen) {
  expect_like_eigen<Fixed>(4, 200);
  expect_like_eigen<SpringSystem<double, 2, 6>>(6, 200);
  expect_like_eigen<testing::Bounded2>(7, 100);
  for (const int nodes : {2, 3, 5, 8, 9, 16, 17, 21, 40}) expect_like_eigen<testing::Plane>(nodes, 60);
  for (const int nodes : {2, 3, 5, 8, 11, 16, 30}) expect_like_eigen<SpringSystem<double, 3>>(nodes, 60);
  for (const double scale : {1e-120, 1e120}) expect_like_eigen<testing::Plane>(9, 60, scale);
}

// Compares the unrolled code path with the one with loops.
TEST(NewtonMatrix, SizesAgree) {
  testing::Rng rng(3);
  for (int round = 0; round < 50; ++round) {
    const auto [system, start] = testing::random_system<Fixed>(rng, Topology<4>::full());
    const auto check = [&, &fixed = system, &from = start]<typename Other>(std::type_identity<Other>) {
      Other other(Other::TopologyType::full(4));
      other.anchors = fixed.anchors;
      other.anchor_stiffness = fixed.anchor_stiffness;
      other.rest_length = fixed.rest_length;
      other.link_stiffness = fixed.link_stiffness;
      Fixed::Points x = from;
      typename Other::Points y = from;
      Newton(fixed).solve(fixed, x);
      Newton<Other>().solve(other, y);
      EXPECT_LT((x - y).norm(), 1e-7);
    };
    check(std::type_identity<testing::Plane>());
    check(std::type_identity<testing::Bounded2>());
  }
}

// The links of a few nodes that are fully linked, all at once, against the walk over springs one by one,
// which serves the same links given as a list.
template <typename System>
void expect_full_links_like_the_walk(int seeds) {
  using Scalar = typename System::Scalar;
  using Topology = typename System::TopologyType;
  constexpr int kNodes = System::kNodes, kSize = System::kDim * kNodes;
  using Vector = Eigen::Matrix<double, kSize, 1>;
  const Topology full = Topology::full();
  ASSERT_TRUE(detail::FullLinks<System>::kServes);
  testing::Rng rng(7);
  for (int seed = 0; seed < seeds; ++seed) {
    for (int hostile = 0; hostile < 7; ++hostile) {
      const auto kind = testing::kKinds[static_cast<std::size_t>(seed) % testing::kKinds.size()];
      auto [at_once, x] = testing::random_system<System>(rng, full, kind);
      const int last = at_once.link_count() - 1;
      switch (hostile) {
        case 1:  // links that are off, whatever their rest length
          at_once.link_stiffness[last] = 0;
          at_once.rest_length[last] = std::numeric_limits<Scalar>::max();
          break;
        case 2:
          at_once.rest_length.setZero();
          break;
        case 3:  // an anchor that means nothing
          at_once.anchor_stiffness[0] = 0;
          at_once.anchors.col(0).setConstant(std::sqrt(std::numeric_limits<Scalar>::max()));
          break;
        case 4:
          x.col(kNodes - 1) = x.col(0);
          break;
        case 5:  // whose square underflows
          x.col(0).setZero();
          x.col(1).setConstant(std::sqrt(std::numeric_limits<Scalar>::min()) / 4);
          break;
        case 6:
          at_once.fix(0);
          break;
        default:
          break;
      }
      const System one_by_one = testing::with_listed_links(at_once);
      ASSERT_TRUE(detail::FullLinks<System>::serve(at_once));
      ASSERT_FALSE(detail::FullLinks<System>::serve(one_by_one));

      typename System::Points g, expected_g;
      const Scalar E = energy_and_gradient(at_once, x, g);
      const Scalar expected_E = energy_and_gradient(one_by_one, x, expected_g);
      EXPECT_EQ(E, expected_E);
      EXPECT_EQ(g, expected_g);
      EXPECT_EQ(E, energy(at_once, x));
      const double rounding = detail::NewtonMatrix<System>::rounds_alike() ? 0 : 1e-14;
      const auto A = node_stiffness(at_once), expected_A = node_stiffness(one_by_one);
      EXPECT_LE((A - expected_A).norm(), 8 * std::numeric_limits<Scalar>::epsilon() * A.norm());
      for (const bool clamp : {false, true}) {
        detail::NewtonMatrix<System> matrix, expected;
        matrix.reset(A);
        expected.reset(A);
        EXPECT_NEAR(matrix.assemble(at_once, x, clamp, g), expected_E, rounding * double(expected_E));
        EXPECT_EQ(expected.assemble(one_by_one, x, clamp, expected_g), expected_E);
        EXPECT_LE((g - expected_g).norm(), rounding * (double(expected_E) + expected_g.norm()));
        EXPECT_EQ(matrix.factorize(), expected.factorize());
        typename System::Points step, expected_step;
        matrix.solve(step);
        expected.solve(expected_step);
        const Vector p = step.template cast<double>().reshaped(),
                     q = expected_step.template cast<double>().reshaped();
        EXPECT_LE((p - q).norm(), (sizeof(Scalar) == 4 ? 1e-2 : 1e-7) * q.norm()) << seed << " " << hostile;
      }
    }
  }
}

TEST(NewtonMatrix, FullLinksAreLikeTheWalkOverSprings) {
  expect_full_links_like_the_walk<SpringSystem<double, 2, 2>>(40);
  expect_full_links_like_the_walk<SpringSystem<double, 2, 4>>(40);
  expect_full_links_like_the_walk<SpringSystem<double, 2, 5>>(40);
  expect_full_links_like_the_walk<SpringSystem<double, 3, 4>>(40);
  expect_full_links_like_the_walk<SpringSystem<float, 3, 4>>(40);
  expect_full_links_like_the_walk<SpringSystem<double, 1, 3>>(40);
  expect_full_links_like_the_walk<SpringSystem<float, 2, 4>>(40);
  expect_full_links_like_the_walk<SpringSystem<double, 2, 3, 3, Model<Rope, Huber>>>(40);
}

struct Tally {
  int same = 0;
  int converged = 0;
  std::vector<int> evaluations;
  int percentile(double p) {
    std::sort(evaluations.begin(), evaluations.end());
    return evaluations[static_cast<std::size_t>(p * static_cast<double>(evaluations.size() - 1))];
  }
};

Tally against_ida(testing::Kind kind, int systems) {
  testing::Rng rng(4);
  Newton<Fixed> newton;
  Ida<Fixed> ida;
  Tally tally;
  for (int round = 0; round < systems; ++round) {
    const auto [system, start] = testing::random_system<Fixed>(rng, Topology<4>::full(), kind);
    auto x = start;
    auto y = start;
    const Summary summary = newton.solve(system, x);
    const Summary by_ida = ida.solve(system, y);
    EXPECT_LE(summary.final_energy, summary.initial_energy);
    EXPECT_EQ(summary.positive_definite, true) << summary;
    EXPECT_GT(least_eigenvalue(system, x), 0);
    tally.converged += summary.status == Status::Converged;
    tally.same += std::abs(summary.final_energy - by_ida.final_energy) <= 1e-6 * by_ida.final_energy;
    tally.evaluations.push_back(summary.gradient_evaluations);
  }
  return tally;
}

TEST(Newton, ReachesIdasMinimumInFewEvaluations) {
  auto lit = against_ida(testing::Kind::Lit, 1000);
  EXPECT_EQ(lit.converged, 1000);
  EXPECT_GE(lit.same, 990);
  EXPECT_LE(lit.percentile(0.5), 8);
  auto track = against_ida(testing::Kind::Track, 1000);
  EXPECT_EQ(track.converged, 1000);
  EXPECT_GE(track.same, 990);
  EXPECT_LE(track.percentile(0.5), 4);
  EXPECT_LE(track.percentile(0.95), 6);
}

TEST(Newton, WeakAnchorsCostLittle) {
  for (const double weakness : {1e-4, 1e-6, 1e-8, 1e-10, 1e-12}) {
    testing::Rng rng(5);
    Newton<Fixed> newton;
    Tally tally;
    for (int round = 0; round < 500; ++round) {
      auto [system, x] = testing::random_system<Fixed>(rng, Topology<4>::full());
      system.anchor_stiffness *= weakness;
      const Summary summary = newton.solve(system, x);
      tally.converged += summary.status == Status::Converged;
      tally.evaluations.push_back(summary.gradient_evaluations);
      Newton<Fixed> finer;
      finer.options.tolerance = 1e-14;
      auto y = x;
      const Summary polished = finer.solve(system, y);
      EXPECT_LE(summary.final_energy, polished.final_energy * (1 + 1e-6));
    }
    EXPECT_EQ(tally.converged, 500) << weakness;
    EXPECT_LE(tally.percentile(0.5), 13) << weakness;
    EXPECT_LE(tally.percentile(0.95), 32) << weakness;
  }
}

TEST(Newton, EnergyFallsFromIterationToIteration) {
  for (const auto kind : {testing::Kind::Lit, testing::Kind::Disp}) {
    testing::Rng rng(6);
    for (int round = 0; round < 100; ++round) {
      const auto [system, start] = testing::random_system<Fixed>(rng, Topology<4>::full(), kind);
      double last = energy(system, start);
      for (int count = 1; count < 12; ++count) {
        Newton<Fixed> newton;
        newton.options.max_iterations = count;
        auto x = start;
        const Summary summary = newton.solve(system, x);
        EXPECT_LE(summary.final_energy, last * (1 + 1e-13));
        EXPECT_LE(summary.iterations, count);
        last = summary.final_energy;
      }
    }
  }
}

template <typename System>
class NewtonOf : public ::testing::Test {};
using Systems =
    ::testing::Types<testing::Fixed2f, SpringSystem<double, 3, 4>, testing::Plane, testing::Bounded3f>;
TYPED_TEST_SUITE(NewtonOf, Systems);

TYPED_TEST(NewtonOf, EverySizeAndScalarReachesStrictMinima) {
  constexpr bool kDouble = std::is_same_v<typename TypeParam::Scalar, double>;
  constexpr int kSize = TypeParam::kNodes == Eigen::Dynamic ? 6 : TypeParam::kNodes;
  testing::Rng rng(7);
  Newton<TypeParam> newton;
  int converged = 0;
  for (int round = 0; round < 100; ++round) {
    const auto [system, start] = testing::random_system<TypeParam>(rng, TypeParam::TopologyType::full(kSize));
    auto x = start;
    const Summary summary = newton.solve(system, x);
    EXPECT_TRUE(summary.usable()) << summary;
    converged += summary.status == Status::Converged;
    EXPECT_LE(summary.final_energy, summary.initial_energy);
    EXPECT_EQ(summary.final_energy, double(energy(system, x)));
    EXPECT_EQ(summary.gradient_norm, gradient(system, x).template cast<double>().norm());
    if (summary.status == Status::Converged) {
      EXPECT_EQ(summary.positive_definite, true);
      EXPECT_GT(least_eigenvalue(system, x), 0);
    }
  }
  EXPECT_GE(converged, kDouble ? 100 : 98);
}

TYPED_TEST(NewtonOf, ZeroRestLengthsAreAQuadratic) {
  constexpr int kSize = TypeParam::kNodes == Eigen::Dynamic ? 6 : TypeParam::kNodes;
  testing::Rng rng(8);
  auto [system, x] = testing::random_system<TypeParam>(rng, TypeParam::TopologyType::full(kSize));
  system.rest_length.setZero();
  const Summary summary = Newton<TypeParam>().solve(system, x);
  EXPECT_EQ(summary.status, Status::Converged) << summary;
  EXPECT_LE(summary.iterations, 2);
}

TYPED_TEST(NewtonOf, CoincidentNodesPart) {
  constexpr int kSize = TypeParam::kNodes == Eigen::Dynamic ? 6 : TypeParam::kNodes;
  testing::Rng rng(9);
  for (int round = 0; round < 20; ++round) {
    auto [system, x] = testing::random_system<TypeParam>(rng, TypeParam::TopologyType::full(kSize));
    x.colwise() = x.col(0).eval();
    const Summary summary = Newton<TypeParam>().solve(system, x);
    EXPECT_TRUE(summary.usable()) << summary;
    EXPECT_LT(summary.final_energy, summary.initial_energy);
    system.anchors.setConstant(5);  // only the node numbers distinguish them
    x = system.anchors;
    const Summary collapsed = Newton<TypeParam>().solve(system, x);
    EXPECT_TRUE(collapsed.usable()) << collapsed;
    EXPECT_TRUE(x.allFinite());
    EXPECT_LT(collapsed.final_energy, collapsed.initial_energy);
  }
}

// Collinear in the wrong order: IDA cannot leave the line.
TEST(Newton, LeavesTheLineThatIdaStaysOn) {
  Fixed system(Topology<4>::full());
  system.anchors << 0, 10, 20, 30, 0, 0, 0, 0;
  system.anchor_stiffness.setConstant(0.01);
  Fixed::Points square;
  square << 0, 20, 20, 0, 0, 0, 20, 20;
  system.set_rest_lengths(square);
  system.link_stiffness.setOnes();
  Fixed::Points x = system.anchors;
  const Summary ida = solve_ida(system, x);
  ASSERT_EQ(ida.status, Status::Converged);
  EXPECT_EQ(ida.positive_definite, std::nullopt);
  EXPECT_LT(least_eigenvalue(system, x), -0.1);

  // From the line and from the saddle itself, with the same result every time.
  for (const Fixed::Points& start : {system.anchors, x}) {
    Fixed::Points y = start;
    const Summary newton = Newton(system).solve(system, y);
    EXPECT_EQ(newton.status, Status::Converged) << newton;
    EXPECT_EQ(newton.positive_definite, true);
    EXPECT_LT(newton.final_energy, 0.2 * ida.final_energy);
    EXPECT_GT(least_eigenvalue(system, y), 0);
    Fixed::Points again = start;
    Newton(system).solve(system, again);
    EXPECT_EQ(again, y);
  }

  NewtonOptions options;
  options.escape_saddles = false;
  Fixed::Points y = x;
  const Summary kept = Newton(system, options).solve(system, y);
  EXPECT_EQ(kept.status, Status::Converged);
  EXPECT_EQ(kept.positive_definite, false);
  EXPECT_EQ(y, x);
}

// Two nodes in reverse order between their anchors: the counterexample to convexity.
TEST(Newton, LeavesTheSaddleOfTwoNodes) {
  SpringSystem<double, 2> system(Topology<>::full(2));
  system.anchors << -0.1, 0.1, 0, 0;
  system.anchor_stiffness.setConstant(0.01);
  system.rest_length.setOnes();
  system.link_stiffness.setOnes();
  Eigen::Matrix2Xd x(2, 2);
  x << 0.5, -0.5, 0, 0;
  NewtonOptions options;
  options.align = false;
  const Summary summary = Newton(system, options).solve(system, x);
  EXPECT_EQ(summary.status, Status::Converged) << summary;
  EXPECT_EQ(summary.positive_definite, true);
  EXPECT_NEAR(summary.final_energy, 0.0016, 1e-4);
}

TEST(Newton, FlatDirectionsAreNoSaddles) {
  SpringSystem<double, 2> system(Topology<>::full(2));  // two nodes on one anchor: a circle of minimisers
  system.anchors.setZero();
  system.anchor_stiffness.setOnes();
  system.rest_length.setOnes();
  system.link_stiffness.setOnes();
  Eigen::Matrix2Xd x(2, 2);
  x << 0.2, -0.3, 0.1, 0.2;
  const Summary summary = Newton(system).solve(system, x);
  EXPECT_EQ(summary.status, Status::Converged) << summary;
  EXPECT_NEAR(summary.final_energy, 1.0 / 6, 1e-9);
}

TEST(Newton, MovesWithTheSystem) {
  testing::Rng rng(10);
  for (int round = 0; round < 20; ++round) {
    auto [system, start] = testing::random_system<Fixed>(rng, Topology<4>::full());
    Fixed::Points minimum = start;
    solve_ida(system, minimum);
    start = minimum + testing::random_points<Fixed>(rng, 4, -0.02, 0.02);
    auto x = start;
    const Summary summary = Newton(system).solve(system, x);
    for (const double s : {1e-6, 1e5}) {
      auto scaled = system;
      scaled.anchors *= s;
      scaled.rest_length *= s;
      Fixed::Points y = start * s;
      EXPECT_EQ(Newton(scaled).solve(scaled, y).iterations, summary.iterations);
      EXPECT_LT((y - x * s).norm(), 1e-6 * s);
      auto stiff = system;
      stiff.anchor_stiffness *= s;
      stiff.link_stiffness *= s;
      y = start;
      EXPECT_EQ(Newton(stiff).solve(stiff, y).iterations, summary.iterations);
      EXPECT_LT((y - x).norm(), 1e-6);
    }
    Eigen::Matrix2d rotation;
    rotation << 0.28, -0.96, 0.96, 0.28;
    auto moved = system;
    moved.anchors = (rotation * system.anchors).array() + 4;
    Fixed::Points y = (rotation * start).array() + 4;
    EXPECT_NEAR(Newton(moved).solve(moved, y).iterations, summary.iterations, 1);
    EXPECT_LT((y - Fixed::Points((rotation * x).array() + 4)).norm(), 1e-6);
  }
}

TEST(Newton, AlignmentMirrorsOnlyIfAllowed) {
  testing::Rng rng(11);
  auto [system, start] = testing::random_system<Fixed>(rng, Topology<4>::full());
  system.anchor_stiffness *= 1e-4;
  system.set_rest_lengths(system.anchors);
  Fixed::Points mirrored = system.anchors;
  mirrored.row(0) *= -1;
  NewtonOptions options;
  Fixed::Points x = mirrored;
  EXPECT_GT(Newton(system, options).solve(system, x).final_energy, 1e-6);
  options.allow_reflection = true;
  x = mirrored;
  EXPECT_LT(Newton(system, options).solve(system, x).final_energy, 1e-15);
}

TEST(Newton, BadInputLeavesXAlone) {
  testing::Rng rng(12);
  const auto [good, start] = testing::random_system<Fixed>(rng, Topology<4>::full());
  Newton<Fixed> newton;
  for (int what = 0; what < 6; ++what) {
    auto system = good;
    auto x = start;
    Newton<Fixed>& solver = newton;
    solver.options = NewtonOptions();
    if (what == 0) system.link_stiffness[2] = -1;
    if (what == 1) system.anchors(0, 1) = std::numeric_limits<double>::quiet_NaN();
    if (what == 2) system.anchor_stiffness.setZero();
    if (what == 3) solver.options.tolerance = -1;
    if (what == 4) solver.options.max_iterations = -1;
    if (what == 5) system.rest_length[0] = std::numeric_limits<double>::infinity();
    const Summary summary = solver.solve(system, x);
    EXPECT_EQ(summary.status, Status::InvalidInput) << what;
    EXPECT_EQ(summary.positive_definite, std::nullopt);
    EXPECT_EQ(x, start);
  }
  for (int what = 0; what < 4; ++what) {
    constexpr double kHuge = std::numeric_limits<double>::max() / 2;
    auto system = good;
    auto x = start;
    newton.options = NewtonOptions();
    if (what == 0) system.anchors.setConstant(kHuge);
    if (what == 1) system.rest_length.setConstant(kHuge);
    if (what == 2) system.link_stiffness.setConstant(kHuge);
    if (what == 3) x *= kHuge;
    const auto before = x;
    EXPECT_EQ(newton.solve(system, x).status, Status::NumericalFailure) << what;
    EXPECT_EQ(x, before);
  }
}

TEST(Newton, IterationLimits) {
  testing::Rng rng(13);
  const auto [system, start] = testing::random_system<Fixed>(rng, Topology<4>::full());
  Newton<Fixed> newton;
  newton.options.max_iterations = 0;
  auto x = start;
  Summary summary = newton.solve(system, x);
  EXPECT_EQ(summary.status, Status::MaxIterations);
  EXPECT_EQ(x, start);
  newton.options.max_iterations = 2;
  summary = newton.solve(system, x);
  EXPECT_EQ(summary.status, Status::MaxIterations);
  EXPECT_EQ(summary.iterations, 2);
  EXPECT_EQ(summary.positive_definite, std::nullopt);
}

TEST(Newton, StaysAtAStationaryPoint) {
  testing::Rng rng(14);
  auto [system, start] = testing::random_system<Fixed>(rng, Topology<4>::full());
  system.set_rest_lengths(system.anchors);
  Fixed::Points x = system.anchors;
  const Summary summary = Newton(system).solve(system, x);
  EXPECT_EQ(summary.status, Status::Converged);
  EXPECT_EQ(summary.iterations, 0);
  EXPECT_EQ(summary.positive_definite, true);
  EXPECT_EQ(x, system.anchors);
}

TEST(Newton, ExtremesOfStiffness) {
  testing::Rng rng(15);
  for (int round = 0; round < 50; ++round) {
    const auto [system, start] = testing::random_system<Fixed>(rng, Topology<4>::full());
    for (const double factor : {1e-25, 1e-16, 1e12}) {
      auto extreme = system;
      extreme.anchor_stiffness *= factor;
      auto x = start;
      const Summary summary = Newton(extreme).solve(extreme, x);
      EXPECT_TRUE(summary.usable()) << summary;
      EXPECT_TRUE(x.allFinite());
      EXPECT_LE(summary.final_energy, summary.initial_energy);
    }
    auto stiff = system;
    stiff.link_stiffness[0] = 1e14;
    stiff.rest_length[0] = 1e-6;
    auto x = start;
    EXPECT_TRUE(Newton(stiff).solve(stiff, x).usable());
  }
}

TEST(Newton, OneNodeAndNoLinks) {
  SpringSystem<double, 2, 1> system(Topology<1>::full());
  system.anchors << 3, 4;
  system.anchor_stiffness.setOnes();
  SpringSystem<double, 2, 1>::Points x;
  x << -1, 7;
  EXPECT_EQ(Newton(system).solve(system, x).status, Status::Converged);
  EXPECT_LT((x - system.anchors).norm(), 1e-12);
}

TEST(Newton, TakesTheOptionsOfAlignedMethods) {
  AlignedOptions options;
  options.align = false;
  options.allow_reflection = true;
  const NewtonOptions taken = options;
  EXPECT_FALSE(taken.align);
  EXPECT_TRUE(taken.allow_reflection);
}

TEST(IdaRelaxation, IsMonotoneAndFaster) {
  testing::Rng rng(16);
  long plain_iterations = 0;
  long relaxed_iterations = 0;
  for (int round = 0; round < 50; ++round) {
    const auto [system, start] = testing::random_system<Fixed>(rng, Topology<4>::full());
    for (const double w : {0.3, 1.5, 1.95}) {
      double last = energy(system, start);
      for (int count = 1; count < 8; ++count) {
        Ida<Fixed> ida;
        ida.options.relaxation = w;
        ida.options.max_iterations = count;
        auto x = start;
        const double next = ida.solve(system, x).final_energy;
        EXPECT_LE(next, last * (1 + 1e-13));
        last = next;
      }
    }
    IdaOptions options;
    auto x = start;
    plain_iterations += Ida(system, options).solve(system, x).iterations;
    options.relaxation = 1.7;
    x = start;
    const Summary summary = Ida(system, options).solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged);
    relaxed_iterations += summary.iterations;
  }
  EXPECT_LT(relaxed_iterations, plain_iterations * 3 / 4);
}

TEST(IdaRelaxation, OutOfRangeIsRefused) {
  testing::Rng rng(17);
  const auto [system, start] = testing::random_system<Fixed>(rng, Topology<4>::full());
  for (const double w : {0.0, -1.0, 2.0, std::nan("")}) {
    IdaOptions options;
    options.relaxation = w;
    auto x = start;
    const Summary summary = Ida(system, options).solve(system, x);
    EXPECT_EQ(summary.status, Status::InvalidInput);
    EXPECT_EQ(summary.message, "option relaxation is not between 0 and 2");
    EXPECT_EQ(x, start);
  }
}

}  // namespace
}  // namespace asterism
