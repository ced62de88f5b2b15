#pragma once

#include <array>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/problem/message.hpp>
#include <asterism/solver/run/status.hpp>
#include <atomic>
#include <cstddef>
#include <limits>
#include <memory>
#include <span>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The odometry of a robot in the plane, and its ranges to beacons.
struct PathMeasurements {
  /// (poses - 1, 3): how far it moves from each pose to the next, in the frame of the former (x forward, y to
  /// the left) [m], and by how much it turns [rad].
  std::span<const double> steps;
  std::span<const double> beacons;  ///< (M, 2) [m]; NaN where a beacon's place is unknown
  /// (R) of each range, at which pose it was measured: 3.25 is a quarter of the way from pose 3 to pose 4.
  std::span<const double> pose;
  std::span<const int> beacon;    ///< (R) to which beacon
  std::span<const double> range;  ///< (R) >= 0; NaN where nothing was heard [m]
  std::span<const double> sigma;  ///< (R) standard deviations of the ranges, > 0 [m]
};

/// Options of locate_path().
struct PathOptions {
  /// The energy of a range never exceeds cutoff^2 / 2 (Geman and McClure's loss), > 0 [sigma]. Infinity:
  /// least squares, without outliers.
  double cutoff = std::numeric_limits<double>::infinity();
  /// Standard deviation of a step's difference from the step before, turned by the odometry, relative to its
  /// length, > 0; 0: estimated.
  double turn_sigma = 0;
  /// Standard deviation of a step's length, relative to it, > 0.
  double step_sigma = 0.1;
  /// Standard deviation of the odometry's scale about 1, >= 0: of how many metres the robot goes for each
  /// that the odometry counts. 0: the scale is 1.
  double scale_sigma = 0.1;
  /// Steps are joined until they are so long, because a robot that stands still has no direction, > 0 [m];
  /// 0: half of the median step.
  double shortest = 0;
  /// x, y [m] and heading [rad] of the first pose. Where the beacons determine the path, the search starts
  /// there; where they do not, it defines the frame of the result. NaN: a search, and (0, 0, 0).
  std::array<double, 3> start{std::numeric_limits<double>::quiet_NaN(),
                              std::numeric_limits<double>::quiet_NaN(),
                              std::numeric_limits<double>::quiet_NaN()};
  /// Standard deviations of the first position [m] and heading [rad], > 0. Infinity: `start` has no energy.
  std::array<double, 2> start_sigma{std::numeric_limits<double>::infinity(),
                                    std::numeric_limits<double>::infinity()};
  bool covariance = true;    ///< whether covariances are wanted
  bool lower_bound = true;   ///< whether the bound is wanted
  int max_iterations = 200;  ///< of each descent, >= 1
  /// If given, tested in every iteration: once it is true, the status is Interrupted, and there is no path.
  const std::atomic<bool>* stop = nullptr;

  /// Null if the options are valid, otherwise what is wrong.
  const char* problem() const;
};

/// The result of locate_path(). A path is at a local minimum of its energy.
struct PathEstimate {
  Status status =
      Status::NotRun;           ///< Converged, MaxIterations, InvalidInput, NumericalFailure or Interrupted
  Message message;              ///< what is wrong, or what the beacons do not determine; may be empty
  std::vector<double> x;        ///< (poses, 2) [m]
  std::vector<double> heading;  ///< (poses) [rad], in (-pi, pi]
  std::vector<double> covariance;  ///< (poses, 2, 2), by Laplace's approximation [m^2]; empty if not wanted
  std::vector<double> beacons;     ///< (M, 2): the known ones as they were given [m]
  std::vector<double> beacon_covariance;  ///< (M, 2, 2): zero for known ones [m^2]; empty if not wanted
  std::vector<double> residuals;  ///< (R) distance - range, in units of sigma; NaN where nothing was heard
  double energy = 0;              ///< at the minimum
  /// No path with this scale has a lower energy than this: with a cutoff, of the energy in which each range
  /// keeps the weight that it has at the minimum, increased by the cost of these weights, so that it is
  /// comparable with `energy`. 0 if it is not wanted.
  double lower_bound = 0;
  double evidence = 0;    ///< logarithm of the evidence by Laplace's approximation, up to a constant
  double turn_sigma = 0;  ///< as given or estimated
  /// The odometry's steps times this are the robot's. It stays at 1, without a deviation, if it differs from
  /// it by less than 1.5 deviations.
  double scale = 1;
  double scale_deviation = 0;  ///< by Laplace's approximation; 0 if covariances are not wanted
  int nodes = 0;               ///< positions of the chain
  int iterations = 0;          ///< of all descents: factorisations
};

