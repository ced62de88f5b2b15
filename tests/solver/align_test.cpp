#include <gtest/gtest.h>

#include <Eigen/LU>
#include <Eigen/SVD>
#include <asterism/solver/energy/align.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/problem/validate.hpp>
#include <asterism/testing/random_system.hpp>
#include <limits>

#include "test_systems.hpp"

namespace asterism {
namespace {

/// The textbook method: SVD of the covariance, with the last singular vector negated if the result would be
/// a reflection. In double and of any size: an SVD per type would take long to compile.
Eigen::MatrixXd aligned_by_svd(const Eigen::MatrixXd& anchors, const Eigen::VectorXd& k,
                               const Eigen::MatrixXd& x, bool allow_reflection) {
  const Eigen::VectorXd centre = x * k / k.sum();
  const Eigen::VectorXd anchor_centre = anchors * k / k.sum();
  const Eigen::MatrixXd M =
      (anchors.colwise() - anchor_centre) * k.asDiagonal() * (x.colwise() - centre).transpose();
  const Eigen::JacobiSVD<Eigen::MatrixXd, Eigen::NoQRPreconditioner> svd(
      M, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::MatrixXd U = svd.matrixU();
  const Eigen::MatrixXd V = svd.matrixV();
  if (!allow_reflection && (U * V.transpose()).determinant() < 0) U.col(U.cols() - 1) *= -1;
  return (U * V.transpose() * (x.colwise() - centre)).colwise() + anchor_centre;
}

template <typename System_>
class Alignment : public ::testing::Test {
 public:
  using System = System_;
  using Points = typename System::Points;
  using Scalar = typename System::Scalar;
  static constexpr int kSize = System::kNodes == Eigen::Dynamic ? 7 : System::kNodes;
  static constexpr double kTolerance = std::is_same_v<Scalar, double> ? 1e-12 : 1e-4;

  static testing::RandomSystem<System> random(std::uint64_t seed) {
    testing::Rng rng(seed);
    return testing::random_system<System>(rng, System::TopologyType::full(kSize));
  }

  static double anchor_energy(System system, const Points& x) {
    system.link_stiffness.setZero();
    return static_cast<double>(energy(system, x));
  }

  static Points by_svd(const System& system, const Points& x, bool allow_reflection) {
    return aligned_by_svd(system.anchors.template cast<double>(),
                          system.anchor_stiffness.template cast<double>(), x.template cast<double>(),
                          allow_reflection)
        .template cast<Scalar>();
  }
};

using Systems = ::testing::Types<testing::Fixed2, testing::Bounded3f, testing::Space,
                                 SpringSystem<double, 4, 5>, testing::Line>;
TYPED_TEST_SUITE(Alignment, Systems);

TYPED_TEST(Alignment, IsTheTextbooks) {
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    const auto [system, start] = this->random(seed);
    for (const bool reflect : {false, true}) {
      const auto x = rigid_alignment(system, start, reflect);
      const auto expected = this->by_svd(system, start, reflect);
      EXPECT_NEAR(this->anchor_energy(system, x), this->anchor_energy(system, expected),
                  this->kTolerance * this->anchor_energy(system, start))
          << "seed " << seed;
    }
  }
}

TYPED_TEST(Alignment, KeepsSpringsAndNeverRaisesTheEnergy) {
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    const auto [system, start] = this->random(seed);
    for (const bool reflect : {false, true}) {
      const auto x = rigid_alignment(system, start, reflect);
      const double before = double(energy(system, start));
      EXPECT_LE(double(energy(system, x)), before * (1 + this->kTolerance));
      for (const Link& link : system.links()) {
        EXPECT_NEAR(double((x.col(link.i) - x.col(link.j)).norm()),
                    double((start.col(link.i) - start.col(link.j)).norm()), this->kTolerance * 10);
      }
      const auto again = rigid_alignment(system, x, reflect);
      constexpr bool kDouble = std::is_same_v<typename TypeParam::Scalar, double>;
      EXPECT_LT(double((again - x).norm()), kDouble ? 1e-6 : 1e-2);
    }
  }
}

TYPED_TEST(Alignment, UndoesARigidMotion) {
  using Value = typename TypeParam::Scalar;
  const auto [system, start] = this->random(3);
  typename TypeParam::Points x = system.anchors;
  if constexpr (TypeParam::kDim > 1) {
    x.row(0) = Value(0.28) * system.anchors.row(0) - Value(0.96) * system.anchors.row(1);
    x.row(1) = Value(0.96) * system.anchors.row(0) + Value(0.28) * system.anchors.row(1);
  }
  x.array() += 5;
  EXPECT_LT(double((rigid_alignment(system, x) - system.anchors).norm()), 100 * this->kTolerance);
  x.row(0) *= -1;
  EXPECT_GT(double((rigid_alignment(system, x) - system.anchors).norm()), 1e-3);
  EXPECT_LT(double((rigid_alignment(system, x, true) - system.anchors).norm()), 100 * this->kTolerance);
}

TYPED_TEST(Alignment, OneAnchorTranslates) {
  auto [system, start] = this->random(4);
  system.anchor_stiffness.setZero();
  system.anchor_stiffness[1] = 2;
  const auto x = rigid_alignment(system, start);
  const typename TypeParam::Point shift = system.anchors.col(1) - start.col(1);
  EXPECT_LT(double((x - (start.colwise() + shift)).norm()), 10 * this->kTolerance);
}

TYPED_TEST(Alignment, CoincidentPointsTranslate) {
  auto [system, start] = this->random(5);
  auto x = start;
  x.colwise() = start.col(0).eval();
  const auto together = rigid_alignment(system, x);
  EXPECT_LT(double((together.colwise() - together.col(0)).norm()), this->kTolerance);
  system.anchors.setConstant(7);  // with coincident anchors a spread constellation does not rotate
  const auto spread = rigid_alignment(system, start);
  const typename TypeParam::Point shift = spread.col(0) - start.col(0);
  EXPECT_LT(double((spread - (start.colwise() + shift)).norm()), 100 * this->kTolerance);
}

TYPED_TEST(Alignment, LeavesAloneWhatItCannotImprove) {
  auto [system, start] = this->random(6);
  EXPECT_EQ(rigid_alignment(system, system.anchors), system.anchors);
  system.anchor_stiffness.setZero();
  EXPECT_EQ(rigid_alignment(system, start), start);
  system.anchor_stiffness.setConstant(std::numeric_limits<typename TypeParam::Scalar>::max());
  EXPECT_EQ(rigid_alignment(system, start), start);
  system.anchor_stiffness.setOnes();
  const typename TypeParam::Points huge =
      start * (std::numeric_limits<typename TypeParam::Scalar>::max() / 4);
  EXPECT_TRUE(rigid_alignment(system, huge).allFinite());
}

// Two opposite corners are swapped: every rotation fits equally well.
TEST(Alignment2, AmbiguousAngleIsNoRotation) {
  SpringSystem<double, 2, 4> system(Topology<4>::full());
  system.anchors << 1, 0, -1, 0, 0, 1, 0, -1;
  system.anchor_stiffness.setOnes();
  Eigen::Matrix<double, 2, 4> x = system.anchors;
  x.row(1) *= -1;
  EXPECT_EQ(rigid_alignment(system, x), x);
  EXPECT_LT((rigid_alignment(system, x, true) - system.anchors).norm(), 1e-14);
}

}  // namespace
}  // namespace asterism
