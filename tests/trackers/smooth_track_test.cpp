// Boxes that are smoothed after the fact, against dense algebra, a System of terms, and known paths.

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <asterism/solver/terms/solve.hpp>
#include <asterism/trackers/around/smooth_track.hpp>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <random>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

namespace asterism {
namespace {

using Track = std::vector<TrackResult>;

TrackResult result_at(const cv::Rect2d& box, std::optional<Eigen::Matrix3d> covariance = {}) {
  TrackResult result;
  result.box = box;
  result.covariance = covariance;
  return result;
}

// Centres (2 x frames) or logarithms of the size (1 x frames), from those of the first box on.
Eigen::MatrixXd path_of(const Track& track, int dim) {
  Eigen::MatrixXd path(dim, static_cast<Eigen::Index>(track.size()));
  for (std::size_t t = 0; t < track.size(); ++t) {
    const cv::Rect2d& box = track[t].box;
    const auto column = static_cast<Eigen::Index>(t);
    if (dim == 2)
      path.col(column) = Eigen::Vector2d(box.x + box.width / 2, box.y + box.height / 2);
    else
      path(0, column) = std::log(box.area()) / 2;
  }
  return path.colwise() - path.col(0).eval();
}

// A path whose velocity changes at random, seen with errors of random covariances.
Track random_track(int frames, unsigned seed, double motion = 0.3, double noise = 2, Track* truth = nullptr) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  Eigen::Vector3d at(0, 0, 0), velocity(1, -0.5, 0.002);
  Track track;
  for (int t = 0; t < frames; ++t) {
    const auto box = [](const Eigen::Vector3d& p) {
      const Size2 size = std::exp(p.z()) * Size2(40, 60);
      return box_around(Point2(200 + p.x(), 150 + p.y()), size);
    };
    const Eigen::Matrix3d root =
        Eigen::Vector3d(noise, noise, noise / 50).asDiagonal() *
        (Eigen::Matrix3d::Identity() + 0.3 * Eigen::Matrix3d::NullaryExpr([&] { return normal(random); }));
    const Eigen::Vector3d error = root * Eigen::Vector3d::NullaryExpr([&] { return normal(random); });
    if (truth != nullptr) truth->push_back(result_at(box(at)));
    track.push_back(t == 0 ? result_at(box(at)) : result_at(box(at + error), root * root.transpose()));
    velocity += Eigen::Vector3d(motion, motion, motion / 100).cwiseProduct(Eigen::Vector3d::NullaryExpr([&] {
      return normal(random);
    }));
    at += velocity;
  }
  return track;
}

// The chain of one quantity as dense matrices over the coordinates of the frames after the first.
struct Dense {
  Eigen::MatrixXd covariance, differences;  // C and D, the second differences
  Eigen::VectorXd seen;

  Dense(const Track& track, int dim) {
    const auto frames = static_cast<Eigen::Index>(track.size());
    seen = path_of(track, dim).rightCols(frames - 1).reshaped();
    covariance = Eigen::MatrixXd::Zero(seen.size(), seen.size());
    for (Eigen::Index t = 1; t < frames; ++t)
      covariance.block((t - 1) * dim, (t - 1) * dim, dim, dim) =
          track[static_cast<std::size_t>(t)].covariance->block(dim == 2 ? 0 : 2, dim == 2 ? 0 : 2, dim, dim);
    Eigen::MatrixXd all = Eigen::MatrixXd::Zero((frames - 2) * dim, frames * dim);
    for (Eigen::Index row = 0; row < all.rows(); ++row) {
      all(row, row) = all(row, row + 2 * dim) = 1;
      all(row, row + dim) = -2;
    }
    differences = all.rightCols(seen.size());  // the first position is 0
  }