/// The path of a robot in the plane from its odometry and from ranges to beacons, known or unknown, in time
/// linear in the number of poses: see docs/locate.md. Headings are not among the unknowns.
///
/// The status is InvalidInput, and the message names what is wrong, for sizes that do not match, numbers that
/// are not finite, negative ranges, a range at no pose or to no beacon, a path of less than two positions,
/// and unknown beacons with fewer than two ranges.
ASTERISM_API PathEstimate locate_path(const PathMeasurements& measurements, const PathOptions& options = {});

/// Options of a PathStream.
struct PathStreamOptions {
  int window = 10'000;  ///< positions that are kept at least, >= 16; up to a tenth more are
  double cutoff = std::numeric_limits<double>::infinity();  ///< as PathOptions::cutoff
  double turn_sigma =
      0.003;                ///< as PathOptions::turn_sigma, > 0; locate_path() estimates it from a recording
  double step_sigma = 0.1;  ///< as PathOptions::step_sigma
  double shortest = 0;      ///< as PathOptions::shortest, > 0 [m]
  std::array<double, 3> start{};              ///< x, y [m] and heading [rad] of the first pose
  std::array<double, 2> start_sigma{1, 0.5};  ///< their standard deviations, > 0 and finite [m, rad]
  int settle_every = 100;                     ///< ranges, >= 1

  /// Null if the options are valid, otherwise what is wrong.
  const char* problem() const;
};

/// The path of a robot as its odometry and ranges to known beacons come in, in constant memory.
///
/// The energy is that of locate_path(), over a window of the last positions. Older ones are marginalised: at
/// their estimates they become a quadratic function of the window's first two positions, once. After every
/// `settle_every` ranges, and after settle(), the estimate is at the minimum of this energy; after the other
/// ranges, one step of the Gauss-Newton method was taken, from the last 64 positions on.
class ASTERISM_API PathStream {
 public:
  /// Throws std::invalid_argument if options.problem().
  explicit PathStream(const PathStreamOptions& options);
  PathStream(PathStream&&) noexcept;
  PathStream& operator=(PathStream&&) noexcept;
  ~PathStream();

  /// The robot moves by (x, y) in its own frame [m] and then turns [rad]. Empty, or what is wrong: then
  /// nothing has changed.
  Message move(double x, double y, double turn);
  /// A range [m] to the beacon at (x, y) [m], and its standard deviation [m]; NaN: nothing was heard. Empty,
  /// or what is wrong: then nothing has changed.
  Message range(double x, double y, double range, double sigma);

  /// The robot's present pose: x, y [m] and heading [rad], in (-pi, pi].
  std::array<double, 3> pose() const;
  /// The covariance of x and y, row by row [m^2]; infinite before the robot has moved by `shortest`.
  std::array<double, 4> covariance();
  /// Goes to the minimum.
  void settle();
  /// The window's positions (N, 2) [m].
  std::vector<double> positions() const;
  /// The same at the minimum of the same energy, by locate_path()'s descent over the whole window, from
  /// places beside the estimate: what the estimate has to be after settle().
  std::vector<double> batch() const;
  /// The window's energy.
  double energy() const;

 private:
  class Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
