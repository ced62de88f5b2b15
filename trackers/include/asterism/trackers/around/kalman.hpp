#pragma once

#include <Eigen/Core>
#include <asterism/trackers/tracker/tracker.hpp>
#include <asterism/trackers/tracker/tracker_base.hpp>
#include <optional>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The Kalman filter of a point of three coordinates, whose velocity changes only by white acceleration
/// (Bar-Shalom, Li and Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 6.2.2). The
/// unit of time is the frame.
class ASTERISM_API ConstantVelocityFilter {
 public:
  using Vector = Eigen::Vector3d;
  using Matrix = Eigen::Matrix3d;

  /// The point is at `position`, with this covariance; its velocity is 0, with a standard deviation on each
  /// axis.
  void start(const Vector& position, const Matrix& covariance, const Vector& velocity_deviation);
  /// One frame later. density: power spectral density of the acceleration on each axis, >= 0 [unit^2 /
  /// frame^3]; the velocity's variance grows by as much a frame.
  void predict(const Vector& density);
  /// The point was measured, with a covariance (positive semi-definite).
  void update(const Vector& measured, const Matrix& covariance);

  /// The state that the filter expects now.
  Vector position() const { return state_.head<3>(); }
  Vector velocity() const { return state_.tail<3>(); }
  /// The covariance of position and velocity, in this order.
  const Eigen::Matrix<double, 6, 6>& covariance() const { return covariance_; }

  void visit_state(StateArchive& archive);

 private:
  Eigen::Vector<double, 6> state_ = Eigen::Vector<double, 6>::Zero();
  Eigen::Matrix<double, 6, 6> covariance_ = Eigen::Matrix<double, 6, 6>::Zero();
};

/// Options of KalmanTracker. Lengths are in mean sides of the box (geometric mean), so that nothing changes
/// with the image's scale; those of the size are of its natural logarithm. The defaults are measured:
/// docs/results/uncertainty.md.
struct KalmanOptions {
  /// Standard deviation of the change of velocity in a frame by white acceleration, in [1e-6, 1e6]: of the
  /// centre on each axis [mean sides / frame], and of the size.
  double acceleration = 0.3, size_acceleration = 0.05;
  /// Standard deviation of a box from the object if its tracker gives no covariance, in [1e-6, 1e6]: of the
  /// centre on each axis [mean sides], and of the size.
  double deviation = 0.05, size_deviation = 0.05;
  /// Factor of the covariance of a box that its tracker does not rely on (TrackResult::is_weak), in [1,
  /// 1e12].
  double lost_factor = 100;
};

/// Any tracker with a Kalman filter on its box: the velocity of the centre and of the logarithm of the size
/// changes only by white acceleration; the tracker's box measures them, with TrackResult::covariance if it
/// has one. The result is the tracker's, with filtered box and covariance; the box keeps its aspect ratio. A
/// frame that shows nothing of the scene changes nothing, and its result has no covariance.
/// The tracker itself continues from its own box.
class ASTERISM_API KalmanTracker : public TrackerBase<KalmanTracker> {
 public:
  /// Throws std::invalid_argument for options out of range.
  explicit KalmanTracker(AnyTracker tracker, const KalmanOptions& options = {});

  const KalmanOptions& options() const { return options_; }

 private:
  friend TrackerBase<KalmanTracker>;
  static constexpr std::string_view kName = "KalmanTracker";

  void start(const Frame& frame, const cv::Rect2d& box);
  TrackResult follow(const Frame& frame);
  void visit_learned(StateArchive& archive);

  // Of a box as a measurement, in px and logarithms.
  Eigen::Matrix3d covariance_of(const TrackResult& result) const;
  // Of the filtered box [px].
  double mean_side() const;

  AnyTracker tracker_;
  KalmanOptions options_;
  ConstantVelocityFilter filter_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
