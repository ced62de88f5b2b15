// The covariance at the solution: compared with dense inverses and with samples, and refused where it does
// not exist.
#include <gtest/gtest.h>

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <asterism/solver/energy/covariance.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/hessian.hpp>
#include <asterism/solver/linear/jacobi_metric.hpp>
#include <asterism/solver/method/lbfgs.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <string_view>
#include <vector>

#include "covariance_samples.hpp"
#include "matrices.hpp"
#include "test_systems.hpp"

namespace asterism {
namespace {

using testing::Kind;
using testing::Rng;

using Fixed2 = testing::Fixed2;
using Dynamic2 = testing::Plane;

/// A random system with x at a strict local minimum.
template <typename System>
testing::RandomSystem<System> at_minimum(std::uint64_t seed, int n, Kind kind = Kind::Lit) {
  Rng rng(seed);
  auto result = testing::random_system<System>(rng, System::TopologyType::full(n), kind);
  const Summary summary = Newton<System>().solve(result.system, result.start);
  EXPECT_EQ(summary.status, Status::Converged) << summary;
  EXPECT_EQ(summary.positive_definite, true);
  return result;
}

/// A random system and an x at which all its springs are stretched, so that its Hessian is positive definite.
template <typename System>
testing::RandomSystem<System> stretched(std::uint64_t seed, int n) {
  Rng rng(seed);
  auto result = testing::random_system<System>(rng, System::TopologyType::full(n));
  result.system.set_rest_lengths(result.start);
  result.system.rest_length *= typename System::Scalar(0.9);
  return result;
}

testing::RandomSystem<Dynamic2> sparse_at_minimum(std::uint64_t seed, int n) {
  auto result = testing::sparse_system<Dynamic2>(seed, n);
  EXPECT_EQ((Lbfgs<Dynamic2, JacobiMetric<Dynamic2>>().solve(result.system, result.start).status),
            Status::Converged);
  return result;
}

template <typename System>
Eigen::MatrixXd dense_inverse(const System& system, const typename System::Points& x) {
  return testing::inverse(hessian(system, x).template cast<double>());
}

template <typename System, typename Make>
void expect_inverse(Make&& make, int n, double accuracy) {
  constexpr int kDim = System::kDim;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const auto [system, x] = make(seed, n);
    const auto all = covariance(system, x);
    ASSERT_TRUE(all) << all.message;
    EXPECT_EQ(all.status, CovarianceStatus::Computed);
    EXPECT_TRUE(all.message.empty());
    const Eigen::MatrixXd matrix = all.matrix.template cast<double>();
    EXPECT_TRUE(testing::is_near(matrix, dense_inverse(system, x), accuracy));
    EXPECT_TRUE(testing::is_same(matrix, matrix.transpose()));

    const auto nodes = node_covariances(system, x);
    ASSERT_TRUE(nodes) << nodes.message;
    ASSERT_EQ(nodes.blocks.cols(), kDim * n);
    for (int i = 0; i < n; ++i) {
      EXPECT_TRUE(testing::is_same(nodes.of(i).template cast<double>(),
                                   matrix.block(kDim * i, kDim * i, kDim, kDim)));
    }
  }
}

TEST(Covariance, IsTheInverseOfTheHessian) {
  const auto minimum = [](std::uint64_t seed, int n) { return at_minimum<Dynamic2>(seed, n); };
  expect_inverse<Dynamic2>(minimum, 4, 1e-9);
  expect_inverse<Dynamic2>(minimum, 9, 1e-9);
  expect_inverse<Fixed2>(stretched<Fixed2>, 4, 1e-9);
  expect_inverse<testing::Bounded3>(stretched<testing::Bounded3>, 6, 1e-9);
  expect_inverse<testing::Fixed2f>(stretched<testing::Fixed2f>, 4, 1e-2);
  expect_inverse<testing::Line>(stretched<testing::Line>, 5, 1e-9);
  expect_inverse<Dynamic2>(stretched<Dynamic2>, 1, 1e-9);
}

// One anchored node has the anchor's variance, in px^2 for stiffness in 1/px^2.
TEST(Covariance, OfOneNodeIsItsAnchors) {
  Dynamic2 system(Topology<>::full(1));
  system.anchors << 3, 5;
  system.anchor_stiffness << 0.25;
  EXPECT_TRUE(testing::is_same(covariance(system, system.anchors).matrix, 4 * Eigen::Matrix2d::Identity()));
  EXPECT_TRUE(
      testing::is_same(node_covariances(system, system.anchors).of(0), 4 * Eigen::Matrix2d::Identity()));
}

// Two nodes at rest, calculated by hand.
TEST(Covariance, OfTwoNodesByHand) {
  SpringSystem<double, 2> system(Topology<>::full(2));
  system.anchors << 0, 10, 0, 0;
  system.anchor_stiffness.setConstant(2);
  system.set_rest_lengths(system.anchors);
  system.link_stiffness << 3;
  const auto result = covariance(system, system.anchors);
  ASSERT_TRUE(result);
  // Along: H = [5 -3; -3 5], H^-1 = [5 3; 3 5] / 16. Across, the spring is at rest: H = 2 I.
  Eigen::Matrix4d expected = Eigen::Matrix4d::Zero();
  expected(0, 0) = expected(2, 2) = 5 / 16.0;
  expected(0, 2) = expected(2, 0) = 3 / 16.0;
  expected(1, 1) = expected(3, 3) = 0.5;
  EXPECT_LT((result.matrix - expected).norm(), 1e-14);
}

TEST(Covariance, SelectedInverseIsTheInverse) {
  for (const int n : {65, 200, 400}) {
    const auto [system, x] = sparse_at_minimum(static_cast<std::uint64_t>(n), n);
    const Eigen::MatrixXd expected = dense_inverse(system, x);
    ASSERT_TRUE(detail::is_large_and_sparse(system));
    const auto nodes = node_covariances(system, x);
    ASSERT_TRUE(nodes) << nodes.message;
    for (int i = 0; i < n; ++i) {
      const Eigen::Matrix2d block = expected.block<2, 2>(2 * i, 2 * i);
      EXPECT_LT((nodes.of(i) - block).norm(), 1e-9 * block.norm()) << "n = " << n << ", node " << i;
    }
  }
  // Also for patterns with fill-in: full, a star, a chain, and isolated nodes.
  Rng rng(3);
  std::vector<Link> chain;
  for (int i = 0; i + 1 < 30; ++i) chain.push_back({i + 1, i});
  for (const Topology<>& topology : {Topology<>::full(20), Topology<>::star(30, 7),
                                     Topology<>::from_links(30, chain), Topology<>::from_links(30, {})}) {
    auto [system, x] = testing::random_system<Dynamic2>(rng, topology);
    ASSERT_EQ(Newton<Dynamic2>().solve(system, x).status, Status::Converged);
    NodeCovariances<Dynamic2> sparse;
    NodeCovariances<Dynamic2> dense;
    ASSERT_EQ(detail::sparse_node_covariances(system, x, sparse.blocks), CovarianceStatus::Computed);
    ASSERT_EQ(detail::dense_node_covariances(system, x, dense.blocks), CovarianceStatus::Computed);
    EXPECT_LT((sparse.blocks - dense.blocks).norm(), 1e-10 * dense.blocks.norm());
  }
}

struct Ratios {
  double mean = 0;
  double least = std::numeric_limits<double>::infinity();
  double most = 0;
  int count = 0;
  int close = 0;  // within 10 %

