#include <Eigen/Cholesky>
#include <asterism/trackers/around/kalman.hpp>
#include <asterism/trackers/tracker/tracker_options.hpp>
#include <cmath>

#include "../tracker/stage_clock.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6>;

// Standard deviations of the initial velocity: the object's mean side per frame, and a growth by e^0.1.
constexpr double kVelocity = 1, kSizeVelocity = 0.1;

double log_mean_side(const cv::Rect2d& box) { return (std::log(box.width) + std::log(box.height)) / 2; }

Eigen::Vector3d measured(const cv::Rect2d& box) {
  const Point2 centre = centre_of(box);
  return {centre.x(), centre.y(), log_mean_side(box)};
}

}  // namespace

void ConstantVelocityFilter::start(const Vector& position, const Matrix& covariance,
                                   const Vector& velocity_deviation) {
  state_ << position, Vector::Zero();
  covariance_.setZero();
  covariance_.topLeftCorner<3, 3>() = covariance;
  covariance_.bottomRightCorner<3, 3>() = velocity_deviation.cwiseAbs2().asDiagonal();
}

void ConstantVelocityFilter::predict(const Vector& density) {
  Matrix6 motion = Matrix6::Identity();
  motion.topRightCorner<3, 3>().setIdentity();
  state_ = motion * state_;
  covariance_ = motion * covariance_ * motion.transpose();
  // White noise acceleration, integrated over a frame once (velocity) and twice (position).
  covariance_.topLeftCorner<3, 3>() += (density / 3).asDiagonal();
  covariance_.topRightCorner<3, 3>() += (density / 2).asDiagonal();
  covariance_.bottomLeftCorner<3, 3>() += (density / 2).asDiagonal();
  covariance_.bottomRightCorner<3, 3>() += density.asDiagonal();
}

void ConstantVelocityFilter::update(const Vector& measured, const Matrix& covariance) {
  const Matrix innovation = covariance_.topLeftCorner<3, 3>() + covariance;
  const Eigen::Matrix<double, 6, 3> gain = innovation.ldlt().solve(covariance_.topRows<3>()).transpose();
  state_ += gain * (measured - position());
  // Joseph form: symmetric and positive semi-definite in spite of rounding.
  Matrix6 rest = Matrix6::Identity();
  rest.leftCols<3>() -= gain;
  covariance_ = rest * covariance_ * rest.transpose() + gain * covariance * gain.transpose();
}

KalmanTracker::KalmanTracker(AnyTracker tracker, const KalmanOptions& options)
    : tracker_(std::move(tracker)), options_(check_options("KalmanOptions", options)) {}

double KalmanTracker::mean_side() const { return std::exp(filter_.position().z()); }

Eigen::Matrix3d KalmanTracker::covariance_of(const TrackResult& result) const {
  const double factor = result.is_weak() ? options_.lost_factor : 1;
  if (result.covariance) return factor * *result.covariance;
  const double centre = options_.deviation * std::exp(log_mean_side(result.box));
  return factor *
         Eigen::Vector3d(centre, centre, options_.size_deviation).cwiseAbs2().asDiagonal().toDenseMatrix();
}

void KalmanTracker::start(const Frame& frame, const cv::Rect2d& box) {
  tracker_.init(frame, box);
  const double side = std::exp(log_mean_side(box));
  // The first box is exact.
  filter_.start(measured(box), Eigen::Matrix3d::Zero(), {kVelocity * side, kVelocity * side, kSizeVelocity});
}

TrackResult KalmanTracker::follow(const Frame& frame) {
  TrackResult result = tracker_.update(frame);
  StageClock clock;
  if (!result.interrupted) {  // otherwise no motion is predicted: the box stays where it is
    const double centre = options_.acceleration * mean_side();
    filter_.predict(Eigen::Vector3d(centre, centre, options_.size_acceleration).cwiseAbs2());
    filter_.update(measured(result.box), covariance_of(result));
  }
  const double scale = mean_side() / std::exp(log_mean_side(result.box));
  result.box = box_around(kept_in_image(frame, filter_.position().head<2>()),
                          scale * Size2(result.box.width, result.box.height));
  result.covariance.reset();
  if (!result.interrupted) result.covariance = filter_.covariance().topLeftCorner<3, 3>();
  result.times.push_back({"filter", clock.lap()});
  return result;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
