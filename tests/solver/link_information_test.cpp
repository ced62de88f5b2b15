// Links with an information matrix: against linear least squares, finite differences, and links without.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <asterism/solver.hpp>
#include <asterism/solver/terms/from_springs.hpp>
#include <asterism/testing/random_system.hpp>
#include <asterism/testing/sparse_system.hpp>
#include <cstdint>
#include <limits>

#include "by_terms.hpp"
#include "matrices.hpp"

namespace asterism {
namespace {

using testing::random_points;
using testing::Rng;

template <int Dim, int N = Eigen::Dynamic>
using System =
    SpringSystem<double, Dim, N, N,
                 Model<Hooke, Quadratic, AnchorShape::Isotropic, NoTriples, LinkShape::Anisotropic>>;

template <int Dim>
Eigen::Matrix<double, Dim, Dim> random_information(Rng& rng) {
  Eigen::Matrix<double, Dim, Dim> root;
  for (double& value : root.reshaped()) value = rng.uniform(-1, 1);
  return root * root.transpose();
}

template <int Dim>
testing::RandomSystem<System<Dim>> random_system(std::uint64_t seed, int nodes, double rest_length) {
  Rng rng(seed);
  System<Dim> system(Topology<>::full(nodes));
  const auto shape = random_points<System<Dim>>(rng, nodes, -10, 10);
  system.set_rest_offsets(shape);
  for (int l = 0; l < system.link_count(); ++l) system.set_link_information(l, random_information<Dim>(rng));
  system.rest_length.setConstant(rest_length);
  for (double& k : system.anchor_stiffness) k = rng.uniform(0.1, 1);
  system.anchors = shape + random_points<System<Dim>>(rng, nodes, -4, 4);
  return {system, system.anchors};
}

// The matrix of the normal equations of sum k_i |x_i - a_i|^2 + sum d^T W d, d = x_i - x_j - m_ij.
template <int Dim>
Eigen::MatrixXd normal_matrix(const System<Dim>& system, Eigen::VectorXd& right) {
  const int n = system.nodes();
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(Dim * n, Dim * n);
  right.setZero(Dim * n);
  for (int i = 0; i < n; ++i) {
    H.block(Dim * i, Dim * i, Dim, Dim).diagonal().array() += system.anchor_stiffness[i];
    right.segment(Dim * i, Dim) += system.anchor_stiffness[i] * system.anchors.col(i);
  }
  int l = 0;
  for (const Link& link : system.links()) {
    const Eigen::MatrixXd W = system.link_stiffness[l] * system.link_shape.middleCols(Dim * l, Dim);
    Eigen::MatrixXd J = Eigen::MatrixXd::Zero(Dim, Dim * n);
    J.middleCols(Dim * link.i, Dim).setIdentity();
    J.middleCols(Dim * link.j, Dim) = -Eigen::MatrixXd::Identity(Dim, Dim);
    H += J.transpose() * W * J;
    right += J.transpose() * W * system.rest_offset.col(l);
    ++l;
  }
  return H;
}

template <typename Solver, typename Given>
int expect_solved(const Given& system, typename Given::Points x, const Eigen::VectorXd& expected) {
  Solver solver;
  solver.options.max_iterations = 100000;
  const Summary summary = solver.solve(system, x);
  EXPECT_EQ(summary.status, Status::Converged) << summary;
  EXPECT_LT((x.reshaped() - expected).cwiseAbs().maxCoeff(), 1e-5) << summary;
  return summary.iterations;
}

// Newton's method in one step, the covariance, and `Methods`.
template <int Dim, typename... Methods>
void expect_least_squares() {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const auto [system, start] = random_system<Dim>(seed, 6, 0);
    Eigen::VectorXd right;
    const Eigen::MatrixXd H = normal_matrix(system, right);
    const Eigen::VectorXd expected = H.llt().solve(right);
    EXPECT_EQ((expect_solved<Newton<System<Dim>>>(system, start, expected)), 1);
    (expect_solved<Methods>(system, start, expected), ...);
    const auto cov = covariance(system, typename System<Dim>::Points(expected.reshaped(Dim, 6)));
    ASSERT_EQ(cov.status, CovarianceStatus::Computed) << cov.message;
    EXPECT_TRUE(testing::is_near(cov.matrix, testing::inverse(H), 1e-9));
  }
}

// The blocks differ by dimension, and what the methods do with them does not: all methods in the plane.
TEST(LinkInformation, WithoutLengthsIsLeastSquares) {
  expect_least_squares<2, Ida<System<2>>, Lbfgs<System<2>>, NewtonCg<System<2>>,
                       testing::SparseNewton<System<2>>>();
  expect_least_squares<3>();
}

// A set of known size takes other kernels.
TEST(LinkInformation, OfAFixedSizeIsLeastSquares) {
  const auto [system, start] = random_system<3>(1, 6, 0);
  Eigen::VectorXd right;
  const Eigen::MatrixXd H = normal_matrix(system, right);
  System<3, 6> six(Topology<6>::full());
  six.anchors = system.anchors;
  six.anchor_stiffness = system.anchor_stiffness;
  six.rest_length = system.rest_length;
  six.link_stiffness = system.link_stiffness;
  six.rest_offset = system.rest_offset;
  six.link_shape = system.link_shape;
  expect_solved<Newton<System<3, 6>>>(six, start, Eigen::VectorXd(H.llt().solve(right)));
}

TEST(LinkInformation, OfTheIdentityIsStiffness) {
  auto [system, start] = random_system<3>(2, 5, 4);
  SpringSystem<double, 3> plain(Topology<>::full(5));
  Rng rng(3);
  for (int l = 0; l < system.link_count(); ++l)
    system.set_link_information(l, rng.uniform(0.1, 2) * Eigen::Matrix3d::Identity());
  plain.anchors = system.anchors;
  plain.anchor_stiffness = system.anchor_stiffness;
  plain.rest_length = system.rest_length;
  plain.link_stiffness = system.link_stiffness;
  plain.rest_offset = system.rest_offset;
  EXPECT_NEAR(energy(system, start), energy(plain, start), 1e-12 * energy(plain, start));
  EXPECT_LT((gradient(system, start) - gradient(plain, start)).norm(), 1e-12 * gradient(plain, start).norm());
  EXPECT_LT((hessian(system, start) - hessian(plain, start)).norm(), 1e-12 * hessian(plain, start).norm());
}

TEST(LinkInformation, HasTrueDerivatives) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    auto [system, start] = random_system<2>(seed, 4, 5);
    system.set_link_information(1, Eigen::Vector2d(1, 2) * Eigen::RowVector2d(1, 2));  // of one direction
    const System<2>::Points g = gradient(system, start);
    const auto H = hessian(system, start);
    const double h = 1e-6;
    for (int c = 0; c < start.size(); ++c) {
      System<2>::Points ahead = start, behind = start;
      ahead.data()[c] += h, behind.data()[c] -= h;
      EXPECT_NEAR(g.data()[c], (energy(system, ahead) - energy(system, behind)) / (2 * h), 1e-5);
      const System<2>::Points change = (gradient(system, ahead) - gradient(system, behind)) / (2 * h);
      EXPECT_LT((H.col(c) - change.reshaped()).norm(), 1e-5);
    }
    // IDA's quadratic lies above.
    Ida<System<2>> ida;
    ida.options.max_iterations = 1;
    auto x = start;
    double before = energy(system, x);
    for (int i = 0; i < 30; ++i) {
      ASSERT_TRUE(ida.solve(system, x).usable());
      ASSERT_LE(energy(system, x), before * (1 + 1e-14));
      before = energy(system, x);
    }
    EXPECT_EQ(Newton<System<2>>().solve(system, x).status, Status::Converged);
  }
}