  void add(double ratio) {
    mean += (ratio - mean) / ++count;
    least = std::min(least, ratio);
    most = std::max(most, ratio);
    close += std::abs(ratio - 1) < 0.1;
  }
};

// Ratios of the nodes' standard deviations, by H^-1 and by K_dyn^-1, to those of samples at temperature T: E
// = -T log p.
void compare_with_samples(double temperature, Ratios& ratios, Ratios& by_ida) {
  constexpr int kSystems = 10;
  constexpr int kSamples = 200000;
  for (std::uint64_t seed = 1; seed <= kSystems; ++seed) {
    auto [system, x] = at_minimum<Fixed2>(seed, 4, Kind::Track);
    system.anchor_stiffness /= temperature;
    system.link_stiffness /= temperature;
    const auto nodes = node_covariances(system, x);
    ASSERT_TRUE(nodes);
    Eigen::Matrix4d K = system.anchor_stiffness.asDiagonal();  // K_dyn
    for (int l = 0; const Link& link : system.links()) {
      const double k = system.link_stiffness[l++];
      K(link.i, link.i) += k;
      K(link.j, link.j) += k;
      K(link.i, link.j) -= k;
      K(link.j, link.i) -= k;
    }
    const Eigen::MatrixXd K_inverse = testing::inverse(K);
    const testing::Samples samples = testing::sample(system, x, seed, kSamples);
    EXPECT_GT(samples.acceptance, 0.1);
    EXPECT_LT(samples.acceptance, 0.6);
    for (int i = 0; i < 4; ++i) {
      ratios.add(std::sqrt(nodes.of(i).trace()) / samples.deviations[i]);
      by_ida.add(std::sqrt(2 * K_inverse(i, i)) / samples.deviations[i]);
      // K_dyn >= H, so K_dyn^-1 <= H^-1 in every direction.
      const Eigen::Matrix2d missing = nodes.of(i) - K_inverse(i, i) * Eigen::Matrix2d::Identity();
      EXPECT_GT(testing::eigenvalues(missing)[0], -1e-12);
    }
  }
  std::printf("T = %g, %d systems, %d samples each: H^-1 %.3f (%.3f to %.3f, %d of %d within 10 %%), ",
              temperature, kSystems, kSamples, ratios.mean, ratios.least, ratios.most, ratios.close,
              ratios.count);
  std::printf("K_dyn^-1 %.3f (%.3f to %.3f)\n", by_ida.mean, by_ida.least, by_ida.most);
}

// At a tracker's temperature p is not exactly Gaussian, and sometimes has a second mode.
TEST(Covariance, AgreesWithSamplesAndIdasMatrixUnderestimates) {
  Ratios ratios, by_ida;
  compare_with_samples(1, ratios, by_ida);
  EXPECT_GE(ratios.close, ratios.count * 9 / 10);
  EXPECT_NEAR(ratios.mean, 1, 0.04);
  EXPECT_LT(by_ida.mean, 0.9);
}

TEST(Covariance, AgreesWithSamplesOfASharpPeak) {
  Ratios ratios, by_ida;
  compare_with_samples(0.01, ratios, by_ida);
  EXPECT_EQ(ratios.close, ratios.count);
  EXPECT_NEAR(ratios.mean, 1, 0.01);
  EXPECT_LT(by_ida.mean, 0.9);
}

TEST(Covariance, RefusesASaddle) {
  SpringSystem<double, 2> system(Topology<>::full(2));
  system.anchors << -0.1, 0.1, 0, 0;
  system.anchor_stiffness.setConstant(0.01);
  system.rest_length << 1;
  system.link_stiffness << 1;
  Eigen::Matrix2Xd x = system.anchors;
  const auto refused = covariance(system, x);
  EXPECT_FALSE(refused);
  EXPECT_EQ(refused.status, CovarianceStatus::NotPositiveDefinite);
  EXPECT_NE(std::string_view(refused.message).find("not positive definite"), std::string_view::npos);
  EXPECT_EQ(refused.matrix.size(), 0);
  const auto refused_nodes = node_covariances(system, x);
  EXPECT_EQ(refused_nodes.status, CovarianceStatus::NotPositiveDefinite);
  EXPECT_EQ(refused_nodes.blocks.size(), 0);
  NodeCovariances<Dynamic2> sparse;
  EXPECT_EQ(detail::sparse_node_covariances(system, x, sparse.blocks), CovarianceStatus::NotPositiveDefinite);

  Newton<SpringSystem<double, 2>>().solve(system, x);  // at the minimum it exists
  EXPECT_TRUE(covariance(system, x));
  x.setZero();  // a peak, although the Hessian by its convention is positive definite
  const auto peak = covariance(system, x);
  EXPECT_EQ(peak.status, CovarianceStatus::NotPositiveDefinite);
  EXPECT_EQ(peak.message, "link 0 has ends that coincide: x is not a local minimum");
  system.rest_length << 0;  // now the spring is at rest
  EXPECT_TRUE(covariance(system, x));
}

// Anchors too weak to be resolved beside the springs in this scalar: some direction is flat.
TEST(Covariance, RefusesWhatRoundingHides) {
  auto [system, x] = at_minimum<Dynamic2>(1, 5);
  system.set_rest_lengths(x);
  system.anchors = x;
  system.anchor_stiffness *= 1e-18;
  EXPECT_EQ(covariance(system, x).status, CovarianceStatus::NotPositiveDefinite);
  NodeCovariances<Dynamic2> sparse;
  EXPECT_EQ(detail::sparse_node_covariances(system, x, sparse.blocks), CovarianceStatus::NotPositiveDefinite);
}

TEST(Covariance, RefusesBadInput) {
  const auto expect_refused = [](auto&& spoil, std::string_view message) {
    auto [system, x] = at_minimum<Dynamic2>(2, 5);
    spoil(system, x);
    const auto all = covariance(system, x);
    EXPECT_EQ(all.status, CovarianceStatus::InvalidInput);
    EXPECT_EQ(all.message, message);
    EXPECT_EQ(all.matrix.size(), 0);
    const auto nodes = node_covariances(system, x);
    EXPECT_EQ(nodes.status, CovarianceStatus::InvalidInput);
    EXPECT_EQ(nodes.message, message);
  };
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  expect_refused([](auto& s, auto&) { s.anchors(1, 3) = kNan; }, "anchor 3 is not finite");
  expect_refused([](auto&, auto& x) { x(0, 2) = kNan; }, "x of node 2 is not finite");
  expect_refused([](auto& s, auto&) { s.link_stiffness[4] = -1; },
                 "link stiffness 4 is negative or not finite");
  expect_refused([](auto&, auto& x) { x.conservativeResize(2, 4); }, "x must have one column for each node");
  expect_refused([](auto& s, auto&) { s.anchor_stiffness.setZero(); },
                 "node 0 is in a connected component without anchor stiffness");
  expect_refused(
      [](auto& s, auto& x) {
        s = Dynamic2(Topology<>::full(0));
        x.resize(2, 0);
      },
      "system has no nodes");

  auto [system, x] = at_minimum<Fixed2>(2, 4);
  system.link_stiffness.setConstant(std::numeric_limits<double>::max());
  const auto overflow = covariance(system, x);
  EXPECT_EQ(overflow.status, CovarianceStatus::NumericalFailure);
  EXPECT_TRUE(overflow.matrix.array().isNaN().all());
  EXPECT_TRUE(node_covariances(system, x).blocks.array().isNaN().all());

  Dynamic2 loose(Topology<>::full(1));  // its variance exceeds the scalar's range
  loose.anchors.setZero();
  loose.anchor_stiffness << 1e-310;
  EXPECT_EQ(covariance(loose, loose.anchors).status, CovarianceStatus::NumericalFailure);
  EXPECT_EQ(node_covariances(loose, loose.anchors).status, CovarianceStatus::NumericalFailure);
}

TEST(Covariance, FollowsARelabelling) {
  const int n = 100;
  const auto [system, x] = sparse_at_minimum(5, n);
  const auto other = [](int i) { return (37 * i + 11) % n; };
  std::vector<Link> links;
  for (const Link& link : system.links()) links.push_back({other(link.j), other(link.i)});
  Dynamic2 relabelled(Topology<>::from_links(n, links));
  relabelled.rest_length = system.rest_length;
  relabelled.link_stiffness = system.link_stiffness;
  Dynamic2::Points relabelled_x(2, n);
  for (int i = 0; i < n; ++i) {
    relabelled.anchors.col(other(i)) = system.anchors.col(i);
    relabelled.anchor_stiffness[other(i)] = system.anchor_stiffness[i];
    relabelled_x.col(other(i)) = x.col(i);
  }
  const auto nodes = node_covariances(system, x);
  const auto relabelled_nodes = node_covariances(relabelled, relabelled_x);
  ASSERT_TRUE(nodes && relabelled_nodes);
  for (int i = 0; i < n; ++i) {
    EXPECT_LT((relabelled_nodes.of(other(i)) - nodes.of(i)).norm(), 1e-11 * nodes.of(i).norm());
  }
}

TEST(Covariance, HasTheUnitsOfTheSystem) {
  auto [system, x] = at_minimum<Fixed2>(3, 4);
  const auto before = covariance(system, x);
  system.anchor_stiffness *= 4;
  system.link_stiffness *= 4;
  EXPECT_LT((4 * covariance(system, x).matrix - before.matrix).norm(), 1e-12 * before.matrix.norm());
}

// The covariance given the fixed nodes: the conditional one of the others.
TEST(Covariance, OfFixedNodesIsZeroAndConditionsTheOthers) {
  for (const int n : {6, 100}) {
    auto [system, x] = sparse_at_minimum(6, n);
    for (const int node : {1, n - 2}) system.fix(node);
    std::vector<int> free;
    for (int i = 0; i < n; ++i) {
      if (system.is_fixed(i)) continue;
      free.push_back(2 * i);
      free.push_back(2 * i + 1);
    }
    auto unfixed = system;
    for (const int node : {1, n - 2}) unfixed.release(node);
    const Eigen::MatrixXd conditioned = testing::inverse(hessian(unfixed, x)(free, free));
    const auto all = covariance(system, x);
    const auto nodes = node_covariances(system, x);
    ASSERT_TRUE(all && nodes);
    EXPECT_LT((all.matrix(free, free) - conditioned).norm(), 1e-9 * conditioned.norm());
    for (const int node : {1, n - 2}) {
      EXPECT_TRUE(all.matrix.middleCols<2>(2 * node).isZero(0));
      EXPECT_TRUE(nodes.of(node).isZero(0));
    }
    for (std::size_t f = 0; f < free.size(); f += 2) {
      const auto at = static_cast<Eigen::Index>(f);
      EXPECT_LT((nodes.of(free[f] / 2) - conditioned.block<2, 2>(at, at)).norm(), 1e-9 * conditioned.norm());
    }
  }
}

// Other models: the same Hessian through the same function.
TEST(Covariance, OfOtherModels) {
  using System = testing::FixedEllipses;
  System system(Topology<4>::full());
  system.anchors << 0, 10, 0, 10, 0, 0, 10, 10;
  system.set_rest_lengths(system.anchors);
  system.link_stiffness.setConstant(0.5);
  system.anchor_loss.scale = 3;
  for (int i = 0; i < 4; ++i) {
    system.set_anchor_information(i, Eigen::Vector2d(1.0 + i, 0.25).asDiagonal().toDenseMatrix());
  }
  System::Points x = system.anchors;
  x.col(2) += Eigen::Vector2d(0.5, -0.25);
  const auto result = covariance(system, x);
  ASSERT_TRUE(result) << result.message;
  const Eigen::MatrixXd covariance_matrix = result.matrix;
  const Eigen::MatrixXd product = covariance_matrix * hessian(system, x);
  EXPECT_LT((product - Eigen::MatrixXd::Identity(8, 8)).norm(), 1e-12);
}

TEST(Covariance, OfAHundredThousandNodes) {
  const int n = 100000;
  auto [system, x] = testing::sparse_system<Dynamic2>(1, n);
  system.set_rest_lengths(x);  // a minimum that needs no solve
  system.anchors = x;
  const auto begin = std::chrono::steady_clock::now();
  const auto nodes = node_covariances(system, x);
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  ASSERT_TRUE(nodes) << nodes.message;
  std::printf("%d nodes: %.2f s\n", n, seconds);
  // Compared with solves for some columns of the identity.
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> cholesky(sparse_hessian(system, x));
  for (const int node : {0, 4711, 50000, 99999}) {
    Eigen::MatrixX2d columns = Eigen::MatrixX2d::Zero(2 * n, 2);
    columns(2 * node, 0) = columns(2 * node + 1, 1) = 1;
    columns = cholesky.solve(columns).eval();
    const Eigen::Matrix2d expected = columns.middleRows<2>(2 * node);
    EXPECT_LT((nodes.of(node) - expected).norm(), 1e-9 * expected.norm());
  }
}

TEST(CovarianceStatus, HasWords) {
  EXPECT_EQ(to_string(CovarianceStatus::Computed), "computed");
  EXPECT_EQ(to_string(CovarianceStatus::NotPositiveDefinite), "not positive definite");
  EXPECT_FALSE(Covariance<Fixed2>());
}

}  // namespace
}  // namespace asterism
