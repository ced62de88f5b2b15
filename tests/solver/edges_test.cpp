// Odd inputs that have a defined result, as docs/solver.md promises under "Edge cases", with Ida, Newton,
// Lbfgs, NewtonCg and Auto.
#include <gtest/gtest.h>

#include <asterism/solver.hpp>
#include <asterism/solver/terms/from_springs.hpp>
#include <cmath>
#include <concepts>
#include <limits>
#include <sstream>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "by_terms.hpp"
#include "matrices.hpp"
#include "test_systems.hpp"

namespace asterism {
namespace {

using System = SpringSystem<double, 2>;
using Points = System::Points;

template <typename S>
class Edges : public ::testing::Test {
 public:
  static Summary solve(const System& system, Points& x, const SolverOptions& options = {}) {
    S solver;
    static_cast<SolverOptions&>(solver.options) = options;
    return solver.solve(system, x);
  }
};
template <typename Solver>
constexpr bool kIsOfTerms = std::is_same_v<Solver, testing::SparseNewton<System>> ||
                            std::is_same_v<Solver, testing::NewtonCg<System>>;

using Solvers = ::testing::Types<Ida<System>, Newton<System>, Lbfgs<System>, testing::NewtonCg<System>,
                                 testing::SparseNewton<System>, Auto<System>>;
TYPED_TEST_SUITE(Edges, Solvers);

testing::RandomSystem<System> random(std::uint64_t seed, int n = 5) {
  testing::Rng rng(seed);
  return testing::random_system<System>(rng, Topology<>::full(n));
}

// Checks that the solve converged at a stationary point no higher than the start.
void expect_solved(const System& system, const Points& x, const Summary& summary) {
  EXPECT_EQ(summary.status, Status::Converged) << summary;
  EXPECT_TRUE(x.allFinite());
  EXPECT_LE(summary.final_energy, summary.initial_energy * (1 + 1e-12));
  EXPECT_NEAR(summary.final_energy, energy(system, x), 1e-12 * summary.initial_energy);
}

TYPED_TEST(Edges, CoincidentNodesPart) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    auto [system, start] = random(seed);
    start.col(1) = start.col(0);
    system.anchors.col(1) = system.anchors.col(0);
    Points x = start;
    expect_solved(system, x, TestFixture::solve(system, x));
    EXPECT_GT((x.col(0) - x.col(1)).norm(), 1e-6);
  }
}

TYPED_TEST(Edges, AllNodesOnOnePointSpread) {
  auto [system, start] = random(1);
  start.setConstant(3);
  system.anchors.setConstant(3);
  Points x = start;
  expect_solved(system, x, TestFixture::solve(system, x));
  EXPECT_LT(energy(system, x), 0.9 * energy(system, start));
}

TYPED_TEST(Edges, ZeroRestLengthsPullTogether) {
  auto [system, start] = random(2);
  system.rest_length.setZero();
  Points x = start;
  expect_solved(system, x, TestFixture::solve(system, x));
  // The problem is convex and linear: K_dyn x = k a.
  Eigen::MatrixXd K = system.anchor_stiffness.asDiagonal();
  for (int l = 0; const Link& link : system.links()) {
    const double k = system.link_stiffness[l++];
    K(link.i, link.i) += k, K(link.j, link.j) += k, K(link.i, link.j) -= k, K(link.j, link.i) -= k;
  }
  const Points expected =
      testing::solve_definite(K, (system.anchors * system.anchor_stiffness.asDiagonal()).transpose())
          .transpose();
  EXPECT_LT((x - expected).cwiseAbs().maxCoeff(), 1e-6);
}

TYPED_TEST(Edges, LinksWithoutStiffnessLeaveNodesToTheirAnchors) {
  auto [system, start] = random(3);
  system.link_stiffness.setZero();
  Points x = start;
  expect_solved(system, x, TestFixture::solve(system, x));
  EXPECT_LT((x - system.anchors).cwiseAbs().maxCoeff(), 1e-7);
}

