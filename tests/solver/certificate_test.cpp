// Certificates of the global minimum: compared with exhaustive search, many starts, eigenvalues of W and its
// inverse; and the inputs that they must refuse.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/method/make_solver.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/problem/model.hpp>
#include <asterism/testing/check_model.hpp>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "by_terms.hpp"
#include "lowest_energy.hpp"
#include "matrices.hpp"
#include "model_kits.hpp"
#include "test_systems.hpp"

namespace asterism {
namespace {

using testing::Fixed2;
using testing::Kind;
using testing::lowest_energy;
using testing::Plane;
using testing::Rng;
using testing::Space;

/// The matrix W of docs/theory.md, computed from its definition.
Eigen::MatrixXd stress_matrix(const Plane& system, const Plane::Points& x) {
  Eigen::MatrixXd W = system.anchor_stiffness.asDiagonal();
  for (int l = 0; const Link& link : system.links()) {
    const double r = (x.col(link.i) - x.col(link.j)).norm();
    const double w = system.link_stiffness[l] * (1 - system.rest_length[l] / r);
    Eigen::VectorXd c = Eigen::VectorXd::Zero(system.nodes());
    c[link.i] = 1, c[link.j] = -1;
    W += w * c * c.transpose();
    ++l;
  }
  return W;
}

struct Solved {
  Plane system;
  Plane::Points x;
};

Solved solved(Kind kind, int n, std::uint64_t index) {
  auto [system, x] = testing::numbered_system<Plane>(kind, Topology<>::full(n), index);
  EXPECT_EQ((Newton<Plane>().solve(system, x).status), Status::Converged);
  return {system, x};
}

// Two and three nodes in one dimension, where a grid finds every minimum.
void expect_bounds_below_grid(int nodes, int trials, int steps) {
  using Line = testing::Line;
  Rng rng(static_cast<std::uint64_t>(nodes));
  int certified = 0;
  for (int trial = 0; trial < trials; ++trial) {
    auto [system, x] = testing::random_system<Line>(rng, Line::TopologyType::full(nodes));
    Newton<Line>().solve(system, x);
    const Certificate certificate = certify(system, x);
    const Summary up = testing::Staircase<Line>().solve(system, x);
    double lowest = std::numeric_limits<double>::infinity();
    const double low = system.anchors.minCoeff() - 2, high = system.anchors.maxCoeff() + 2;
    std::vector<int> at(static_cast<std::size_t>(nodes), 0);
    Line::Points y(1, nodes);
    for (std::size_t i = 0; i < at.size();) {  // a counter in base steps + 1
      for (int node = 0; node < nodes; ++node)
        y(0, node) = low + at[static_cast<std::size_t>(node)] * (high - low) / steps;
      lowest = std::min(lowest, energy(system, y));
      for (i = 0; i < at.size() && ++at[i] > steps; ++i) at[i] = 0;
    }
    EXPECT_LE(certificate.lower_bound, lowest);
    EXPECT_LE(up.lower_bound, lowest);
    if (!certificate.certified()) continue;
    ++certified;
    EXPECT_LE(certificate.energy, lowest);
    EXPECT_LE(certificate.distance, 1e-3);
  }
  EXPECT_GT(certified, trials / 4);
}

TEST(Certificate, BoundsWhatExhaustiveSearchFinds) {
  expect_bounds_below_grid(2, 200, 200);
  expect_bounds_below_grid(3, 40, 60);
}

template <typename System>
void expect_never_beaten(int n, Kind kind, int count, int at_least) {
  int certified = 0;
  for (int index = 0; index < count; ++index) {
    auto [system, x] = testing::numbered_system<System>(kind, System::TopologyType::full(n),
                                                        1000 + static_cast<std::uint64_t>(index));
    Newton<System>().solve(system, x);
    const Certificate certificate = certify(system, x);
    const auto exact = system.template cast<double>();
    const double lowest =
        lowest_energy(exact, x.template cast<double>(), 30, static_cast<std::uint64_t>(index), 1);
    ASSERT_LE(certificate.lower_bound, lowest * (1 + 1e-12)) << to_string(kind) << " " << index;
    if (!certificate.certified()) continue;
    ++certified;
    ASSERT_LE(certificate.energy, lowest * (1 + 1e-6)) << to_string(kind) << " " << index;
    ASSERT_GE(certificate.least_eigenvalue, 0);
  }
  EXPECT_GE(certified, at_least) << to_string(kind) << " n = " << n;
}

TEST(Certificate, NoStartGoesBelowIt) {
  for (const Kind kind : testing::kKinds) {
    expect_never_beaten<Fixed2>(4, kind, 150, 100);
    expect_never_beaten<testing::Fixed2f>(4, kind, 100, 60);
  }
  expect_never_beaten<Plane>(9, Kind::Lit, 60, 5);
  expect_never_beaten<Plane>(9, Kind::Track, 60, 40);
  expect_never_beaten<Space>(5, Kind::Lit, 60, 40);
}

TEST(Certificate, HoldsAwayFromStationaryPoints) {
  Rng rng(3);
  int definite = 0;
  for (std::uint64_t index = 0; index < 300; ++index) {
    const auto [system, x] = solved(index % 2 == 0 ? Kind::Lit : Kind::Track, 4, index);
    const double lowest = lowest_energy(system, x, 20, index, 1);
    const double length = characteristic_length(system, x);
    for (const double share : {1e-3, 1e-1, 0.5}) {
      Plane::Points y = x;
      for (double& coordinate : y.reshaped()) coordinate += share * length * rng.uniform(-1, 1);
      const Certificate certificate = certify(system, y);
      ASSERT_NE(certificate.proof, Proof::NotApplicable) << certificate;
      ASSERT_LE(certificate.lower_bound, lowest * (1 + 1e-12)) << certificate;
      ASSERT_NEAR(certificate.energy, energy(system, y), 1e-12 * certificate.energy);
      if (!(certificate.least_eigenvalue > 0)) continue;
      ++definite;
      // The global minimum is within the certificate's distance.
      Plane::Points best = x;
      if (std::abs(energy(system, x) - lowest) < 1e-9 * lowest) {
        ASSERT_LE((best - y).colwise().norm().maxCoeff(), certificate.distance);
      }
    }
  }
  EXPECT_GT(definite, 300);
}

TEST(Certificate, IsThatOfTheStressMatrix) {
  int certified = 0, unique = 0;
  for (std::uint64_t index = 0; index < 200; ++index) {
    for (const int n : {1, 3, 7, 40}) {
      const auto [system, x] = solved(index % 2 == 0 ? Kind::Orig : Kind::Track, n, index);
      if (n == 40 && index > 10) continue;
      const Eigen::MatrixXd W = stress_matrix(system, x);
      const Eigen::VectorXd modes = testing::eigenvalues(W);
      const double least = modes[0], most = modes[n - 1];
      const Certificate certificate = certify(system, x);
      if (std::abs(least) < 1e-9 * most) continue;
      if (least > 0) {
        EXPECT_TRUE(certificate.certified()) << certificate;
        ++certified;
        unique += certificate.proof == Proof::UniqueGlobalMinimum ? 1 : 0;
        EXPECT_GT(certificate.least_eigenvalue, 0);
        EXPECT_LE(certificate.least_eigenvalue, least * (1 + 1e-9));
        if (n <= 32) {
          EXPECT_GT(certificate.least_eigenvalue, least / (2 * n));
        }
        const Plane::Points g = gradient(system, x);
        const double gap = (g * testing::solve_definite(W, g.transpose())).trace() / 2;
        const double difference = certificate.energy - certificate.lower_bound;
        EXPECT_GE(difference, gap * (1 - 1e-9));
        EXPECT_LE(difference, gap + 1e-9 * certificate.energy + 1e-12);
        EXPECT_EQ(certificate.gap(), certificate.energy > 0 ? difference / certificate.energy : difference);
      } else {
        EXPECT_EQ(certificate.proof, Proof::NotCertified) << certificate;
        EXPECT_LT(certificate.least_eigenvalue, 0);
        EXPECT_GE(certificate.least_eigenvalue, least * (1 + 1e-9));
        EXPECT_EQ(certificate.reason, "W has a negative eigenvalue: there may be a lower minimum");
      }
    }
  }
  EXPECT_GT(unique, 0.98 * certified);  // the others are missed by the bound of the eigenvalue
}

// Rotates, scales and relabels the system, and changes the unit of stiffness.
TEST(Certificate, DoesNotDependOnFrameUnitOrOrder) {
  for (std::uint64_t index = 0; index < 50; ++index) {
    const auto [system, x] = solved(Kind::Lit, 5, index);
    const Certificate given = certify(system, x);
    Plane other = system;
    const Eigen::Matrix2d turn = Eigen::Rotation2Dd(0.3).toRotationMatrix();
    other.anchors = 3 * (turn * system.anchors);
    other.rest_length *= 3;
    other.anchor_stiffness *= 7, other.link_stiffness *= 7;
    Plane::Points y = 3 * (turn * x);
    const auto expect_same = [&](const Certificate& certificate, double unit) {
      EXPECT_EQ(certificate.proof, given.proof);
      EXPECT_NEAR(certificate.energy, unit * given.energy, 1e-10 * unit * given.energy);
      EXPECT_NEAR(certificate.lower_bound, unit * given.lower_bound, 1e-9 * unit * given.energy);
    };
    expect_same(certify(other, y), 63);

    Eigen::VectorXi order(5);
    order << 2, 3, 4, 0, 1;
    std::vector<Link> links;
    for (const Link& link : system.links()) links.push_back({order[link.j], order[link.i]});
    Plane relabelled(Topology<>::from_links(5, links));
    relabelled.anchors.resize(2, 5), relabelled.anchor_stiffness.resize(5);
    relabelled.rest_length = system.rest_length, relabelled.link_stiffness = system.link_stiffness;
    for (int i = 0; i < 5; ++i) {
      relabelled.anchors.col(order[i]) = system.anchors.col(i);
      relabelled.anchor_stiffness[order[i]] = system.anchor_stiffness[i];
      y.col(order[i]) = x.col(i);
    }
    expect_same(certify(relabelled, y), 1);
  }
}

// Stiffness ratios of 1e12 and coordinates far from the origin: whatever is certified must be true.
TEST(Certificate, RoundingCertifiesNothing) {
  int certified = 0;
  for (std::uint64_t index = 0; index < 200; ++index) {
    auto [system, x] = testing::numbered_system<Plane>(Kind::Lit, Topology<>::full(4), index);
    Rng rng(index);
    for (double& k : system.link_stiffness) k *= std::pow(10.0, rng.uniform(-6, 6));
    if (index % 2 == 0) {
      x.array() += 1e6;
      system.anchors.array() += 1e6;
    }
    Newton<Plane>().solve(system, x);
    const Certificate certificate = certify(system, x);
    const double lowest = lowest_energy(system, x, 60, index, 1);
    ASSERT_LE(certificate.lower_bound, lowest * (1 + 1e-9)) << index;
    if (!certificate.certified()) continue;
    ++certified;
    ASSERT_LE(certificate.energy, lowest * (1 + 1e-6)) << index;
  }
  EXPECT_GT(certified, 20);
}

TEST(Certificate, OfFloatsIsThatOfTheSameNumbersInDouble) {
  for (std::uint64_t index = 0; index < 20; ++index) {
    auto [system, x] = testing::numbered_system<testing::Fixed2f>(Kind::Track, Topology<4>::full(), index);
    system.anchors.array() += 1e5F;
    x.array() += 1e5F;
    Newton<testing::Fixed2f>().solve(system, x);
    const Certificate single = certify(system, x);
    const Certificate exact = certify(system.cast<double>(), Fixed2::Points(x.cast<double>()));
    EXPECT_EQ(single.proof, exact.proof);
    EXPECT_EQ(single.lower_bound, exact.lower_bound);
  }
}

TEST(Certificate, OfLargeSparseSystemsIsThatOfTheDenseMatrix) {
  for (const bool is_taut : {false, true}) {
    auto [system, x] = testing::sparse_system<Plane>(1, 300);
    if (is_taut) system.rest_length *= 0.2;
    make_solver<Plane>("lbfgs-jacobi").solve(system, x);
    const Certificate sparse = certify(system, x);
    detail::Minoriser<Plane> minoriser;
    minoriser.set(system, x, false, [](int) { return false; });
    const auto dense = detail::DenseBound<Eigen::Dynamic, Eigen::Dynamic>().bound(system, minoriser);
    EXPECT_EQ(sparse.certified(), dense.is_definite);
    EXPECT_EQ(dense.is_definite, is_taut);
    if (dense.is_definite) {
      EXPECT_LT(sparse.gap(), 1e-9);
      EXPECT_GT(sparse.least_eigenvalue, 0);
    } else {
      EXPECT_LT(sparse.least_eigenvalue, 0);
      EXPECT_GT(sparse.lower_bound, 0);
    }
  }
}

TEST(Certificate, KnowsFixedNodesAndFloatingComponents) {
  Plane system(Topology<>::full(3));
  system.anchors = Plane::Points{{0, 3, 0}, {0, 0, 4}};
  system.anchor_stiffness.setZero();
  system.set_rest_lengths(system.anchors);
  system.link_stiffness.setOnes();
  // Without anchors and without strain: the least energy, at many placements.
  EXPECT_EQ(certify(system, system.anchors).proof, Proof::GlobalMinimum);
  EXPECT_EQ(certify(system, system.anchors).lower_bound, 0);
  // Two nodes are fixed far apart: the third one settles between stretched springs.
  Plane::Points x = 2 * system.anchors;
  system.fix(0), system.fix(1);
  ASSERT_EQ((Newton<Plane>().solve(system, x).status), Status::Converged);
  const Certificate certificate = certify(system, x);
  const double lowest = lowest_energy(system, x, 30, 1, 1);
  EXPECT_LE(certificate.lower_bound, lowest * (1 + 1e-12));
  // It may be on either side of the other two.
  EXPECT_NE(certificate.proof, Proof::UniqueGlobalMinimum);
  system.anchor_stiffness[2] = 10;
  ASSERT_EQ((Newton<Plane>().solve(system, x).status), Status::Converged);
  EXPECT_EQ(certify(system, x).proof, Proof::UniqueGlobalMinimum);
}

TEST(Certificate, NamesTheLinkWhoseEndsCoincide) {
  Plane system(Topology<>::full(2));
  system.anchors = Plane::Points{{0, 1}, {0, 0}};
  system.anchor_stiffness.setOnes();
  system.rest_length.setOnes(), system.link_stiffness.setOnes();
  const Certificate certificate = certify(system, Plane::Points::Zero(2, 2));
  EXPECT_EQ(certificate.proof, Proof::NotCertified);
  EXPECT_EQ(certificate.reason, "link 0 has ends that coincide: x is not a minimum");
  EXPECT_LE(certificate.lower_bound, 0);
}

TEST(Certificate, HasAReasonWhereThereIsNone) {
  Plane system(Topology<>::full(2));
  EXPECT_EQ(certify(system, Plane::Points::Zero(2, 2)).proof, Proof::NotApplicable);
  system.anchors = Plane::Points{{0, 1}, {0, 0}};
  system.anchor_stiffness.setOnes();
  system.rest_length.setOnes(), system.link_stiffness.setOnes();
  Plane::Points x = system.anchors;
  EXPECT_EQ(certify(system, x, {.gap = -1}).reason, "option gap is negative or not finite");
  x(0, 0) = std::nan("");
  EXPECT_EQ(certify(system, x).proof, Proof::NotApplicable);
  EXPECT_FALSE(certify(system, x).reason.empty());
  system.anchors *= 1e200;
  x = Plane::Points::Zero(2, 2);
  const Certificate overflow = certify(system, x);
  EXPECT_EQ(overflow.proof, Proof::NotApplicable);
  EXPECT_EQ(overflow.reason, "energy, gradient or curvature leave the range of the scalar");
  EXPECT_TRUE(std::isfinite(overflow.lower_bound));
}

template <typename M>
using OfModel = SpringSystem<double, 2, Eigen::Dynamic, 8, M>;

template <typename M>
OfModel<M> with_model(const Plane& system) {
  OfModel<M> other(OfModel<M>::TopologyType::full(system.nodes()));
  other.anchors = system.anchors, other.anchor_stiffness = system.anchor_stiffness;
  other.rest_length = system.rest_length, other.link_stiffness = system.link_stiffness;
  return other;
}

/// Half of Hooke's potential: convex in the squared length, and declared so or not.
template <bool kSays>
struct HalfHooke {
  static constexpr bool kConvexInSquare = kSays;
  template <typename Scalar>
  Derivatives<Scalar> operator()(Scalar r, Scalar mu) const {
    const Scalar stretch = r - mu;
    return {stretch * stretch / 4, stretch / 2, Scalar(0.5)};
  }
};

/// Hooke's potential without such a declaration.
struct Undeclared {
  template <typename Scalar>
  Derivatives<Scalar> operator()(Scalar r, Scalar mu) const {
    return Hooke()(r, mu);
  }
};

TEST(Certificate, OfOtherModelsSaysWhatItCan) {
  int unique = 0;
  for (std::uint64_t index = 0; index < 40; ++index) {
    auto [plain, minimum] = testing::numbered_system<Plane>(Kind::Track, Topology<>::full(4), index);
    Newton<Plane>().solve(plain, minimum);
    OfModel<Springs>::Points x = minimum;

    auto half = with_model<Model<HalfHooke<true>>>(plain);
    half.link_stiffness *= 2;
    const Certificate expected = certify(plain, minimum);
    const Certificate same = certify(half, x);
    EXPECT_EQ(same.certified(), expected.certified());
    EXPECT_NE(same.proof, Proof::UniqueGlobalMinimum);  // known only for springs
    EXPECT_NEAR(same.lower_bound, expected.lower_bound, 1e-6 * expected.energy);
    EXPECT_EQ(certify(with_model<Model<HalfHooke<false>>>(plain), x).proof, Proof::NotApplicable);
    EXPECT_EQ(certify(with_model<Model<Undeclared>>(plain), x).reason,
              "the links' potential is not declared to be convex in the square of the length");

    auto robust = with_model<testing::Hubers::System::Model>(plain);
    robust.anchor_loss.scale = 5;
    Newton<decltype(robust)>().solve(robust, x);
    const Certificate reweighted = certify(robust, x);
    EXPECT_TRUE(reweighted.proof == Proof::ReweightedMinimum || reweighted.proof == Proof::NotCertified);
    EXPECT_EQ(reweighted.lower_bound, 0);
    EXPECT_FALSE(reweighted.certified());
    EXPECT_DOUBLE_EQ(reweighted.energy, energy(robust, x));

    auto ellipses = with_model<testing::Ellipses::System::Model>(plain);
    Rng rng(index);
    for (int i = 0; i < 4; ++i) {
      const Eigen::Matrix2d turn = Eigen::Rotation2Dd(rng.uniform(0, 3)).toRotationMatrix();
      const Eigen::Vector2d strength(plain.anchor_stiffness[i], 0.3 * plain.anchor_stiffness[i]);
      ellipses.set_anchor_information(i, turn * strength.asDiagonal() * turn.transpose());
    }
    Newton<decltype(ellipses)>().solve(ellipses, x);
    const Certificate certificate = certify(ellipses, x);
    const double lowest = lowest_energy(ellipses, x, 30, index, 1);
    ASSERT_LE(certificate.lower_bound, lowest * (1 + 1e-12));
    if (certificate.certified()) {
      ASSERT_LE(certificate.energy, lowest * (1 + 1e-6));
    }
    unique += certificate.certified() ? 1 : 0;
  }
  EXPECT_GT(unique, 20);
}

// Every method by name ends once the gap is proven, and reports it.
TEST(Gap, EndsEverySolver) {
  auto [system, start] = testing::numbered_system<Plane>(Kind::Track, Topology<>::full(9), 0);
  Plane::Points best = start;
  Newton<Plane>().solve(system, best);
  ASSERT_TRUE(certify(system, best).certified()) << certify(system, best);
  for (const std::string& name : solver_registry<Plane>().names()) {
    auto solver = make_solver<Plane>(name);
    Plane::Points x = start;
    const Summary plain = solver.solve(system, x);
    if (name == "staircase" || name == "branch-and-bound") {  // these always prove a bound
      EXPECT_GT(plain.lower_bound, 0);
    } else {
      EXPECT_EQ(plain.lower_bound, -1) << name;
    }
    solver.options().gap = 0.01;
    x = start;
    const Summary summary = solver.solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << name << ": " << summary;
    EXPECT_LE(summary.iterations, plain.iterations) << name;
    EXPECT_GT(summary.lower_bound, 0) << name;
    EXPECT_LE(summary.final_energy - summary.lower_bound, 0.01 * summary.final_energy) << name;
    EXPECT_LE(summary.lower_bound, energy(system, best)) << name;
    solver.options().gap = -1;
    EXPECT_EQ(solver.solve(system, x).status, Status::InvalidInput) << name;
  }
}

// A method that is used by itself proves the same with a certifier as by name, and refuses a gap without one.
TEST(Gap, NeedsACertifierOfTheSystemsType) {
  auto [system, start] = testing::numbered_system<Plane>(Kind::Track, Topology<>::full(9), 0);
  Plane::Points by_name = start;
  const Summary expected = make_solver<Plane>("newton", {{"gap", 0.01}}).solve(system, by_name);
  ASSERT_TRUE(expected.is_within(0.01)) << expected;

  Certifier<Plane> certifier;
  Newton<Plane> newton;
  newton.options.gap = 0.01;
  newton.options.certifier = certifier;
  Plane::Points x = start;
  const Summary proven = newton.solve(system, x);
  EXPECT_EQ(x, by_name);
  EXPECT_EQ(proven.lower_bound, expected.lower_bound);
  EXPECT_EQ(certifier.options.gap, CertifyOptions().gap);

  Certifier<SpringSystem<double, 3>> of_others;
  for (const CertifierReference& wrong : {CertifierReference(), CertifierReference(of_others)}) {
    newton.options.certifier = wrong;
    x = start;
    const Summary refused = newton.solve(system, x);
    EXPECT_EQ(refused.status, Status::InvalidInput);
    EXPECT_EQ(refused.message,
              "option gap: set the option certifier, too, to a Certifier of systems of this type");
    EXPECT_EQ(x, start);
    newton.options.gap = 0;  // then no certifier is needed
    EXPECT_EQ(newton.solve(system, x).status, Status::Converged);
    newton.options.gap = 0.01;
  }
}

TEST(Gap, EndsTheSearchForOtherMinima) {
  auto [system, start] = testing::numbered_system<Plane>(Kind::Track, Topology<>::full(4), 1);
  testing::MultiStart<Plane> solver;
  Plane::Points x = start;
  const Summary all = solver.solve(system, x);
  solver.options.gap = 1e-6;
  Plane::Points y = start;
  const Summary proven = solver.solve(system, y);
  EXPECT_EQ(proven.status, Status::Converged);
  EXPECT_LT(proven.iterations, all.iterations);
  EXPECT_NEAR(proven.final_energy, all.final_energy, 1e-6 * all.final_energy);
}

}  // namespace
}  // namespace asterism
