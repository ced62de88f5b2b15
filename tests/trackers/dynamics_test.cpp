// The covariance of the box, and the Kalman filter over it.

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <asterism/solver/energy/covariance.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/trackers/around/kalman.hpp>
#include <asterism/trackers/dpt/dpt.hpp>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <random>
#include <stdexcept>

#include "../solver/counting_allocator.hpp"

namespace asterism {
namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Vector<double, 6>;

Eigen::MatrixXd gaussian(std::mt19937& random, Eigen::Index rows, Eigen::Index cols) {
  std::normal_distribution<double> normal;
  return Eigen::MatrixXd::NullaryExpr(rows, cols, [&] { return normal(random); });
}

Eigen::Matrix3d sample_covariance(const Eigen::Matrix3Xd& samples) {
  const Eigen::Matrix3Xd centred = samples.colwise() - samples.rowwise().mean().eval();
  return centred * centred.transpose() / static_cast<double>(samples.cols());
}

// Centre and log size of a box that follows its parts.
Eigen::Vector3d followed(const Eigen::Matrix2Xd& from, const Eigen::Matrix2Xd& to, TransformModel model,
                         const Eigen::Vector2d& point) {
  const PlaneTransform transform = fit_transform(from, to, model);
  const Eigen::Vector2d image = transform(point);
  return {image.x(), image.y(), std::log(transform.scale)};
}

TEST(FitJacobian, IsTheDerivativeOfTheFit) {
  std::mt19937 random(1);
  for (const TransformModel model : {TransformModel::Euclidean, TransformModel::Similarity})
    for (const int n : {2, 4, 9}) {
      const Eigen::Matrix2Xd from = 20 * gaussian(random, 2, n);
      const Eigen::Matrix2Xd to = 1.2 * from + 5 * gaussian(random, 2, n);
      const Eigen::Vector2d point(13, -4);
      Eigen::Matrix3Xd jacobian(3, 2 * n);
      fit_jacobian(from, to, model, point, jacobian);
      for (int k = 0; k < 2 * n; ++k) {
        constexpr double kStep = 1e-5;
        Eigen::Matrix2Xd more = to, less = to;
        more(k % 2, k / 2) += kStep;
        less(k % 2, k / 2) -= kStep;
        const Eigen::Vector3d difference =
            (followed(from, more, model, point) - followed(from, less, model, point)) / (2 * kStep);
        EXPECT_LT((jacobian.col(k) - difference).norm(), 1e-8) << n << " parts, coordinate " << k;
      }
    }
}

// Rotation and scale that the points do not determine are kept, so their derivatives are zero.
TEST(FitJacobian, OfPointsThatDetermineNoScaleIsThatOfTheTranslation) {
  for (const int n : {1, 3}) {
    const Eigen::Matrix2Xd from = Eigen::Matrix2Xd::Constant(2, n, 7);
    Eigen::Matrix3Xd jacobian(3, 2 * n);
    fit_jacobian(from, from, TransformModel::Similarity, {1, 2}, jacobian);
    EXPECT_TRUE(jacobian.row(2).isZero());
    EXPECT_TRUE(jacobian.leftCols<2>().topRows<2>().isApprox(Eigen::Matrix2d::Identity() / n));
  }
}

/// A part with constant evidence, at law(first, around): `first` is where it started, `around` where it is
/// searched.
class StubPart {
 public:
  using Law = std::function<Point2(const Point2& first, const Point2& around)>;
  StubPart(Law law, Evidence evidence) : law_(std::move(law)), evidence_(evidence) {}

  void init(const Frame&, const Point2& centre, const Size2&) { first_ = centre; }
  Evidence localize(const Frame&, const Point2& around) {
    evidence_.position = law_(first_, around);
    return evidence_;
  }
  double similarity_at(const Point2&) const { return evidence_.peak; }
  void adapt(const Frame&, const Point2&) {}