TYPED_TEST(Edges, StiffnessFromTheSmallestToTheLargest) {
  for (const double unit : {1e-12, 1.0, 1e14}) {  // for all springs: makes no difference
    auto [system, start] = random(4);
    Points expected = start;
    expect_solved(system, expected, TestFixture::solve(system, expected));
    system.anchor_stiffness *= unit;
    system.link_stiffness *= unit;
    Points x = start;
    expect_solved(system, x, TestFixture::solve(system, x));
    EXPECT_LT((x - expected).cwiseAbs().maxCoeff(), 1e-5) << unit;
  }
  for (const double factor : {1e-12, 1e14}) {  // for one spring
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
      auto [system, start] = random(seed);
      system.link_stiffness[0] *= factor;
      Points x = start;
      const Summary summary = TestFixture::solve(system, x);
      EXPECT_TRUE(summary.usable()) << summary;
      EXPECT_LE(summary.final_energy, summary.initial_energy);
      EXPECT_TRUE(x.allFinite());
    }
  }
}

TYPED_TEST(Edges, ComponentsWithoutAnchorAreRefusedOrGrounded) {
  System system(Topology<>::from_links(5, std::vector<Link>{{0, 1}, {2, 3}, {3, 4}, {2, 4}}));
  system.anchors.setZero();
  system.anchor_stiffness << 1, 0, 0, 0, 0;
  system.rest_length.setConstant(1);
  system.link_stiffness.setOnes();
  Points start(2, 5);
  start << 0, 2, 10, 12, 11, 0.1, 0, 5, 5.2, 7;
  Points x = start;
  Summary summary = TestFixture::solve(system, x);
  EXPECT_EQ(summary.status, Status::InvalidInput);
  EXPECT_TRUE(std::string_view(summary.message).starts_with("node 2 is in a connected component "))
      << summary;
  EXPECT_EQ(x, start);

  SolverOptions options;
  options.hold_floating = true;
  summary = TestFixture::solve(system, x, options);
  expect_solved(system, x, summary);
  EXPECT_NEAR(summary.final_energy, 0, 1e-10);
  EXPECT_EQ(x.col(2), start.col(2));
}

TYPED_TEST(Edges, NothingButAFloatingConstellation) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    auto [system, start] = random(seed);
    system.anchor_stiffness.setZero();
    SolverOptions options;
    options.hold_floating = true;
    Points x = start;
    expect_solved(system, x, TestFixture::solve(system, x, options));
    EXPECT_EQ(x.col(0), start.col(0));
    EXPECT_LT((x - start).cwiseAbs().maxCoeff(), 5);  // it does not diverge
  }
}

TYPED_TEST(Edges, IsolatedNodesGoToTheirAnchors) {
  System system(Topology<>::from_links(3, std::vector<Link>{{0, 1}}));
  system.anchors << 0, 5, 9, 0, 0, 9;
  system.anchor_stiffness << 1, 1, 1e-3;
  system.rest_length.setConstant(5);
  system.link_stiffness.setOnes();
  Points x = Points::Ones(2, 3);
  x(0, 1) = 2;
  expect_solved(system, x, TestFixture::solve(system, x));
  EXPECT_LT((x - system.anchors).cwiseAbs().maxCoeff(), 1e-5);
}

TYPED_TEST(Edges, OneNodeAndNoLinks) {
  System system(Topology<>::full(1));
  system.anchors << 3, 4;
  system.anchor_stiffness << 2;
  for (const double start : {0.0, 1e6, 1e18}) {
    Points x = Points::Constant(2, 1, start);
    expect_solved(system, x, TestFixture::solve(system, x));
    EXPECT_LT((x - system.anchors).norm(), 1e-7) << start;
  }
}