// A difference that the matrix does not see has no length: no NaN, whatever the rest length.
TEST(LinkInformation, DoesNotSeeEveryDirection) {
  for (const double mu : {0.0, 2.0}) {
    System<2> system(Topology<>::full(2));
    system.anchors << 0, 0, 0, 5;
    system.anchor_stiffness.setOnes();
    system.rest_length.setConstant(mu);
    system.set_link_information(0, Eigen::Matrix2d{{3, 0}, {0, 0}});
    auto x = system.anchors;
    EXPECT_TRUE(std::isfinite(energy(system, x)));
    EXPECT_TRUE(gradient(system, x).allFinite());
    const Summary summary = Newton<System<2>>().solve(system, x);
    EXPECT_TRUE(summary.usable()) << summary;
    EXPECT_TRUE(x.allFinite());
    EXPECT_NEAR(x(1, 1), 5, 1e-9);  // nothing pulls that way
    if (mu > 0) {
      x(0, 1) = 1e-3;
      EXPECT_EQ(Newton<System<2>>().solve(system, x).status, Status::Converged);
      EXPECT_NEAR(x(0, 1) - x(0, 0), 2 * 6.0 / 7, 1e-6);  // 3 (2 - r) = r / 2
    }
  }
}

TEST(LinkInformation, IsDividedWithItsSystem) {
  const auto [springs, start] = testing::sparse_system<SpringSystem<double, 2>>(5, 2000);
  System<2> system(Topology<>::from_links(springs.nodes(), springs.links()));
  system.anchors = springs.anchors;
  system.anchor_stiffness = springs.anchor_stiffness;
  Rng rng(3);
  for (int l = 0; l < system.link_count(); ++l) system.set_link_information(l, random_information<2>(rng));
  system.set_rest_offsets(System<2>::Points(start));
  System<2>::Points x = start, y = start;
  const Summary direct = testing::SparseNewton<System<2>>().solve(system, x);
  const Summary divided = system_solver<System<2>>("schwarz").solve(system, y);
  EXPECT_EQ(direct.status, Status::Converged) << direct;
  EXPECT_EQ(divided.status, Status::Converged) << divided;
  EXPECT_LT((x - y).cwiseAbs().maxCoeff(), 1e-4 * characteristic_length(system, x));
}

