// Potentials over three nodes: against a linear system, finite differences, and shapes that are known.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <asterism/solver.hpp>
#include <asterism/testing/check_model.hpp>
#include <asterism/testing/random_system.hpp>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

namespace asterism {
namespace {

using testing::random_points;
using testing::Rng;

template <typename Potential, int Dim = 2, typename Scalar = double, int N = Eigen::Dynamic>
using System = SpringSystem<Scalar, Dim, N, N, Model<Hooke, Quadratic, AnchorShape::Isotropic, Potential>>;

// Chains, each three neighbours of which have a potential.
template <typename Potential, int Dim = 2>
System<Potential, Dim> chain(std::uint64_t seed, int nodes) {
  Rng rng(seed);
  std::vector<Link> links;
  for (int i = 0; i + 1 < nodes; ++i) links.push_back({i, i + 1});
  System<Potential, Dim> system(Topology<>::from_links(nodes, links));
  system.anchors = random_points<System<Potential, Dim>>(rng, nodes, -1, 1);
  for (int i = 0; i < nodes; ++i) system.anchors(0, i) += 3 * i;
  system.set_rest_lengths(system.anchors);
  system.link_stiffness.setConstant(rng.uniform(0.5, 5));
  system.anchor_stiffness.setConstant(rng.uniform(0.01, 0.5));
  for (int i = 0; i + 2 < nodes; ++i)
    system.triples.push_back({i, i + 1, i + 2, rng.uniform(0.1, 3), rng.uniform(0.2, 2)});
  return system;
}

// Potentials that break a rule each, which the kit has to name. This one changes when the three turn.
struct Upright {
  template <typename Point, typename Scalar = typename Point::Scalar>
  TripleForce<Point> operator()(const Point& i, const Point&, const Point& k, Scalar) const {
    Point d = Point::Zero();
    d[0] = i[0] - k[0];
    return {d[0] * d[0] / 2, d, Point::Zero(), -d};
  }
};
struct WrongSign : Bending {
  template <typename Point, typename Scalar = typename Point::Scalar>
  TripleForce<Point> operator()(const Point& i, const Point& j, const Point& k, Scalar rest) const {
    auto force = Bending::operator()(i, j, k, rest);
    force.by_j *= -1;
    return force;
  }
};
struct Negative : Bending {
  template <typename Point, typename Scalar = typename Point::Scalar>
  TripleForce<Point> operator()(const Point& i, const Point& j, const Point& k, Scalar rest) const {
    auto force = Bending::operator()(i, j, k, rest);
    force.value -= 1;
    return force;
  }
};

TEST(Triples, OfTheLibraryKeepTheRules) {
  for (const double scale : {1e-3, 1.0, 1e4}) {
    for (const double rest : {0.0, 0.4}) {
      EXPECT_STREQ(check_triple_potential(Bending(), rest * scale, scale), nullptr);
      EXPECT_STREQ(check_triple_potential(Angle(), 3 * rest, scale), nullptr);
      EXPECT_STREQ(check_triple_potential(Area(), rest * scale * scale, scale), nullptr);
    }
  }
  EXPECT_STREQ(check_triple_potential(Upright(), 0), "changes when the three move as one body");
  EXPECT_STREQ(check_triple_potential(WrongSign(), 0.5), "has a gradient that is not that of its value");
  EXPECT_STREQ(check_triple_potential(Negative(), 0.5), "is negative");
}

TEST(Triples, OfKnownTriangles) {
  const Eigen::Vector2d o(0, 0), x(2, 0), y(0, 3);
  EXPECT_NEAR(Angle()(x, o, y, 0.0).value, std::pow(std::acos(-1) / 2, 2) / 2, 1e-14);
  EXPECT_NEAR(Area()(o, x, y, 0.0).value, 4.5, 1e-14);
  EXPECT_NEAR(Area()(o, y, x, -3.0).value, 0, 1e-14);  // the other way round
  EXPECT_NEAR(Bending()(x, o, y, 0.0).value, 13.0 / 2, 1e-14);
  const Eigen::Vector3d p(0, 0, 0), q(2, 0, 0), r(0, 0, 3);
  EXPECT_NEAR(Area()(p, q, r, 1.0).value, 2, 1e-14);
  // Without direction: no NaN.
  for (const auto& force :
       {Angle()(x, x, y, 1.0), Angle()(x, o, x, 1.0), Angle()(x, o, Eigen::Vector2d(-x), 1.0)}) {
    EXPECT_TRUE(std::isfinite(force.value));
    EXPECT_TRUE(force.by_i.isZero(0) && force.by_j.isZero(0) && force.by_k.isZero(0));
  }
  EXPECT_TRUE(Area()(p, q, Eigen::Vector3d(2 * q), 1.0).by_i.isZero(0));
}

template <typename System>
void expect_true_gradient(const System& system, const typename System::Points& x) {
  const typename System::Points g = gradient(system, x);
  const double h = 1e-6;
  for (int c = 0; c < x.size(); ++c) {
    typename System::Points ahead = x, behind = x;
    ahead.data()[c] += h, behind.data()[c] -= h;
    EXPECT_NEAR(g.data()[c], (energy(system, ahead) - energy(system, behind)) / (2 * h), 1e-5);
  }
}

template <typename Potential, int Dim>
void expect_true_gradients() {
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    const auto system = chain<Potential, Dim>(seed, 9);
    Rng rng(seed);
    expect_true_gradient(system,
                         typename System<Potential, Dim>::Points(
                             system.anchors + random_points<System<Potential, Dim>>(rng, 9, -0.1, 0.1)));
  }
}

TEST(Triples, HaveTrueGradients) {
  expect_true_gradients<Bending, 2>();
  expect_true_gradients<Bending, 3>();
  expect_true_gradients<Angle, 2>();
  expect_true_gradients<Angle, 3>();
  expect_true_gradients<Area, 2>();
  expect_true_gradients<Area, 3>();
}

template <typename Potential, int Dim>
void expect_descent_methods_to_agree() {
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    const auto system = chain<Potential, Dim>(seed, 9);
    Rng rng(seed);
    const typename System<Potential, Dim>::Points start =
        system.anchors + random_points<System<Potential, Dim>>(rng, 9, -0.1, 0.1);
    auto x = start, y = start;
    Lbfgs<System<Potential, Dim>> lbfgs;
    NonlinearCg<System<Potential, Dim>> ncg;
    lbfgs.options.max_iterations = ncg.options.max_iterations = 100000;
    const Summary first = lbfgs.solve(system, x), second = ncg.solve(system, y);
    EXPECT_EQ(first.status, Status::Converged) << first;
    EXPECT_EQ(second.status, Status::Converged) << second;
    EXPECT_LT(first.final_energy, first.initial_energy);
    EXPECT_LT(stationarity(system, x), 1e-7);
    y = x + random_points<System<Potential, Dim>>(rng, 9, -1e-3, 1e-3);  // back to the same minimum
    EXPECT_EQ(ncg.solve(system, y).status, Status::Converged);
    EXPECT_LT((x - y).cwiseAbs().maxCoeff(), 1e-4) << seed;
  }
}