TYPED_TEST(Edges, DuplicateLinksAddUp) {
  auto [system, start] = random(6, 3);
  System doubled(Topology<>::from_links(3, std::vector<Link>{{0, 1}, {0, 2}, {1, 2}, {2, 1}}));
  doubled.anchors = system.anchors;
  doubled.anchor_stiffness = system.anchor_stiffness;
  doubled.rest_length << system.rest_length, system.rest_length[2];
  doubled.link_stiffness << system.link_stiffness[0], system.link_stiffness[1],
      0.25 * system.link_stiffness[2], 0.75 * system.link_stiffness[2];
  Points x = start, y = start;
  expect_solved(system, x, TestFixture::solve(system, x));
  expect_solved(doubled, y, TestFixture::solve(doubled, y));
  EXPECT_LT((x - y).cwiseAbs().maxCoeff(), 1e-6);
}

TYPED_TEST(Edges, BadInputIsNamedAndCostsNothing) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  const auto refused = [](auto&& spoil) {
    auto [system, start] = random(7);
    spoil(system, start);
    Points x = start;
    const Summary summary = TestFixture::solve(system, x);
    EXPECT_EQ(summary.status, Status::InvalidInput);
    EXPECT_TRUE((x.array() == start.array() || start.array().isNaN()).all());
    return std::string(std::string_view(summary.message));
  };
  EXPECT_EQ(refused([&](System& s, Points&) { s.anchors(1, 3) = nan; }), "anchor 3 is not finite");
  EXPECT_EQ(refused([&](System& s, Points&) { s.anchor_stiffness[2] = -1; }),
            "anchor stiffness 2 is negative or not finite");
  EXPECT_EQ(refused([&](System& s, Points&) { s.rest_length[4] = -1e-9; }),
            "rest length 4 is negative or not finite");
  EXPECT_EQ(refused([&](System& s, Points&) { s.link_stiffness[9] = infinity; }),
            "link stiffness 9 is negative or not finite");
  EXPECT_EQ(refused([&](System&, Points& x) { x(0, 4) = nan; }), "x of node 4 is not finite");
  EXPECT_EQ(refused([&](System& s, Points& x) {
              s = System(Topology<>::from_links(2, std::vector<Link>{{1, 1}}));
              x.resize(2, 2);
              x.setZero();
            }),
            "link 0 joins a node to itself");
  EXPECT_EQ(refused([&](System& s, Points& x) {
              s = System(Topology<>::full(0));
              x.resize(2, 0);
            }),
            "system has no nodes");
}

// Rods between anchors in reverse order start in equilibrium at a saddle. The way out is then searched before
// any step, with a new workspace or that of a smaller system.
TEST(SaddleAsStart, IsLeftByNewtonWithAnyWorkspace) {
  const auto rod = [](int rods) {
    std::vector<Link> links;
    for (int i = 0; i < rods; ++i) links.push_back({2 * i, 2 * i + 1});
    System system(Topology<>::from_links(2 * rods, links));
    for (int i = 0; i < rods; ++i) {
      system.anchors.col(2 * i) << -1, 20 * i;
      system.anchors.col(2 * i + 1) << 1, 20 * i;
    }
    system.anchor_stiffness.setOnes();
    system.link_stiffness.setOnes();
    system.rest_length.setConstant(10);
    return system;
  };
  Newton<System> solver;
  for (const int rods : {1, 2, 8, 3}) {
    const System system = rod(rods);
    Points x = -3 * system.anchors;  // equilibrium: s (1 + 2 k) = k mu - 1
    x.row(1) = system.anchors.row(1);
    const Summary summary = solver.solve(system, x);
    expect_solved(system, x, summary);
    EXPECT_LT(summary.final_energy, summary.initial_energy - 1) << rods;
  }
}

