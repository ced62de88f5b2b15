#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <asterism/trackers/constellation/stiffness.hpp>
#include <asterism/trackers/constellation/transform.hpp>
#include <numbers>

namespace asterism {
namespace {

Eigen::Matrix2Xd square() {
  Eigen::Matrix2Xd points(2, 4);
  points << 10, 30, 10, 30,  //
      5, 5, 45, 45;
  return points;
}

TEST(FitTransform, RecoversASimilarity) {
  const Eigen::Matrix2Xd from = square();
  for (const double angle : {0.0, 0.4, -2.5, std::numbers::pi - 1e-3})
    for (const double scale : {0.5, 1.0, 1.3}) {
      PlaneTransform truth{.scale = scale, .angle = angle, .translation = {3, -8}};
      Eigen::Matrix2Xd to(2, 4);
      for (int i = 0; i < 4; ++i) to.col(i) = truth(from.col(i));
      const PlaneTransform found = fit_transform(from, to, TransformModel::Similarity);
      EXPECT_NEAR(found.scale, scale, 1e-12);
      EXPECT_NEAR(found.angle, angle, 1e-12);
      EXPECT_LT((found.translation - truth.translation).norm(), 1e-10);
    }
}

// The residual of the fit is no larger than that of Eigen's umeyama and of perturbed transforms.
TEST(FitTransform, IsTheLeastSquaresFit) {
  const Eigen::Matrix2Xd from = square();
  Eigen::Matrix2Xd to = 1.1 * from;
  to.col(0) += Eigen::Vector2d(2, 3);
  to.col(2) += Eigen::Vector2d(-1, 0.5);
  const auto residual = [&](const PlaneTransform& t) {
    double sum = 0;
    for (int i = 0; i < 4; ++i) sum += (t(from.col(i)) - to.col(i)).squaredNorm();
    return sum;
  };
  const PlaneTransform found = fit_transform(from, to, TransformModel::Similarity);
  const Eigen::Matrix3d peer = Eigen::umeyama(Eigen::MatrixXd(from), Eigen::MatrixXd(to), true);
  double peer_residual = 0;
  for (int i = 0; i < 4; ++i)
    peer_residual +=
        (peer.topLeftCorner<2, 2>() * from.col(i) + peer.topRightCorner<2, 1>() - to.col(i)).squaredNorm();
  EXPECT_NEAR(residual(found), peer_residual, 1e-9);
  for (const TransformModel model : {TransformModel::Euclidean, TransformModel::Similarity}) {
    const PlaneTransform best = fit_transform(from, to, model);
    for (const double d : {-1e-3, 1e-3}) {
      PlaneTransform other = best;
      other.translation.x() += d;
      EXPECT_GT(residual(other), residual(best));
      other = best;  // rotated about the centroid
      other.angle += d;
      other.translation += best(from.rowwise().mean()) - other(from.rowwise().mean());
      EXPECT_GT(residual(other), residual(best));
    }
  }
}

TEST(FitTransform, OfPointsThatDoNotDetermineIt) {
  const Eigen::Matrix2Xd none(2, 0), one = square().leftCols(1), same = one.replicate(1, 4);
  for (const TransformModel model : {TransformModel::Euclidean, TransformModel::Similarity}) {
    EXPECT_EQ(fit_transform(none, none, model)({3, 4}), Eigen::Vector2d(3, 4));
    const PlaneTransform moved = fit_transform(one, one.array() + 2, model);
    EXPECT_EQ(moved.scale, 1);
    EXPECT_EQ(moved({0, 0}), Eigen::Vector2d(2, 2));
    EXPECT_EQ(fit_transform(same, square(), model).scale, 1);
    EXPECT_EQ(fit_transform(square(), same, model).scale, 1);
  }
}

TEST(FitRobustTransform, IgnoresWhatDoesNotAgree) {
  Eigen::Matrix2Xd from(2, 40), to(2, 40);
  const PlaneTransform truth{1.2, 0.3, {5, -7}};
  for (int i = 0; i < 40; ++i) {
    from.col(i) = Eigen::Vector2d(i * 37 % 41, i * 23 % 43);
    to.col(i) = i % 5 < 3 ? truth(from.col(i)) : Eigen::Vector2d(i * 17 % 97, i * 61 % 89);
  }
  const Eigen::VectorXd weights = Eigen::VectorXd::Ones(40);
  const RobustTransform found = fit_robust_transform(from, to, weights, TransformModel::Similarity, 1, {});
  EXPECT_NEAR(found.transform.scale, 1.2, 0.01);
  EXPECT_NEAR(found.transform.angle, 0.3, 0.01);
  EXPECT_NEAR(found.support, 0.6, 0.05);
  EXPECT_LT((truth.inverse()(truth({3, 4})) - Eigen::Vector2d(3, 4)).norm(), 1e-12);
  const RobustTransform none =
      fit_robust_transform(from, to, 0 * weights, TransformModel::Similarity, 1, truth);
  EXPECT_EQ(none.support, 0);
  EXPECT_EQ(none.transform.scale, truth.scale);
}

// One point does not determine angle and scale: they are kept.
TEST(FitRobustTransform, KeepsWhatThePointsDoNotDetermine) {
  const PlaneTransform start{1.4, 0.5, {3, 4}};
  Eigen::Matrix2Xd from(2, 3), to(2, 3);
  from << 0.1, 7, -5, 0.3, 2, 11;
  to << 20.7, 1, 60, -30.1, 90, 8;
  const auto expect_moved = [&](const Eigen::Matrix2Xd& a, const Eigen::Matrix2Xd& b,
                                const Eigen::VectorXd& weights, TransformModel model) {
    const RobustTransform found = fit_robust_transform(a, b, weights, model, 2, start);
    EXPECT_EQ(found.transform.scale, start.scale);
    EXPECT_EQ(found.transform.angle, start.angle);
    EXPECT_NEAR(found.support, 1, 1e-12);
    EXPECT_LT((found.transform(a.col(0)) - b.col(0)).norm(), 1e-12);
  };
  for (const TransformModel model : {TransformModel::Euclidean, TransformModel::Similarity}) {
    expect_moved(from.leftCols(1), to.leftCols(1), Eigen::VectorXd::Ones(1), model);
    expect_moved(from, to, Eigen::Vector3d(0.7, 0, 0), model);
    // Coincident points, whose mean is rounded.
    expect_moved(from.col(0).replicate(1, 7), to.col(0).replicate(1, 7), Eigen::VectorXd::Constant(7, 0.3),
                 model);
  }
}

TEST(Stiffness, FollowsTheEquations) {
  Evidence evidence;
  evidence.peak = 0.6;
  evidence.covariance << 10, 1, 1, 20;
  EXPECT_DOUBLE_EQ(static_stiffness(evidence), 0.6 / 30);
  evidence.peak = 0;
  EXPECT_GT(static_stiffness(evidence), 0);
  EXPECT_DOUBLE_EQ(dynamic_stiffness(40, 50), 0.0625);
  EXPECT_DOUBLE_EQ(dynamic_stiffness(40, 40), 0);
  EXPECT_EQ(dynamic_stiffness(0, 3), 0);
}

}  // namespace
}  // namespace asterism