  // Of the second differences of what was seen, for a = 1: no velocity contributes to them.
  Eigen::MatrixXd of_differences(double ratio) const {
    const Eigen::MatrixXd motion = ratio * Eigen::MatrixXd::Identity(differences.rows(), differences.rows());
    return differences * covariance * differences.transpose() + motion;
  }
  double scale(double ratio) const {
    const Eigen::VectorXd z = differences * seen;
    return z.dot(of_differences(ratio).llt().solve(z)) / static_cast<double>(z.size());
  }
  // The logarithm of the probability of these differences at the most probable a, up to a constant.
  double evidence(double ratio) const {
    const Eigen::MatrixXd factor = of_differences(ratio).llt().matrixL();
    return -static_cast<double>(differences.rows()) / 2 * std::log(scale(ratio)) -
           factor.diagonal().array().log().sum();
  }
  Eigen::MatrixXd hessian(double ratio) const {
    return covariance.inverse() + differences.transpose() * differences / ratio;
  }
};

// The ratio q / a of smoothed boxes: with it, C^-1 (y - x) = D^T D x / ratio.
double ratio_of(const Dense& dense, const Eigen::VectorXd& smoothed) {
  const Eigen::VectorXd pull = dense.covariance.llt().solve(dense.seen - smoothed),
                        bend = dense.differences.transpose() * (dense.differences * smoothed);
  EXPECT_LT((pull / pull.norm() - bend / bend.norm()).norm(), 1e-5) << "a minimum for no ratio";
  return bend.norm() / pull.norm();
}

TEST(SmoothTrack, IsThePosteriorOfTheMostProbableScales) {
  for (const unsigned seed : {1u, 2u, 3u}) {
    const Track track = random_track(40, seed), smoothed = smooth_track(track);
    ASSERT_EQ(smoothed.size(), track.size());
    EXPECT_EQ(smoothed[0].box, track[0].box);
    EXPECT_TRUE(smoothed[0].covariance->isZero());
    for (const int dim : {2, 1}) {
      SCOPED_TRACE(dim);
      const Dense dense(track, dim);
      const double ratio = ratio_of(dense, path_of(smoothed, dim).rightCols(39).reshaped());
      double best = -std::numeric_limits<double>::infinity();
      for (double at = std::log(ratio) - 12; at < std::log(ratio) + 12; at += 0.2)
        best = std::max(best, dense.evidence(std::exp(at)));
      EXPECT_LT(best - dense.evidence(ratio), 1e-3);
      const Eigen::MatrixXd posterior = dense.scale(ratio) * dense.hessian(ratio).inverse();
      for (Eigen::Index t = 1; t < 40; ++t) {
        const Eigen::Matrix3d& found = *smoothed[static_cast<std::size_t>(t)].covariance;
        const Eigen::Index first = dim == 2 ? 0 : 2;
        EXPECT_TRUE(found.block(first, first, dim, dim)
                        .isApprox(posterior.block((t - 1) * dim, (t - 1) * dim, dim, dim), 1e-5))
            << t;
      }
    }
  }
}

TEST(SmoothTrack, IsTheMinimumOfASystemOfAnchorsAndDifferences) {
  const Track track = random_track(60, 4), smoothed = smooth_track(track);
  const double ratio = ratio_of(Dense(track, 2), path_of(smoothed, 2).rightCols(59).reshaped());
  System system(60, 2);
  system.fix(0);
  Eigen::MatrixXd x = path_of(track, 2);
  Eigen::MatrixXd& information = system.add_anchors(x, System::all(1)).values("information");
  information = Eigen::Matrix2d::Identity().reshaped().replicate(1, 60);
  for (Eigen::Index t = 1; t < 60; ++t)
    information.col(t) =
        track[static_cast<std::size_t>(t)].covariance->topLeftCorner<2, 2>().inverse().reshaped();
  Eigen::Matrix3Xi nodes(3, 58);
  for (int t = 0; t < 58; ++t) nodes.col(t) << t, t + 1, t + 2;
  system.add_differences(nodes, System::all(1 / ratio));
  const Summary summary = solve(system, x);
  ASSERT_EQ(summary.status, Status::Converged) << summary.message;
  EXPECT_LT((x - path_of(smoothed, 2)).cwiseAbs().maxCoeff(), 1e-5);
}

TEST(SmoothTrack, IsNearerToTheTruthAndKnowsHowNear) {
  Track truth;
  const Track track = random_track(2000, 5, 0.1, 3, &truth), smoothed = smooth_track(track);
  for (const int dim : {2, 1}) {
    const Eigen::MatrixXd exact = path_of(truth, dim);
    const Eigen::MatrixXd before = path_of(track, dim) - exact, after = path_of(smoothed, dim) - exact;
    EXPECT_LT(after.norm(), 0.6 * before.norm());
    double distance = 0;
    for (Eigen::Index t = 1; t < 2000; ++t) {
      const Eigen::Index first = dim == 2 ? 0 : 2;
      const Eigen::MatrixXd c =
          smoothed[static_cast<std::size_t>(t)].covariance->block(first, first, dim, dim);
      distance += after.col(t).dot(c.llt().solve(after.col(t)));
    }
    EXPECT_NEAR(distance / (1999 * dim), 1, 0.2);
  }
}

TEST(SmoothTrack, PullsAnOutlierBack) {
  const Track truth = [] {
    Track all;
    random_track(60, 6, 0, 0.3, &all);
    return all;
  }();
  for (const double deviations : {1, 10}) {
    Track track = random_track(60, 6, 0, 0.3);
    track[30].box.x += 20;
    *track[30].covariance *= deviations * deviations;
    const double left = path_of(smooth_track(track), 2)(0, 30) - path_of(truth, 2)(0, 30);
    EXPECT_LT(std::abs(left), deviations == 1 ? 6 : 1);
  }
}

TEST(SmoothTrack, LeavesAConstantTrackAsItIs) {
  const cv::Rect2d box(10.1, 20.7, 33.3, 44.9);
  Track track(50, result_at(box, Eigen::Vector3d(4, 5, 0.01).asDiagonal().toDenseMatrix()));
  for (const TrackResult& result : smooth_track(track)) {
    EXPECT_NEAR(result.box.x, box.x, 1e-12);
    EXPECT_NEAR(result.box.y, box.y, 1e-12);
    EXPECT_NEAR(result.box.width, box.width, 1e-12);
    EXPECT_NEAR(result.box.height, box.height, 1e-12);
    EXPECT_TRUE(result.covariance->allFinite());
  }
}

TEST(SmoothTrack, CarriesOnThroughAnInterruption) {
  Track track = random_track(80, 7, 0.01, 0.2), truth;
  random_track(80, 7, 0.01, 0.2, &truth);
  for (std::size_t t = 30; t < 40; ++t) {
    track[t].box = track[29].box;
    track[t].interrupted = true;
  }
  const Eigen::MatrixXd error = path_of(smooth_track(track), 2) - path_of(truth, 2);
  EXPECT_LT(error.colwise().norm().maxCoeff(), 1);
  // At the end, the box stays where the object was seen last.
  for (std::size_t t = 40; t < 80; ++t) {
    track[t].box = track[29].box;
    track[t].interrupted = true;
  }
  const Track stopped = smooth_track(track);
  for (std::size_t t = 40; t < 80; ++t) EXPECT_EQ(stopped[t].box, stopped[29].box);
}

TEST(SmoothTrack, KeepsCentresInTheImage) {
  Track track = random_track(40, 13, 0.01, 0.2);
  const Point2 last = centre_of(smooth_track(track).back().box);
  const cv::Size image(static_cast<int>(last.x()), 1000);
  const Point2 kept = centre_of(smooth_track(track, image).back().box);
  EXPECT_NEAR(kept.x(), image.width - 1, 1e-9);
  EXPECT_NEAR(kept.y(), last.y(), 1e-9);
}

TEST(SmoothTrack, MovesAndGrowsWithTheImage) {
  const Track track = random_track(50, 8), smoothed = smooth_track(track);
  Track other = track;
  for (TrackResult& result : other) {
    const cv::Rect2d b = result.box;
    result.box = {2 * b.x + 100, 2 * b.y - 30, 2 * b.width, 2 * b.height};
    const Eigen::Matrix3d by = Eigen::Vector3d(2, 2, 1).asDiagonal();
    if (result.covariance) result.covariance = (by * *result.covariance * by).eval();
  }
  const Track found = smooth_track(other);
  for (std::size_t t = 0; t < track.size(); ++t) {
    const cv::Rect2d &a = smoothed[t].box, &b = found[t].box;
    EXPECT_NEAR(b.x, 2 * a.x + 100, 1e-6);
    EXPECT_NEAR(b.y, 2 * a.y - 30, 1e-6);
    EXPECT_NEAR(b.width, 2 * a.width, 1e-6);
    EXPECT_NEAR(b.height, 2 * a.height, 1e-6);
  }
}

TEST(SmoothTrack, KeepsAllElseThatTheTrackerSaid) {
  Track track = random_track(20, 9);
  track[5].confidence = 0.25;
  track[6].lost = true;
  track[7].probability = 0.125;
  track[8].angle = 0.5;
  const Track smoothed = smooth_track(track);
  EXPECT_EQ(smoothed[5].confidence, 0.25);
  EXPECT_TRUE(smoothed[6].lost);
  EXPECT_EQ(smoothed[7].probability, 0.125);
  EXPECT_EQ(smoothed[8].angle, 0.5);
  for (std::size_t t = 0; t < track.size(); ++t)
    EXPECT_NEAR(smoothed[t].box.width / smoothed[t].box.height, track[t].box.width / track[t].box.height,
                1e-12);
}

TEST(SmoothTrack, TakesTracksWithoutCovariance) {
  Track truth;
  const Track track = random_track(300, 10, 0.1, 3, &truth);
  const auto error = [&](const Track& some) { return (path_of(some, 2) - path_of(truth, 2)).norm(); };
  Track none = track, some = track, without_size = track;
  for (TrackResult& result : none) result.covariance.reset();
  for (std::size_t t = 0; t < some.size(); t += 3) some[t].covariance.reset();
  for (TrackResult& result : without_size)
    if (result.covariance) {
      result.covariance->row(2).setZero();
      result.covariance->col(2).setZero();
    }
  for (const Track& given : {none, some, without_size}) {
    const Track smoothed = smooth_track(given);
    EXPECT_LT(error(smoothed), 0.7 * error(given));
    for (const TrackResult& result : smoothed) EXPECT_TRUE(result.covariance->allFinite());
  }
}

TEST(SmoothTrack, ReturnsShortTracksAsTheyAre) {
  EXPECT_TRUE(smooth_track({}).empty());
  Track track = random_track(3, 11);
  for (const std::size_t frames : {1u, 2u})
    for (std::size_t t = 0; t < frames; ++t)
      EXPECT_EQ(smooth_track(std::span(track).first(frames))[t].box, track[t].box);
  track[1].interrupted = true;
  const Track same = smooth_track(track);
  for (std::size_t t = 0; t < 3; ++t) EXPECT_EQ(same[t].box, track[t].box);
}

TEST(SmoothTrack, RefusesBadInputByItsFrame) {
  const auto expect_refusal = [](const auto& spoil, const std::string& reason) {
    Track track = random_track(20, 12);
    spoil(track[7]);
    try {
      smooth_track(track);
      ADD_FAILURE() << reason;
    } catch (const std::invalid_argument& error) {
      EXPECT_NE(std::string(error.what()).find(reason), std::string::npos) << error.what();
    }
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  expect_refusal([&](TrackResult& r) { r.box.x = nan; }, "frame 7 of the track has a box that is not finite");
  expect_refusal([&](TrackResult& r) { r.box.width = 0; }, "frame 7 of the track has a box without size");
  expect_refusal([&](TrackResult& r) { r.box.height = -3; }, "frame 7 of the track has a box without size");
  expect_refusal([&](TrackResult& r) { (*r.covariance)(0, 1) = nan; },
                 "frame 7 of the track has a covariance that is not finite");
  expect_refusal([&](TrackResult& r) { (*r.covariance)(1, 1) = -1; },
                 "frame 7 of the track has a covariance that is not positive semi-definite");
  expect_refusal([&](TrackResult& r) { r.box.x = 1e200; }, "too large");
}

}  // namespace
}  // namespace asterism