// Steps of IDA and of Newton's method stay on the line of a collinear start; the search for negative
// curvature leaves it.
TEST(CollinearStart, IsLeftByNewtonAndSeenByItsSummary) {
  System system(Topology<>::full(3));
  system.anchors << 0, 0.4, 1, 0, 0, 0;
  system.anchor_stiffness.setConstant(0.05);
  system.rest_length.setConstant(1);
  system.link_stiffness.setOnes();
  const Points start = system.anchors;

  Points by_ida = start;
  const Summary ida = Ida<System>().solve(system, by_ida);
  EXPECT_EQ(ida.status, Status::Converged);
  EXPECT_EQ(ida.positive_definite, std::nullopt);  // not examined
  EXPECT_EQ(by_ida.row(1).norm(), 0);

  Points held = start;
  Newton<System> newton;
  newton.options.escape_saddles = false;
  const Summary saddle = newton.solve(system, held);
  EXPECT_EQ(saddle.positive_definite, false);

  Points x = start;
  for (const Summary& summary : {Newton<System>().solve(system, x), Auto<System>().solve(system, x)}) {
    EXPECT_EQ(summary.status, Status::Converged);
    EXPECT_EQ(summary.positive_definite, true);
    EXPECT_LT(summary.final_energy, 0.5 * ida.final_energy);
  }
}

// Two coincident nodes with a rest length between them, each held there by a spring to a fixed node: by the
// convention for coincident nodes the gradient vanishes and the Hessian is positive definite, although this
// is a conic peak.
TEST(ConicPeak, IsNoLocalMinimum) {
  const std::vector<Link> links{{0, 1}, {0, 2}, {1, 3}};
  System system(Topology<>::from_links(4, links));
  system.anchors << 1, -1, -3, 3, 0, 0, 0, 0;
  system.anchor_stiffness << 1, 1, 0, 0;
  system.rest_length << 2, 0, 0;
  system.link_stiffness.setOnes();
  system.fix(2);
  system.fix(3);
  Points peak = system.anchors;
  peak.leftCols(2).setZero();
  ASSERT_EQ(gradient(system, peak).norm(), 0);
  const Points at = peak;
  Newton<System> newton;
  newton.options.escape_saddles = false;
  const Summary held = newton.solve(system, peak);
  EXPECT_EQ(held.status, Status::Converged);
  EXPECT_EQ(held.positive_definite, false);
  EXPECT_EQ(peak, at);
  const auto expect_left = [&](auto solver) {
    Points x = at;
    const Summary left = solver.solve(system, x);
    EXPECT_EQ(left.status, Status::Converged) << left;
    EXPECT_EQ(left.positive_definite, true);
    EXPECT_LT((x.leftCols(2) - (Points(2, 2) << -1, 1, 0, 0).finished()).norm(), 1e-6) << left;
  };
  expect_left(Newton<System>());
  expect_left(testing::SparseNewton<System>());
  EXPECT_EQ(covariance(system, peak).status, CovarianceStatus::NotPositiveDefinite);
  EXPECT_LT(energy(system, at + (Points(2, 4) << 0, 0, 0, 0, 0.5, -0.5, 0, 0).finished()),
            energy(system, at));
}

// Squares of such lengths underflow to zero, so stationarity would be meaningless. Terms have it relative to
// how far the forces would move their nodes.
TYPED_TEST(Edges, LengthsWhoseSquaresUnderflowAreOutOfRange) {
  constexpr Status kOutOfRange = kIsOfTerms<TypeParam> ? Status::NoProgress : Status::NumericalFailure;
  System system(Topology<>::full(2));
  system.anchor_stiffness.setOnes();
  system.link_stiffness.setOnes();
  system.rest_length.setConstant(1e-200);
  system.anchors.setZero();
  const Points start = Points::Zero(2, 2);
  Points x = start;
  EXPECT_EQ(TestFixture::solve(system, x).status, kOutOfRange);
  EXPECT_EQ(x, start);
  system.rest_length.setZero();
  x.row(1).setConstant(1e-200);
  EXPECT_EQ(TestFixture::solve(system, x).status, kOutOfRange);
  x.setZero();
  const Summary point = TestFixture::solve(system, x);
  EXPECT_EQ(point.status, Status::Converged);
  EXPECT_EQ(point.final_energy, 0);
}