// Methods see a potential by its gradient alone: each in one dimension.
TEST(Triples, AreSolvedByDescent) {
  expect_descent_methods_to_agree<Bending, 2>();
  expect_descent_methods_to_agree<Angle, 3>();
  expect_descent_methods_to_agree<Area, 2>();
}

// A beam that is clamped at one end and loaded at the other: with offsets and rest 0, a linear system.
TEST(Triples, BendABeam) {
  constexpr int kNodes = 15;
  auto system = chain<Bending>(3, kNodes);
  for (int i = 0; i < kNodes; ++i) system.anchors.col(i) << i, 0;
  system.set_rest_offsets(system.anchors);
  system.anchor_stiffness.setZero();
  system.anchor_stiffness.head(2).setConstant(1e3);
  system.link_stiffness.setConstant(20);
  for (Triple& triple : system.triples) triple.stiffness = 300, triple.rest = 0;
  system.loads.setZero(2, kNodes);
  system.loads(1, kNodes - 1) = 0.5;
  Eigen::MatrixXd K = Eigen::MatrixXd(system.anchor_stiffness.asDiagonal());
  Eigen::MatrixXd right = K * system.anchors.transpose() + system.loads.transpose();
  const auto add = [&](double k, const Eigen::VectorXd& row, const Eigen::Vector2d& wanted) {
    K += k * row * row.transpose();
    right += k * row * wanted.transpose();
  };
  for (int l = 0; l < system.link_count(); ++l) {
    Eigen::VectorXd row = Eigen::VectorXd::Zero(kNodes);
    row[l] = 1, row[l + 1] = -1;
    add(system.link_stiffness[l], row, system.rest_offset.col(l));
  }
  for (const Triple& triple : system.triples) {
    Eigen::VectorXd row = Eigen::VectorXd::Zero(kNodes);
    row[triple.i] = row[triple.k] = 1, row[triple.j] = -2;
    add(triple.stiffness, row, Eigen::Vector2d::Zero());
  }
  const Eigen::MatrixXd expected = K.llt().solve(right).transpose();
  EXPECT_GT(expected(1, kNodes - 1), 0.1);
  using Beam = decltype(system);
  const auto expect_solved = [&](auto solver) {
    solver.options.max_iterations = 100000;
    solver.options.tolerance = 1e-10;
    Beam::Points x = system.anchors;
    const Summary summary = solver.solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_LT((x - expected).cwiseAbs().maxCoeff(), 1e-5) << summary;
  };
  expect_solved(Lbfgs<Beam>());
  expect_solved(NonlinearCg<Beam>());
  expect_solved(Auto<Beam>());
}

