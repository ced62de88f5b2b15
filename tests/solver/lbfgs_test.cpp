// The pieces of L-BFGS, with and without kernels for wide vectors: the pairs against the update of a dense
// matrix, the steps of its metric against Eigen's, energies and gradients against the walk over springs.
#include <gtest/gtest.h>

#include <asterism/solver/linear/dense_cholesky.hpp>
#include <asterism/solver/method/descent.hpp>
#include <asterism/solver/method/lbfgs_pairs.hpp>
#include <cmath>
#include <deque>
#include <limits>
#include <type_traits>

#include "listed_links.hpp"
#include "matrices.hpp"
#include "test_systems.hpp"

namespace asterism {
namespace {

// One update of an approximation of the inverse Hessian (Nocedal & Wright 2006, Eq. 6.17).
Eigen::MatrixXd updated(const Eigen::MatrixXd& H, const Eigen::VectorXd& step,
                        const Eigen::VectorXd& change) {
  const Eigen::Index n = H.rows();
  const double inverse = 1 / step.dot(change);
  const Eigen::MatrixXd left = Eigen::MatrixXd::Identity(n, n) - inverse * step * change.transpose();
  return left * H * left.transpose() + inverse * step * step.transpose();
}

// Steps along whatever direction on a random positive definite quadratic, with a metric that is another one.
template <typename Pairs>
void expect_like_dense_updates(Pairs pairs, int size, std::size_t memory) {
  const auto random_definite = [&] {
    const Eigen::MatrixXd A = Eigen::MatrixXd::Random(size, size);
    return Eigen::MatrixXd(A * A.transpose() + Eigen::MatrixXd::Identity(size, size));
  };
  const Eigen::MatrixXd A = random_definite(), inverse_metric = testing::inverse(random_definite());
  Eigen::VectorXd x = Eigen::VectorXd::Random(size), direction;
  std::deque<std::pair<Eigen::VectorXd, Eigen::VectorXd>> remembered;
  pairs.clear(size);
  EXPECT_TRUE(pairs.empty());
  for (int round = 0; round < 12; ++round) {
    const Eigen::VectorXd g = A * x, descent = -inverse_metric * g;
    const double slope = pairs.direction(descent, g, direction);
    EXPECT_NEAR(slope, g.dot(direction), 1e-13 * g.norm() * direction.norm()) << size << " " << round;
    Eigen::MatrixXd H = inverse_metric;
    if (!remembered.empty()) {
      const auto& [step, change] = remembered.back();
      H *= step.dot(change) / change.dot(inverse_metric * change);
    }
    for (const auto& [step, change] : remembered) H = updated(H, step, change);
    EXPECT_LT((direction + H * g).norm(), 1e-9 * direction.norm()) << size << " " << round;

    // Not always the best length, and now and then one that is not to be remembered: the slope hardly
    // changes.
    const double length = round % 5 == 4 ? 1e-5 : 0.4 + 0.2 * (round % 3);
    const double step = length * -slope / direction.dot(A * direction);
    const Eigen::VectorXd before = x, g_after = A * (x + step * direction);
    x += step * direction;
    pairs.add(step, direction, slope, g_after.dot(direction), g_after, g,
              Eigen::VectorXd(-inverse_metric * g_after), descent);
    if (round % 5 == 4) continue;
    remembered.emplace_back(step * direction, g_after - g);
    if (remembered.size() > memory) remembered.pop_front();
  }
}

TEST(LbfgsPairs, GiveTheDirectionOfDenseUpdates) {
  for (const int size : {1, 2, 3, 5, 8, 11, 12, 13, 16, 17, 32, 41, 80}) {
    constexpr int kAny = Eigen::Dynamic;
    expect_like_dense_updates(detail::LbfgsPairs<double, kAny, kAny, 4, true>(), size, 4);
    expect_like_dense_updates(detail::LbfgsPairs<double, kAny, kAny, 6, true>(), size, 6);
    expect_like_dense_updates(detail::LbfgsPairs<double, kAny, kAny, 6, false>(), size, 6);
    expect_like_dense_updates(detail::LbfgsPairs<double, kAny, 80, 4, true>(), size, 4);
  }
}

// Whatever was remembered, what is not finite leaves nothing behind.
TEST(LbfgsPairs, ForgetWhatOverflows) {
  detail::LbfgsPairs<double, Eigen::Dynamic, Eigen::Dynamic, 4, true> pairs;
  const Eigen::VectorXd one = Eigen::VectorXd::Ones(20), huge = 1e300 * one;
  pairs.clear(20);
  pairs.add(1, one, -1, 1, Eigen::VectorXd(huge), Eigen::VectorXd(-huge), Eigen::VectorXd(-huge), huge);
  EXPECT_TRUE(pairs.empty());
  pairs.add(1, Eigen::VectorXd(-one), -40, -20, one, Eigen::VectorXd(2 * one), Eigen::VectorXd(-one),
            Eigen::VectorXd(-2 * one));
  EXPECT_FALSE(pairs.empty());
  Eigen::VectorXd direction;
  pairs.direction(Eigen::VectorXd(-one), one, direction);
  EXPECT_LT((direction + one).norm(), 1e-12);
}

template <typename Scalar, int kDim>
void expect_steps_like_eigens() {
  using Solver = detail::SpdSolver<Scalar, kDim, Eigen::Dynamic, Eigen::Dynamic>;
  using Points = typename Solver::Points;
  constexpr Scalar kDigits = 256 * std::numeric_limits<Scalar>::epsilon();
  Solver solver;
  for (int n = 1; n <= 70; ++n) {
    const Eigen::MatrixXd random = Eigen::MatrixXd::Random(n, n);
    const Eigen::MatrixXd A = random * random.transpose() + Eigen::MatrixXd::Identity(n, n);
    solver.matrix(n) = A.cast<Scalar>().template triangularView<Eigen::Lower>();
    ASSERT_TRUE(solver.factorize(kDigits, false)) << n;
    const Points b = Points::Random(kDim, n), start = Points::Random(kDim, n);
    Points x = start;
    solver.descend(b, x);
    const Eigen::MatrixXd expected = b.template cast<double>() * testing::inverse(A);
    const double error = ((start - x).template cast<double>() - expected).norm();
    EXPECT_LT(error, kDigits * Scalar(n) * (start.norm() + Scalar(expected.norm()))) << n;
    solver.matrix(n) = -solver.matrix(n).eval();
    EXPECT_FALSE(solver.factorize(kDigits, false)) << n;
  }
}

TEST(SpdSolver, StepsAreLikeEigens) {
  expect_steps_like_eigens<double, 1>();
  expect_steps_like_eigens<double, 2>();
  expect_steps_like_eigens<double, 3>();
  expect_steps_like_eigens<double, 5>();
  expect_steps_like_eigens<float, 2>();
}

template <typename System>
void expect_gradients_like_the_walk(int nodes) {
  using Points = typename System::Points;
  const auto full = System::TopologyType::full(nodes);
  testing::Rng rng(static_cast<std::uint64_t>(nodes));
  detail::DescentState<System> state;
  int searches = 0;
  for (int hostile = 0; hostile < 7; ++hostile) {
    auto [at_once, x] = testing::random_system<System>(rng, full);
    switch (hostile) {
      case 1:
        at_once.link_stiffness[0] = 0;
        at_once.rest_length[0] = std::numeric_limits<double>::max();
        break;
      case 2:  // an anchor that means nothing
        at_once.anchor_stiffness[0] = 0;
        at_once.anchors.col(0).setConstant(1e150);
        break;
      case 3:
        x.col(nodes - 1) = x.col(0);
        break;
      case 4:  // whose square underflows
        x.col(0).setZero();
        x.col(1).setConstant(1e-160);
        break;
      case 5:
        at_once.fix(nodes / 2);
        break;
      case 6:
        at_once.loads = Points::Random(System::kDim, nodes);
        break;
      default:
        break;
    }
    const System one_by_one = testing::with_listed_links(at_once);
    Points g;
    const double E = energy_and_gradient(one_by_one, x, g);
    Summary summary;
    state.start(at_once, x, summary);
    EXPECT_NEAR(state.energy(), E, 1e-14 * std::abs(E)) << nodes << " " << hostile;
    EXPECT_LT((state.gradient() - g).norm(), 1e-14 * (g.norm() + E)) << nodes << " " << hostile;
    if (hostile == 5) {
      EXPECT_EQ(state.gradient().col(nodes / 2).norm(), 0);
    }

    // A step along the gradient's negative, some of which cross the rounding of what is shorter.
    const Points direction = -g, start = x;
    double step = 0.1 / (at_once.anchor_stiffness.maxCoeff() + at_once.link_stiffness.sum());
    if (!(g.norm() > 1e-6 * E) || !state.search(at_once, x, direction, -g.squaredNorm(), step, summary))
      continue;
    EXPECT_LT((x - (start + step * direction)).norm(), 1e-14 * (start.norm() + step * g.norm()));
    Points there;
    const double lower = energy_and_gradient(one_by_one, x, there);
    EXPECT_NEAR(state.energy(), lower, 1e-14 * std::abs(E)) << nodes << " " << hostile;
    EXPECT_LT((state.gradient() - there).norm(), 1e-14 * (g.norm() + E)) << nodes << " " << hostile;
    EXPECT_NEAR(state.slope(), there.cwiseProduct(direction).sum(), 1e-13 * (g.norm() + E) * g.norm());
    ++searches;
  }
  EXPECT_GE(searches, 4) << nodes;
}

TEST(DescentState, GradientsAreLikeTheWalkOverSprings) {
  for (const int nodes : {2, 5, 6, 7, 8, 9, 15, 16, 17, 24, 41, 70}) {
    expect_gradients_like_the_walk<SpringSystem<double, 2>>(nodes);
    expect_gradients_like_the_walk<SpringSystem<double, 3>>(nodes);
  }
  expect_gradients_like_the_walk<SpringSystem<double, 2, 8>>(8);
  expect_gradients_like_the_walk<SpringSystem<double, 2, Eigen::Dynamic, 12>>(11);
}

}  // namespace
}  // namespace asterism