// Any part of x may overlap any part of a system.
TEST(SharedMemory, IsFoundWhereverItOverlaps) {
  const auto expect_found = [](auto& system, const auto& apart) {
    const auto shares = [&system](const double* first, std::ptrdiff_t count) {
      return detail::shares_memory(system, first, count);
    };
    const auto expect_part = [&](auto& values) {
      double* const first = values.data();
      const std::ptrdiff_t count = values.size();
      EXPECT_TRUE(shares(first, count));
      EXPECT_TRUE(shares(first + count - 1, count));
      EXPECT_TRUE(shares(first - 1, 2));
    };
    expect_part(system.anchors);
    expect_part(system.anchor_stiffness);
    expect_part(system.rest_length);
    expect_part(system.link_stiffness);
    if constexpr (std::decay_t<decltype(system)>::kAnisotropic) expect_part(system.anchor_shape);
    EXPECT_FALSE(shares(apart.data(), apart.size()));
  };
  const Points apart = Points::Zero(2, 5);
  System dynamic(Topology<>::full(5));
  expect_found(dynamic, apart);
  SpringSystem<double, 2, 4> fixed(Topology<4>::full());
  expect_found(fixed, apart);
  using Oriented = Model<Hooke, Quadratic, AnchorShape::Anisotropic>;
  SpringSystem<double, 2, Eigen::Dynamic, Eigen::Dynamic, Oriented> oriented(Topology<>::full(3));
  expect_found(oriented, apart);
  SpringSystem<double, 3, Eigen::Dynamic, 8> bounded(Topology<Eigen::Dynamic, 8>::full(5));
  expect_found(bounded, apart);
}

TEST(SharedMemory, IsRefusedByMultiStart) {
  auto [system, start] = random(3);
  const Points anchors = system.anchors;
  testing::MultiStart<System> solver;
  EXPECT_EQ(solver.solve(system, system.anchors).status, Status::InvalidInput);
  EXPECT_EQ(system.anchors, anchors);
}

// Anchors without stiffness are not used as a start.
TEST(MultiStartSolver, DoesNotStartFromAnchorsThatAreOff) {
  auto [system, start] = random(5);
  system.anchor_stiffness[1] = 0;
  testing::MultiStart<System> solver;
  Points expected = start;
  solver.solve(system, expected);
  for (const double idle : {1e9, 1e160, std::numeric_limits<double>::max()}) {
    system.anchors.col(1).setConstant(idle);
    Points x = start;
    EXPECT_EQ(solver.solve(system, x).status, Status::Converged);
    EXPECT_EQ(x, expected) << idle;
  }
}

TEST(LargeSystem, OfAMillionNodesIsAccepted) {
  // A chain: needs only the memory and time of one iteration.
  constexpr int kNodes = 1000000;
  std::vector<Link> links;
  links.reserve(kNodes - 1);
  for (int i = 0; i + 1 < kNodes; ++i) links.push_back({i, i + 1});
  System system(Topology<>::from_links(kNodes, links));
  for (int i = 0; i < kNodes; ++i) system.anchors.col(i) << i, 0.1 * (i % 7);
  system.anchor_stiffness.setOnes();
  system.rest_length.setConstant(1.1);
  system.link_stiffness.setOnes();
  Points x = system.anchors;
  Lbfgs<System, JacobiMetric<System>> solver;
  solver.options.max_iterations = 2;
  const Summary summary = solver.solve(system, x);
  EXPECT_TRUE(summary.usable()) << summary;
  EXPECT_LT(summary.final_energy, summary.initial_energy);
}

