// Offsets that turn and scale with the constellation: against linear least squares, and finite differences.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <asterism/solver.hpp>
#include <asterism/solver/method/turning_offsets.hpp>
#include <asterism/testing/random_system.hpp>
#include <cmath>
#include <cstdint>
#include <limits>

namespace asterism {
namespace {

using testing::random_points;
using testing::Rng;

template <int Dim>
using System = SpringSystem<double, Dim>;
template <int Dim>
using Turning = TurningOffsets<System<Dim>, Newton<System<Dim>>>;

template <int Dim>
Eigen::Matrix<double, Dim, Dim> random_rotation(Rng& rng) {
  Eigen::Matrix<double, Dim, Dim> M;
  for (double& value : M.reshaped()) value = rng.uniform(-1, 1);
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(M, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::MatrixXd R = svd.matrixU() * svd.matrixV().transpose();
  if (R.determinant() < 0) R.col(0) *= -1;
  return R;
}

// A shape, turned and scaled and then detected with errors.
template <int Dim>
testing::RandomSystem<System<Dim>> random_shape(std::uint64_t seed, int nodes, double error) {
  Rng rng(seed);
  System<Dim> system(Topology<>::full(nodes));
  const auto shape = random_points<System<Dim>>(rng, nodes, -10, 10);
  system.set_rest_offsets(shape);
  for (double& k : system.link_stiffness) k = rng.uniform(0.2, 2);
  for (double& k : system.anchor_stiffness) k = rng.uniform(0.01, 0.1);
  system.anchors = rng.uniform(0.5, 2) * random_rotation<Dim>(rng) * shape +
                   random_points<System<Dim>>(rng, nodes, -error, error);
  system.anchors.colwise() += Eigen::Matrix<double, Dim, 1>::Constant(rng.uniform(-50, 50));
  return {system, system.anchors};
}

// sum k_i |x_i - a_i|^2 + sum k_ij |x_i - x_j - (a, -b; b, a) m_ij|^2 is linear least squares in x, a and b.
System<2>::Points least_squares(const System<2>& system, Eigen::Matrix2d& transform) {
  const int n = system.nodes(), rows = 2 * (n + system.link_count());
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(rows, 2 * n + 2);
  Eigen::VectorXd b = Eigen::VectorXd::Zero(rows);
  for (int i = 0; i < n; ++i) {
    const double w = std::sqrt(system.anchor_stiffness[i]);
    for (int d = 0; d < 2; ++d) A(2 * i + d, 2 * i + d) = w, b[2 * i + d] = w * system.anchors(d, i);
  }
  int row = 2 * n, l = 0;
  for (const Link& link : system.links()) {
    const double w = std::sqrt(system.link_stiffness[l]);
    const Eigen::Vector2d m = system.rest_offset.col(l++);
    for (int d = 0; d < 2; ++d, ++row) {
      A(row, 2 * link.i + d) = w;
      A(row, 2 * link.j + d) = -w;
      A(row, 2 * n) = -w * m[d];
      A(row, 2 * n + 1) = d == 0 ? w * m.y() : -w * m.x();
    }
  }
  const Eigen::VectorXd solution = A.colPivHouseholderQr().solve(b);
  transform << solution[2 * n], -solution[2 * n + 1], solution[2 * n + 1], solution[2 * n];
  return solution.head(2 * n).reshaped(2, n);
}

TEST(TurningOffsets, OfThePlaneAreLeastSquares) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const auto [system, start] = random_shape<2>(seed, 6, 2);
    Eigen::Matrix2d transform;
    const auto expected = least_squares(system, transform);
    Turning<2> turning;
    System<2>::Points x = start;
    const Summary summary = turning.solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_LT((x - expected).cwiseAbs().maxCoeff(), 1e-5) << seed;
    EXPECT_LT((turning.transform() - transform).norm(), 1e-6);
    EXPECT_LT(summary.iterations, 20) << summary;  // extrapolated: weak anchors alone would take hundreds
    EXPECT_LE(summary.final_energy, summary.initial_energy);
    // Whatever the start.
    Rng rng(seed);
    x = random_points<System<2>>(rng, 6, -100, 100);
    EXPECT_EQ(turning.solve(system, x).status, Status::Converged);
    EXPECT_LT((x - expected).cwiseAbs().maxCoeff(), 1e-5) << seed;
  }
}

// The energy as a function of x and T falls in no direction: by finite differences of both.
template <int Dim>
void expect_stationary(const System<Dim>& system, const typename System<Dim>::Points& x,
                       const Eigen::Matrix<double, Dim, Dim>& T, bool scales) {
  const auto at = [&](const auto& points, const Eigen::MatrixXd& transform) {
    System<Dim> turned = system;
    turned.rest_offset = transform * system.rest_offset;
    return energy(turned, points);
  };
  const double h = 1e-5, here = at(x, T), curvature = system.link_stiffness.sum() * 100;
  for (int c = 0; c < x.size(); ++c) {
    typename System<Dim>::Points ahead = x, behind = x;
    ahead.data()[c] += h, behind.data()[c] -= h;
    EXPECT_NEAR((at(ahead, T) - at(behind, T)) / (2 * h), 0, 1e-4);
  }
  for (int a = 0; a < Dim; ++a) {
    for (int b = a + 1; b < Dim; ++b) {
      Eigen::MatrixXd turn = Eigen::MatrixXd::Identity(Dim, Dim);
      turn(a, a) = turn(b, b) = std::cos(h), turn(b, a) = std::sin(h), turn(a, b) = -std::sin(h);
      EXPECT_NEAR((at(x, turn * T) - at(x, turn.transpose() * T)) / (2 * h), 0, 1e-6 * (here + curvature));
    }
  }
  if (scales) {
    EXPECT_NEAR((at(x, (1 + h) * T) - at(x, (1 - h) * T)) / (2 * h), 0, 1e-6 * (here + curvature));
  }
}

TEST(TurningOffsets, AreStationaryInBoth) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    for (const bool scales : {true, false}) {
      auto [system, start] = random_shape<3>(seed, 7, 2);
      if (seed % 2 == 0) system.rest_length.setConstant(1.5);  // a length from the end of the offset
      if (seed % 3 == 0) system.loads = System<3>::Points::Constant(3, 7, 0.1);
      Turning<3> turning;
      turning.options.scale = scales;
      System<3>::Points x = start;
      const Summary summary = turning.solve(system, x);
      EXPECT_EQ(summary.status, Status::Converged) << summary;
      expect_stationary<3>(system, x, turning.transform(), scales);
      const double scale = std::cbrt(turning.transform().determinant());
      EXPECT_GT(scale, 0);
      if (!scales) {
        EXPECT_NEAR(scale, 1, 1e-12);
      }
      EXPECT_LT((turning.transform().transpose() * turning.transform() -
                 scale * scale * Eigen::Matrix3d::Identity())
                    .norm(),
                1e-12 * scale * scale * 10);
    }
  }
}