 private:
  Law law_;
  Evidence evidence_;
  Point2 first_ = Point2::Zero();
};

// Evidence that is a few pixels off the parts in no regular pattern.
Point2 wobbling(const Point2& first, const Point2& around) {
  return around + Point2(3 * std::sin(first.x() + around.y()), 2 * std::cos(first.y() - around.x()));
}

/// DPT with stub parts; the root moves by (3, 1) per frame.
DptOptions stub_options(StubPart::Law law, const Evidence& evidence) {
  DptOptions options;
  options.coarse.use_color = false;
  options.coarse.root =
      StubPart([](const Point2&, const Point2& around) { return Point2(around + Point2(3, 1)); }, evidence);
  options.part = StubPart(std::move(law), evidence);
  return options;
}

// Flat except for a spot in the box: trackers do not start where there is nothing to follow.
const cv::Mat& any_image() {
  static const cv::Mat image = [] {
    cv::Mat flat(240, 320, CV_8UC3, cv::Scalar(90, 120, 30));
    flat.at<cv::Vec3b>(100, 120) = {90, 130, 30};
    return flat;
  }();
  return image;
}
const cv::Rect2d kBox(100, 80, 48, 64);

Eigen::Matrix2Xd positions(const TrackResult& result) {
  Eigen::Matrix2Xd x(2, static_cast<Eigen::Index>(result.parts.size()));
  for (std::size_t i = 0; i < result.parts.size(); ++i)
    x.col(static_cast<Eigen::Index>(i)) = result.parts[i].position;
  return x;
}

// Samples exp(-E) by a random walk and fits a box to each sample, without Hessian or derivatives.
TEST(BoxCovariance, IsThatOfBoxesOfSampledConstellations) {
  Evidence evidence{Point2::Zero(), 0.8, Eigen::Matrix2d(Eigen::Vector2d(0.1, 0.4).asDiagonal())};
  DptOptions options = stub_options(wobbling, evidence);
  std::optional<SpringSystem<double, 2>> solved;
  options.on_solve = [&](const DptSolve& solve) { solved = springs_of(solve.springs); };
  for (const TransformModel model : {TransformModel::Euclidean, TransformModel::Similarity}) {
    options.transform = model;
    Dpt tracker(options);
    tracker.init(any_image(), kBox);
    const TrackResult before = tracker.update(any_image());
    const TrackResult result = tracker.update(any_image());
    ASSERT_TRUE(result.covariance);
    const Eigen::Matrix2Xd from = positions(before);

    std::mt19937 random(3);
    std::uniform_real_distribution<double> uniform(0, 1);
    Dpt::Placement x = positions(result);
    double e = energy(*solved, x);
    constexpr int kSteps = 400'000;
    Eigen::Matrix3Xd boxes(3, kSteps);
    int taken = 0;
    for (int k = 0; k < kSteps; ++k) {
      const Dpt::Placement next = x + 0.35 * gaussian(random, 2, 4);
      const double next_e = energy(*solved, next);
      if (uniform(random) < std::exp(e - next_e)) {
        x = next, e = next_e;
        ++taken;
      }
      boxes.col(k) = followed(from, x, model, centre_of(before.box));
    }
    EXPECT_GT(taken, kSteps / 10);
    const Eigen::Matrix3d sampled = sample_covariance(boxes);
    for (int i = 0; i < 3; ++i) {
      const double deviation = std::sqrt((*result.covariance)(i, i));
      EXPECT_NEAR(std::sqrt(sampled(i, i)), deviation, 0.06 * deviation) << i;
      for (int j = 0; j < i; ++j)
        EXPECT_NEAR(sampled(i, j), (*result.covariance)(i, j),
                    0.06 * deviation * std::sqrt((*result.covariance)(j, j)))
            << i << j;
    }
    EXPECT_EQ((*result.covariance)(2, 2) == 0, model == TransformModel::Euclidean);
  }
}

// Evidence in the reverse order compresses the row of parts, from which IDA does not lead off at once: a
// saddle point.
TEST(BoxCovariance, IsNotThereWhereThePlacementIsNoMinimum) {
  const double middle = kBox.x + kBox.width / 2;
  DptOptions options = stub_options(
      [middle](const Point2& part, const Point2&) { return Point2(150 - 0.25 * (part.x() - middle), 111.5); },
      {Point2::Zero(), 0.8, 4 * Eigen::Matrix2d::Identity()});
  options.grid_rows = 1;
  options.grid_cols = 3;
  options.solver = {"ida", {{"max_iterations", 20}}};
  Dpt saddle(options);
  saddle.init(any_image(), kBox);
  EXPECT_FALSE(saddle.update(any_image()).covariance);
}

// The joint Gaussian of all frames' states, as one linear least-squares problem; the filter must give the
// marginal of the last state.
TEST(ConstantVelocityFilter, IsTheMarginalOfTheJointGaussian) {
  constexpr int kFrames = 12;
  std::mt19937 random(5);
  const auto spread = [&] {
    const Eigen::Matrix3d a = gaussian(random, 3, 3);
    return Eigen::Matrix3d(a * a.transpose() + 0.1 * Eigen::Matrix3d::Identity());
  };
  const Eigen::Vector3d start(3, -2, 0.5), velocity_deviation(2, 1, 0.3);
  const Eigen::Matrix3d start_covariance = spread();
  ConstantVelocityFilter filter;
  filter.start(start, start_covariance, velocity_deviation);

  constexpr int kSize = 6 * (kFrames + 1);
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(kSize, kSize);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(kSize);
  information.topLeftCorner<3, 3>() = start_covariance.inverse();
  information.block<3, 3>(3, 3) = velocity_deviation.cwiseAbs2().cwiseInverse().asDiagonal();
  right.head<3>() = start_covariance.inverse() * start;

  for (int t = 1; t <= kFrames; ++t) {
    const Eigen::Vector3d density = gaussian(random, 3, 1).cwiseAbs2(), seen = 5 * gaussian(random, 3, 1);
    const Eigen::Matrix3d covariance = spread();
    filter.predict(density);
    filter.update(seen, covariance);

    // Axis by axis: x' = x + v + n1, v' = v + n2, where (n1, n2) has covariance q [1/3 1/2; 1/2 1].
    for (int axis = 0; axis < 3; ++axis) {
      Eigen::MatrixXd residual = Eigen::MatrixXd::Zero(2, kSize);
      const int was = 6 * (t - 1) + axis, is = 6 * t + axis;
      residual(0, is) = 1, residual(0, was) = -1, residual(0, was + 3) = -1;
      residual(1, is + 3) = 1, residual(1, was + 3) = -1;
      Eigen::Matrix2d noise;
      noise << 1. / 3, 1. / 2, 1. / 2, 1;
      information += residual.transpose() * (density[axis] * noise).inverse() * residual;
    }
    information.block<3, 3>(6 * t, 6 * t) += covariance.inverse();
    right.segment<3>(6 * t) += covariance.inverse() * seen;
  }
  const Eigen::MatrixXd joint = information.inverse();
  const Vector6 mean = (joint * right).tail<6>();
  EXPECT_LT((filter.position() - mean.head<3>()).norm(), 1e-8 * mean.norm());
  EXPECT_LT((filter.velocity() - mean.tail<3>()).norm(), 1e-8 * mean.norm());
  EXPECT_TRUE(filter.covariance().isApprox(joint.bottomRightCorner<6, 6>(), 1e-8));
}

TEST(ConstantVelocityFilter, AndTheCovarianceOfABoxUseNoHeap) {
  ConstantVelocityFilter filter;
  filter.start({1, 2, 3}, Eigen::Matrix3d::Identity(), {1, 1, 1});
  const Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::ColMajor, 2, 16> parts =
      Eigen::Matrix<double, 2, 16>::Random();
  Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::ColMajor, 3, 32> jacobian(3, 32);
  EXPECT_EQ(testing::allocations_in([&] {
              filter.predict({0.1, 0.1, 0.1});
              filter.update({1, 3, 2}, Eigen::Matrix3d::Identity());
              fit_jacobian(parts, parts, TransformModel::Similarity, {0, 0}, jacobian);
            }),
            0);
}

TrackResult answer(const cv::Rect2d& box, std::optional<Eigen::Matrix3d> covariance = {}) {
  TrackResult result;
  result.box = box;
  result.confidence = 0.7;
  result.covariance = std::move(covariance);
  return result;
}

/// Returns the given results in order.
class ScriptedTracker {
 public:
  explicit ScriptedTracker(std::vector<TrackResult> script) : script_(std::move(script)) {}
  void init(const cv::Mat&, const cv::Rect2d&) { next_ = 0; }
  TrackResult update(const cv::Mat&) { return script_.at(next_++); }