TEST(FarFromTheOrigin, FloatConvergesToTheRoundingOfItsCoordinates) {
  using Float = SpringSystem<float, 2, 4>;
  for (const float offset : {0.0f, 1e4f, 1e6f}) {
    testing::Rng rng(8);
    auto [system, start] =
        testing::random_system<SpringSystem<double, 2, 4>>(rng, Topology<4>::full(), testing::Kind::Track);
    auto expected = start;
    Newton<SpringSystem<double, 2, 4>>().solve(system, expected);
    Float far(Topology<4>::full());
    far.anchors = (system.anchors.array() + offset).cast<float>();
    far.anchor_stiffness = system.anchor_stiffness.cast<float>();
    far.rest_length = system.rest_length.cast<float>();
    far.link_stiffness = system.link_stiffness.cast<float>();
    Float::Points x = (start.array() + offset).cast<float>();
    const Summary summary = Newton<Float>().solve(far, x);
    EXPECT_TRUE(summary.usable()) << summary;
    EXPECT_LT((x.cast<double>().array() - offset - expected.array()).abs().maxCoeff(), 1e-5 + 4e-6 * offset)
        << offset;
  }
}

TYPED_TEST(Edges, SecondsAreMeasuredOnRequest) {
  const auto [system, start] = random(5);
  const auto printed = [](const Summary& summary) {
    std::ostringstream text;
    text << summary;
    return text.str();
  };
  for (const int nodes : {5, 0}) {  // also where the input is refused
    SolverOptions options;
    Points x = start.leftCols(nodes);
    const Summary plain = TestFixture::solve(system, x, options);
    // Methods for a System measure in any case, but not how long it takes to refuse springs.
    if (!kIsOfTerms<TypeParam>) {
      EXPECT_EQ(plain.seconds, -1);
      EXPECT_EQ(printed(plain).find(" s ("), std::string::npos) << plain;
    }
    options.measure_seconds = true;
    x = start.leftCols(nodes);
    const Summary timed = TestFixture::solve(system, x, options);
    EXPECT_EQ(timed.status, nodes == 5 ? Status::Converged : Status::InvalidInput);
    if (!kIsOfTerms<TypeParam> || timed.usable()) {
      EXPECT_GT(timed.seconds, 0);
    }
    EXPECT_EQ(printed(timed).find(" s (") != std::string::npos, timed.usable()) << timed;
  }
}

// Where the values of few nodes are looked at several at a time: each of an odd number of entries has its
// turn.
template <typename Small>
void expect_every_entry_validated() {
  using Scalar = typename Small::Scalar;
  testing::Rng rng(1);
  const auto [good, start] = testing::random_system<Small>(rng, Small::TopologyType::full(3));
  constexpr Scalar kInfinity = std::numeric_limits<Scalar>::infinity();
  const auto expect_refused = [&, &good = good, &start = start](const std::string& what, auto&& entries) {
    auto system = good;
    auto x = start;
    auto& values = entries(system, x);
    const bool has_sign = what == "anchor" || what == "x of node";
    for (Eigen::Index e = 0; e < values.size(); ++e) {
      const Scalar before = values.data()[e];
      for (const Scalar bad : {std::numeric_limits<Scalar>::quiet_NaN(), kInfinity, -kInfinity, Scalar(-1)}) {
        values.data()[e] = bad;
        std::ostringstream message;
        message << Message(validate(system, x));
        const Eigen::Index index = has_sign ? e / values.rows() : e;
        const std::string subject = what + " " + std::to_string(index) + " is ";
        EXPECT_EQ(message.str().starts_with(subject), !(has_sign && bad == -1)) << message.str();
      }
      values.data()[e] = has_sign ? before : Scalar(-0.0);  // which is not negative
      if (!(what == "anchor stiffness" || what == "link stiffness")) {
        EXPECT_FALSE(validate(system, x)) << what << e;
      }
      values.data()[e] = before;
    }
  };
  expect_refused(
      "anchor", [](auto& system, auto&) -> auto& { return system.anchors; });
  expect_refused(
      "anchor stiffness", [](auto& system, auto&) -> auto& { return system.anchor_stiffness; });
  expect_refused(
      "rest length", [](auto& system, auto&) -> auto& { return system.rest_length; });
  expect_refused(
      "link stiffness", [](auto& system, auto&) -> auto& { return system.link_stiffness; });
  expect_refused(
      "x of node", [](auto&, auto& x) -> auto& { return x; });
}