TEST(Triples, MakeARightAngle) {
  System<Angle, 3> system(Topology<>::from_links(3, std::vector<Link>{{0, 1}, {1, 2}}));
  system.anchors << 0, 2, 3, 0, 0, 1, 0, 0, 1;
  system.anchor_stiffness << 1e-3, 1e-3, 1e-3;
  system.rest_length << 2, 1.5;
  system.link_stiffness.setConstant(10);
  system.triples = {{0, 1, 2, 100, std::acos(-1) / 2}};
  auto x = system.anchors;
  EXPECT_EQ(solve(system, x).status, Status::Converged);
  const Eigen::Vector3d a = x.col(0) - x.col(1), b = x.col(2) - x.col(1);
  EXPECT_NEAR(a.dot(b), 0, 1e-3);
  EXPECT_NEAR(a.norm(), 2, 1e-3);
  EXPECT_NEAR(b.norm(), 1.5, 1e-3);
}

// Lengths alone do not tell a triangle from its mirror image; its area does.
TEST(Triples, TurnATriangleOver) {
  using Three = System<Area, 2, double, 3>;
  Three system(Topology<3>::full());
  system.anchors << 0, 4, 1, 0, 0, -3;
  system.anchor_stiffness.setConstant(1e-4);
  system.rest_length << 4, std::sqrt(10.0), std::sqrt(18.0);
  system.link_stiffness.setOnes();
  Three::Points x = system.anchors;
  const auto area = [&x] {
    return ((x(0, 1) - x(0, 0)) * (x(1, 2) - x(1, 0)) - (x(1, 1) - x(1, 0)) * (x(0, 2) - x(0, 0))) / 2;
  };
  EXPECT_EQ(solve(system, x).status, Status::Converged);
  EXPECT_NEAR(area(), -6, 0.1);
  system.triples = {{0, 1, 2, 1, 6}};
  x = system.anchors;
  x(0, 2) += 0.1;
  EXPECT_EQ(solve(system, x).status, Status::Converged);
  EXPECT_NEAR(area(), 6, 0.1);
  // The same in float.
  using Narrow = System<Area, 2, float, 3>;
  const Narrow narrow = system.cast<float>();
  Narrow::Points y = x.cast<float>();
  EXPECT_TRUE(Lbfgs<Narrow>().solve(narrow, y).usable());
  EXPECT_LT((y.cast<double>() - x).cwiseAbs().maxCoeff(), 1e-2);
}

TEST(Triples, AreRefusedByWhatCannotTakeThem) {
  using Plane = System<Bending>;
  const auto system = chain<Bending>(1, 5);
  const auto is_refused = [&system](auto solver) {
    Plane::Points x = system.anchors;
    const Summary summary = solver.solve(system, x);
    EXPECT_EQ(summary.status, Status::InvalidInput) << summary;
    EXPECT_EQ(std::string_view(summary.message),
              "the method does not support potentials over three nodes: use lbfgs or ncg");
    EXPECT_EQ(x, system.anchors);
  };
  is_refused(Ida<Plane>());
  is_refused(Newton<Plane>());
  is_refused(NewtonCg<Plane>());
  const Certificate certificate = certify(system, system.anchors);
  EXPECT_EQ(certificate.proof, Proof::NotApplicable);
  EXPECT_EQ(std::string_view(certificate.reason), "the system has potentials over three nodes");
  static_assert(!HasTerms<Plane> && !detail::is_searchable<Plane>());
}

TEST(Triples, AreValidated) {
  auto system = chain<Bending>(1, 4);
  const auto says = [&system](const char* expected) {
    auto x = system.anchors;
    const Summary summary = Lbfgs<System<Bending>>().solve(system, x);
    EXPECT_EQ(summary.status, Status::InvalidInput);
    EXPECT_EQ(std::string_view(summary.message), expected);
  };
  const Triple good = system.triples[1];
  const auto with = [&](auto&& change) {
    system.triples[1] = good;
    change(system.triples[1]);
  };
  with([](Triple& t) { t.k = 4; });
  says("triple 1 has a node out of range");
  with([](Triple& t) { t.j = -1; });
  says("triple 1 has a node out of range");
  with([](Triple& t) { t.i = t.k; });
  says("triple 1 has one node twice");
  with([](Triple& t) { t.stiffness = -1; });
  says("triple 1 has a stiffness that is negative or not finite");
  with([](Triple& t) { t = {0, 1, 2}; });
  says("triple 1 has a stiffness that is negative or not finite");
  with([](Triple& t) { t.rest = std::numeric_limits<double>::infinity(); });
  says("triple 1 has a rest that is not finite");
}

}  // namespace
}  // namespace asterism