TEST(LinkInformation, DoesNotTurnWithTheNodes) {
  auto [system, start] = random_system<2>(1, 4, 0);
  Rng rng(5);
  const System<2>::Points x = start + random_points<System<2>>(rng, 4, -5, 20);
  const auto shift = (rigid_alignment(system, x) - x).eval();
  EXPECT_LT((shift.colwise() - shift.col(0)).cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_GT(shift.norm(), 1);
  // One node held: a length would turn about it.
  System<2> pair(Topology<>::full(2));
  pair.anchors << 0, 7, 0, 0;
  pair.anchor_stiffness << 1, 0;
  pair.rest_length << 7;
  pair.set_link_information(0, Eigen::Matrix2d{{2, 0}, {0, 1}});
  auto y = pair.anchors;
  ASSERT_EQ(Newton<System<2>>().solve(pair, y).status, Status::Converged);
  EXPECT_EQ(covariance(pair, y).status, CovarianceStatus::NotPositiveDefinite);  // along an ellipse
  pair.set_rest_offsets(pair.anchors);
  y = pair.anchors;
  EXPECT_EQ(covariance(pair, y).status, CovarianceStatus::Computed);
  EXPECT_EQ(certify(pair, y).proof, Proof::NotApplicable);
}

TEST(LinkInformation, IsValidated) {
  auto [system, start] = random_system<2>(1, 4, 0);
  const auto says = [&system = system, &start = start](const char* expected) {
    auto x = start;
    const Summary summary = Newton<System<2>>().solve(system, x);
    EXPECT_EQ(summary.status, Status::InvalidInput);
    EXPECT_EQ(std::string_view(summary.message), expected);
  };
  system.link_shape(0, 4) = -1;
  says("information matrix of link 2 is not symmetric and positive semi-definite");
  system.link_shape.resize(2, 3);
  says("link shape must have one matrix for each link");
  System<2> unset(Topology<>::full(2));
  unset.anchors = Eigen::Matrix2d::Identity();
  unset.anchor_stiffness.setOnes();
  unset.rest_length.setOnes();
  unset.link_stiffness.setOnes();
  auto x = unset.anchors;
  EXPECT_EQ(Newton<System<2>>().solve(unset, x).status, Status::InvalidInput);
}

}  // namespace
}  // namespace asterism