TEST(Validation, LooksAtEveryEntry) {
  expect_every_entry_validated<SpringSystem<double, 3, 3>>();
  expect_every_entry_validated<SpringSystem<float, 3, 3>>();
  expect_every_entry_validated<SpringSystem<double, 2>>();
}

// Newton is fast where it needs few iterations.
TEST(AutoSolver, LooksAtTheStrainOfTheStart) {
  const auto chosen = [](int nodes, double displacement, bool is_full = true) {
    auto [system, start] = random(1, nodes);
    if (!is_full) {
      std::vector<Link> chain;
      for (int i = 1; i < nodes; ++i) chain.push_back({i - 1, i});
      system = System(Topology<>::from_links(nodes, chain));
      system.anchors = start;
      system.anchor_stiffness.setOnes();
      system.link_stiffness.setOnes();
    }
    system.set_rest_lengths(start);
    start.array() *= 1 + displacement;  // the strain of every link
    Points x = start;
    const Summary summary = Auto<System>().solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    return std::string(summary.solver);
  };
  const std::string newton(Newton<System>::name()), lbfgs(Lbfgs<System>::name());
#ifdef ASTERISM_SOLVER_COMPILED
  constexpr int kFew = 12, kMore = 48;
#else
  constexpr int kFew = 8, kMore = 16;
#endif
  EXPECT_EQ(chosen(kFew, 0.3), newton);
  EXPECT_EQ(chosen(kFew + 1, 0.3), lbfgs);
  EXPECT_EQ(chosen(kFew + 1, -0.3), lbfgs);
  EXPECT_EQ(chosen(kFew + 1, 0.2), newton);
  EXPECT_EQ(chosen(kMore, -0.2), newton);
  EXPECT_EQ(chosen(kMore + 1, 0), lbfgs);
  EXPECT_EQ(chosen(12, 0.3, false), newton);
  EXPECT_EQ(chosen(13, 0.3, false), testing::NewtonCg<System>::name());

  auto [system, start] = random(1, 10);
  Points x = start.leftCols(7);
  EXPECT_EQ(Auto<System>().solve(system, x).status, Status::InvalidInput);
  x = start;
  system.rest_length.conservativeResize(3);
  EXPECT_EQ(Auto<System>().solve(system, x).status, Status::InvalidInput);
}

TEST(AutoSolver, SaysWhatItChose) {
  const auto chosen = [](const System& system, Points x) {
    const Summary summary = Auto<System>().solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    return std::string(summary.solver);
  };
  const auto small = random(1, 4), medium = random(1, 40);
  EXPECT_EQ(chosen(small.system, small.start), Newton<System>::name());
  EXPECT_EQ(chosen(medium.system, medium.start), Lbfgs<System>::name());
  testing::Rng rng(1);
  const Points nodes = testing::random_points<System>(rng, 200, 0, 14);
  const auto sparse = testing::random_system<System>(rng, Topology<>::k_nearest(nodes, 3));
  EXPECT_EQ(chosen(sparse.system, sparse.start), testing::NewtonCg<System>::name());
  auto x = small.start;
  EXPECT_EQ(solve(small.system, x).status, Status::Converged);
}