 private:
  std::vector<TrackResult> script_;
  std::size_t next_ = 0;
};

// A box that moves and grows steadily.
cv::Rect2d steady(int t) {
  const double scale = std::exp(0.01 * t);
  return box_around({60 + 2.5 * t, 200 - 1.5 * t}, {40 * scale, 30 * scale});
}

std::vector<TrackResult> filtered(const cv::Rect2d& first, const std::vector<TrackResult>& script,
                                  const KalmanOptions& options = {}) {
  KalmanTracker tracker(ScriptedTracker(script), options);
  cv::Mat image(2000, 2000, CV_8UC1, cv::Scalar(0));  // contains all boxes
  image(cv::Rect(first)).setTo(cv::Scalar(9));
  tracker.init(image, first);
  std::vector<TrackResult> results;
  for (std::size_t t = 0; t < script.size(); ++t) results.push_back(tracker.update(image));
  return results;
}

double distance(const cv::Rect2d& a, const cv::Rect2d& b) { return (centre_of(a) - centre_of(b)).norm(); }

TEST(KalmanTracker, FollowsConstantVelocityExactlyAndBelievesInItWhileLost) {
  std::vector<TrackResult> script;
  for (int t = 1; t <= 30; ++t) script.push_back(answer(steady(t)));
  for (int t = 31; t <= 35; ++t) {
    script.push_back(answer(steady(30)));
    script.back().lost = true;
  }
  KalmanOptions options;
  options.acceleration = 0.01;
  const std::vector<TrackResult> results = filtered(steady(0), script, options);
  EXPECT_LT(distance(results[29].box, steady(30)), 1e-3);
  EXPECT_NEAR(results[29].box.width, steady(30).width, 1e-2);
  EXPECT_EQ(results[29].confidence, 0.7);
  // Boxes that stop while the tracker is lost hardly slow the filtered box.
  EXPECT_LT(distance(results[34].box, steady(35)), 0.35 * distance(steady(30), steady(35)));
  EXPECT_TRUE(results[34].lost);
  EXPECT_GT((*results[34].covariance)(0, 0), 4 * (*results[29].covariance)(0, 0));
}

TEST(KalmanTracker, HasNoCovarianceInFramesThatShowNothing) {
  std::vector<TrackResult> script(3, answer(steady(0)));
  script[0].interrupted = script[1].interrupted = true;
  script[1].covariance = Eigen::Matrix3d::Identity();
  const std::vector<TrackResult> results = filtered(steady(0), script);
  for (std::size_t t = 0; t < 2; ++t) {
    EXPECT_LT(distance(results[t].box, steady(0)), 1e-9);
    EXPECT_FALSE(results[t].covariance) << "the start box is exact, that of this frame is not";
  }
  ASSERT_TRUE(results[2].covariance);
  EXPECT_GT((*results[2].covariance)(0, 0), 0);
}

TEST(KalmanTracker, IsNearerToTheObjectThanItsNoisyTracker) {
  std::mt19937 random(6);
  std::vector<TrackResult> script;
  for (int t = 1; t <= 400; ++t) {
    const Eigen::MatrixXd noise = 2 * gaussian(random, 2, 1);
    cv::Rect2d box = steady(0);
    box.x += 2.5 * t + noise(0), box.y += noise(1);
    script.push_back(answer(box, Eigen::Vector3d(4, 4, 1e-4).asDiagonal().toDenseMatrix()));
  }
  KalmanOptions options;
  options.acceleration = 0.005;
  const std::vector<TrackResult> results = filtered(steady(0), script, options);
  double noisy = 0, smooth = 0, claimed = 0;
  for (int t = 1; t <= 400; ++t) {
    cv::Rect2d truth = steady(0);
    truth.x += 2.5 * t;
    const auto at = static_cast<std::size_t>(t - 1);
    noisy += std::pow(distance(script[at].box, truth), 2);
    smooth += std::pow(distance(results[at].box, truth), 2);
    claimed += results[at].covariance->topLeftCorner<2, 2>().trace();
  }
  EXPECT_LT(smooth, 0.6 * noisy);
  EXPECT_LT(smooth, 1.2 * claimed);  // it is not overconfident
}

TEST(KalmanTracker, KnowsNeitherOriginNorUnitOfTheImage) {
  std::mt19937 random(7);
  std::vector<TrackResult> script, other;
  const double unit = 3.5;
  const auto change = [&](const cv::Rect2d& b) {
    return box_around(unit * centre_of(b) + Point2(-70, 900), unit * Size2(b.width, b.height));
  };
  const Eigen::Vector3d units(unit, unit, 1);
  for (int t = 1; t <= 50; ++t) {
    TrackResult result = answer(steady(t));
    result.box.x += gaussian(random, 1, 1)(0);
    result.lost = t % 7 == 0;
    if (t % 3 == 0) result.covariance = Eigen::Vector3d(2, 3, 1e-3).asDiagonal().toDenseMatrix();
    script.push_back(result);
    result.box = change(result.box);
    if (result.covariance)
      result.covariance = Eigen::Matrix3d(units.asDiagonal() * *result.covariance * units.asDiagonal());
    other.push_back(result);
  }
  const auto a = filtered(steady(0), script), b = filtered(change(steady(0)), other);
  for (std::size_t t = 0; t < a.size(); ++t) {
    EXPECT_LT(distance(change(a[t].box), b[t].box), 1e-7);
    EXPECT_NEAR(unit * a[t].box.width, b[t].box.width, 1e-8);
    EXPECT_TRUE(b[t].covariance->isApprox(
        Eigen::Matrix3d(units.asDiagonal() * *a[t].covariance * units.asDiagonal()), 1e-8));
  }
}

TEST(KalmanTracker, RefusesBadOptions) {
  const auto refused = [](auto change) {
    KalmanOptions options;
    change(options);
    EXPECT_THROW(KalmanTracker(ScriptedTracker({}), options), std::invalid_argument);
  };
  refused([](KalmanOptions& o) { o.acceleration = 0; });
  refused([](KalmanOptions& o) { o.size_acceleration = -1; });
  refused([](KalmanOptions& o) { o.deviation = std::nan(""); });
  refused([](KalmanOptions& o) { o.size_deviation = INFINITY; });
  refused([](KalmanOptions& o) { o.lost_factor = 0.5; });
  refused([](KalmanOptions& o) { o.acceleration = 1e300; });
  refused([](KalmanOptions& o) { o.size_deviation = 1e-300; });
  refused([](KalmanOptions& o) { o.lost_factor = 1e300; });
}

TEST(KalmanTracker, HasABoxWhateverItsOptions) {
  std::vector<TrackResult> script;
  for (int t = 1; t <= 300; ++t) {
    script.push_back(answer(steady(t % 50)));
    script.back().lost = t % 100 > 30;
  }
  for (const double acceleration : {1e-6, 1e6})
    for (const double size_acceleration : {1e-6, 1e6})
      for (const double deviation : {1e-6, 1e6})
        for (const double size_deviation : {1e-6, 1e6})
          for (const double lost_factor : {1.0, 1e12})
            for (const TrackResult& result :
                 filtered(steady(0), script,
                          {acceleration, size_acceleration, deviation, size_deviation, lost_factor})) {
              ASSERT_TRUE(std::isfinite(result.box.x) && std::isfinite(result.box.y));
              ASSERT_TRUE(std::isfinite(result.box.width) && std::isfinite(result.box.height));
              ASSERT_TRUE(result.covariance->allFinite());
            }
}

#ifdef ASTERISM_TEST_JSON
TEST(KalmanTracker, IsMadeAroundAnyDescription) {
  for (const std::string description :
       {R"(kalman{"of": "coarse", "acceleration": 0.2})",
        R"({"tracker": "kalman", "of": {"tracker": "dpt", "grid_rows": 3}})", R"(kalman{"of": "kalman"})"}) {
    AnyTracker tracker = make_tracker(description);
    tracker.init(any_image(), kBox);
    EXPECT_TRUE(tracker.update(any_image()).covariance) << description;
  }
  for (const std::string description :
       {R"(kalman{"of": "dtp"})", R"(kalman{"of": 3})", R"(kalman{"accelerate": 1})", "kalman{", "kalman{3}"})
    EXPECT_THROW(make_tracker(description), std::invalid_argument) << description;
}
#endif

}  // namespace
}  // namespace asterism