// A turned, scaled and moved problem has the turned, scaled and moved solution.
TEST(TurningOffsets, TurnWithTheAnchors) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const auto [system, start] = random_shape<3>(seed, 6, 1);
    Rng rng(seed + 100);
    const Eigen::Matrix3d R = random_rotation<3>(rng);
    System<3> other = system;
    other.anchors = 1.7 * R * system.anchors;
    Turning<3> turning;
    System<3>::Points x = start, y = other.anchors;
    EXPECT_EQ(turning.solve(system, x).status, Status::Converged);
    const Eigen::Matrix3d T = turning.transform();
    EXPECT_EQ(turning.solve(other, y).status, Status::Converged);
    EXPECT_LT((y - 1.7 * R * x).cwiseAbs().maxCoeff(), 1e-4) << seed;
    EXPECT_LT((turning.transform() - 1.7 * R * T).norm(), 1e-5) << seed;
  }
}

// A part that was not seen is where the others say.
TEST(TurningOffsets, FindThePartThatWasNotSeen) {
  auto [system, start] = random_shape<2>(3, 6, 0);
  const System<2>::Points truth = system.anchors;
  system.anchor_stiffness[2] = 0;
  system.anchors.col(2).setZero();
  System<2>::Points x = system.anchors;
  Turning<2> turning;
  EXPECT_EQ(turning.solve(system, x).status, Status::Converged);
  EXPECT_LT((x - truth).cwiseAbs().maxCoeff(), 1e-5);
}

TEST(TurningOffsets, RefuseWhatTheyCannotTake) {
  auto [system, start] = random_shape<2>(1, 4, 1);
  Turning<2> turning;
  const auto says = [&, &system = system, &start = start](const char* expected) {
    System<2>::Points x = start;
    const Summary summary = turning.solve(system, x);
    EXPECT_EQ(summary.status, Status::InvalidInput);
    EXPECT_EQ(std::string_view(summary.message), expected);
    EXPECT_EQ(x, start);
  };
  turning.options.gap = 1e-3;
  says("option gap: no lower bound is known for offsets that turn");
  turning.options.gap = 0;
  system.anchors(0, 1) = std::numeric_limits<double>::quiet_NaN();
  says("anchor 1 is not finite");
  system.anchors = start;
  system.rest_offset.resize(2, 0);
  says("the system's links have no offsets");
  EXPECT_EQ(turning.solve(system, system.anchors).status, Status::InvalidInput);  // shares memory
}

}  // namespace
}  // namespace asterism