// A sheet of nodes with four neighbours each: links alone leave it free to shear. Weak anchors, and few
// however stiff, need a factorised Hessian.
TEST(AutoSolver, LooksAtHowMostNodesAreHeld) {
  constexpr int kSide = 35;
  std::vector<Link> links;
  Points sheet(2, kSide * kSide);
  for (int i = 0; i < kSide * kSide; ++i) {
    sheet.col(i) << i % kSide, i / kSide;
    if (i % kSide > 0) links.push_back({i - 1, i});
    if (i >= kSide) links.push_back({i - kSide, i});
  }
  System system(Topology<>::from_links(kSide * kSide, links));
  system.anchors = sheet;
  system.rest_length.setOnes();
  system.link_stiffness.setOnes();
  const auto chosen = [&] {
    Points x = sheet;
    return std::string(Auto<System>().solve(system, x).solver);
  };
  system.anchor_stiffness.setConstant(1e-3);
  EXPECT_EQ(chosen(), testing::SparseNewton<System>::name());
  system.anchor_stiffness.setConstant(1);
  EXPECT_EQ(chosen(), system_solvers().make("schwarz").name());
  system.anchor_stiffness.setZero();
  for (const int corner : {0, kSide - 1, kSide * (kSide - 1), kSide * kSide - 1})
    system.anchor_stiffness[corner] = 10;
  EXPECT_EQ(chosen(), testing::SparseNewton<System>::name());
}

TEST(AutoSolver, GoesOnWhereNoFactorisationCan) {
  auto [system, start] = random(1, 40);
  system.anchor_stiffness *= 1e-18;
  Points x = start;
  Lbfgs<System> lbfgs;
  EXPECT_EQ(lbfgs.solve(system, x).status, Status::NumericalFailure);
  EXPECT_EQ(x, start);
  const Summary summary = Auto<System>().solve(system, x);
  EXPECT_TRUE(summary.usable()) << summary;
  EXPECT_EQ(summary.solver, testing::NewtonCg<System>::name());
  EXPECT_LT(summary.final_energy, 0.1 * summary.initial_energy);
}

TEST(MultiStartSolver, NeverEndsHigherAndOftenLower) {
  using Fixed = SpringSystem<double, 2, 4>;
  int lower = 0;
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    testing::Rng rng(seed);
    const auto [system, start] = testing::random_system<Fixed>(rng, Topology<4>::full(), testing::Kind::Orig);
    auto single = start, many = start;
    const Summary one = system_solver<Fixed>("auto").solve(system, single);
    testing::MultiStart<Fixed> solver;
    const Summary best = solver.solve(system, many);
    EXPECT_EQ(best.status, Status::Converged);
    EXPECT_LE(best.final_energy, one.final_energy);
    EXPECT_EQ(best.initial_energy, one.initial_energy);
    EXPECT_NEAR(best.final_energy, energy(system, many), 1e-12 * best.final_energy);
    EXPECT_GT(best.iterations, one.iterations);
    lower += best.final_energy < 0.999 * one.final_energy;
    auto again = start;
    solver.solve(system, again);
    EXPECT_EQ(again, many);  // the random numbers are its own
  }
  EXPECT_GE(lower, 3);
  EXPECT_LE(lower, 40);
}

TEST(MultiStartSolver, HoldsWhatGroundingHolds) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    auto [system, start] = random(seed);
    system.anchor_stiffness.setZero();
    testing::MultiStart<System> solver;
    solver.options.hold_floating = true;
    Points x = start;
    expect_solved(system, x, solver.solve(system, x));
    EXPECT_EQ(x.col(0), start.col(0));
  }
}

// Without anchors, the second start is not the first one again.
TEST(MultiStartSolver, SecondStartDiffersWithoutAnchors) {
  int lower = 0;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    testing::Rng rng(seed);
    auto [system, start] = testing::random_system<System>(rng, Topology<>::full(9));
    system.anchor_stiffness.setZero();
    testing::MultiStart<System> solver;
    solver.options.hold_floating = true;
    solver.options.starts = 1;
    Points x = start;
    const double one = solver.solve(system, x).final_energy;
    solver.options.starts = 2;
    Points second = start;
    const Summary two = solver.solve(system, second);
    EXPECT_LE(two.final_energy, one);
    EXPECT_EQ(second.col(0), start.col(0));
    lower += two.final_energy < 0.999 * one;
  }
  EXPECT_GE(lower, 2);
}

}  // namespace
}  // namespace asterism
