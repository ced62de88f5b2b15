// Paths from ranges, against an energy of its own (its gradient by finite differences), exact measurements,
// and a stream against the batch. tests/python/locate_path_test.py has more.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <asterism/solver/ranges/path.hpp>
#include <atomic>
#include <cmath>
#include <complex>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

using namespace asterism;
using Complex = std::complex<double>;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

std::string text(const PathEstimate& path) { return std::string(std::string_view(path.message)); }

/// A robot on a winding path, which hears one beacon at each pose.
struct Drive {
  std::vector<double> truth, steps, beacons{0, 0, 30, 2, 28, 25, -3, 22}, pose, range, sigma;
  std::vector<int> beacon;

  /// noise: of ranges [m] and, divided by 20, of turns [rad].
  Drive(int poses, double noise) {
    Complex p(12, 10);
    double heading = 0.7;
    for (int k = 0; k < poses; ++k) {
      truth.insert(truth.end(), {p.real(), p.imag()});
      const int j = (k * k + k / 3) % 4;
      const auto b = static_cast<std::size_t>(2 * j);
      pose.push_back(k);
      beacon.push_back(j);
      range.push_back(std::abs(p - Complex(beacons[b], beacons[b + 1])) + noise * std::sin(2.3 * k * k));
      sigma.push_back(0.2);
      if (k + 1 == poses) break;
      const double length = 0.6 + 0.2 * std::sin(0.7 * k), turn = 0.1 * std::sin(k / 11.0) + 0.04;
      p += std::polar(length, heading);
      heading += turn;
      steps.insert(steps.end(), {length, 0, turn + noise / 20 * std::cos(1.7 * k * k)});
    }
  }

  PathMeasurements measurements() const { return {steps, beacons, pose, beacon, range, sigma}; }

  double energy(const std::vector<double>& x, const PathOptions& options) const {
    std::vector<Complex> moves;
    double heading = 0, sum = 0;
    for (std::size_t k = 0; k < steps.size(); k += 3) {
      moves.push_back(std::polar(1.0, heading) * Complex(steps[k], steps[k + 1]));
      heading += steps[k + 2];
    }
    const auto at = [&x](std::size_t k) { return Complex(x[2 * k], x[2 * k + 1]); };
    for (std::size_t k = 0; k < moves.size(); ++k) {
      const Complex d = at(k + 1) - at(k);
      const double length = std::abs(moves[k]);
      sum += std::pow((std::abs(d) - length) / (options.step_sigma * length), 2) / 2;
      if (k == 0) continue;
      const Complex before = at(k) - at(k - 1);
      sum += std::norm(d - moves[k] / moves[k - 1] * before) / std::pow(options.turn_sigma * length, 2) / 2;
    }
    for (std::size_t i = 0; i < range.size(); ++i) {
      const auto b = static_cast<std::size_t>(2 * beacon[i]);
      const double distance =
          std::abs(at(static_cast<std::size_t>(pose[i])) - Complex(beacons[b], beacons[b + 1]));
      const double s = std::pow((distance - range[i]) / sigma[i], 2), c = options.cutoff * options.cutoff;
      sum += std::isinf(c) ? s / 2 : c * s / (c + s) / 2;
    }
    return sum;
  }
};

double distance(const std::vector<double>& a, const std::vector<double>& b) {
  EXPECT_EQ(a.size(), b.size());
  double most = 0;
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i) most = std::max(most, std::abs(a[i] - b[i]));
  return most;
}

TEST(LocatePath, IsAMinimumOfItsEnergy) {
  const Drive drive(60, 0.3);
  PathOptions options;
  options.turn_sigma = 0.03;
  options.shortest = 0.1;
  for (const double cutoff : {std::numeric_limits<double>::infinity(), 1.5}) {
    options.cutoff = cutoff;
    const PathEstimate path = locate_path(drive.measurements(), options);
    ASSERT_EQ(path.status, Status::Converged) << text(path);
    EXPECT_EQ(path.nodes, 60);
    EXPECT_NEAR(path.energy, drive.energy(path.x, options), 1e-9 * path.energy);
    EXPECT_LE(path.lower_bound, path.energy);
    EXPECT_GT(path.lower_bound, 0);
    for (std::size_t i = 0; i < path.x.size(); ++i) {
      std::vector<double> x = path.x;
      const double h = 1e-5;
      x[i] += h;
      const double above = drive.energy(x, options);
      x[i] -= 2 * h;
      const double below = drive.energy(x, options);
      EXPECT_NEAR((above - below) / (2 * h), 0, 1e-4) << i;
      EXPECT_GT(above + below, 2 * path.energy) << i;
    }
  }
}

TEST(LocatePath, ExactMeasurementsGiveTheTruePath) {
  Drive drive(300, 0);
  PathOptions options;
  options.turn_sigma = 0.01;
  PathEstimate path = locate_path(drive.measurements(), options);
  ASSERT_EQ(path.status, Status::Converged) << text(path);
  EXPECT_LT(distance(path.x, drive.truth), 1e-6);
  EXPECT_NEAR(path.heading[0], 0.7, 1e-6);
  EXPECT_LT(path.energy, 1e-9);
  // Two beacons whose places are not known.
  const std::vector<double> places = drive.beacons;
  for (const std::size_t i : {2u, 3u, 6u, 7u}) drive.beacons[i] = kNan;
  path = locate_path(drive.measurements(), options);
  ASSERT_EQ(path.status, Status::Converged) << text(path);
  EXPECT_LT(distance(path.x, drive.truth), 1e-6);
  EXPECT_LT(distance(path.beacons, places), 1e-6);
  // All of them: up to a rigid motion, which the start takes away.
  std::fill(drive.beacons.begin(), drive.beacons.end(), kNan);
  options.start = {12, 10, 0.7};
  path = locate_path(drive.measurements(), options);
  ASSERT_EQ(path.status, Status::Converged) << text(path);
  EXPECT_LT(distance(path.x, drive.truth), 1e-6);
  EXPECT_LT(distance(path.beacons, places), 1e-6);
  EXPECT_NE(text(path).find("do not determine where the path is"), std::string::npos);
}

TEST(LocatePath, FindsTheScaleOfTheOdometry) {
  for (const double scale : {0.8, 1.2}) {
    Drive drive(300, 0);
    for (std::size_t i = 0; i < drive.steps.size(); ++i)
      if (i % 3 != 2) drive.steps[i] /= scale;
    PathOptions options;
    options.turn_sigma = 0.01;
    const PathEstimate path = locate_path(drive.measurements(), options);
    ASSERT_EQ(path.status, Status::Converged) << text(path);
    EXPECT_NEAR(path.scale, scale, 1e-3);  // the prior is about 1
    EXPECT_GT(path.scale_deviation, 0);
    EXPECT_LT(distance(path.x, drive.truth), 0.02);
    EXPECT_LE(path.lower_bound, path.energy);
    options.scale_sigma = 0;
    EXPECT_GT(distance(locate_path(drive.measurements(), options).x, drive.truth), 0.1);
  }
}

TEST(LocatePath, SaysWhatIsWrong) {
  const auto says = [](auto&& change) {
    Drive drive(20, 0);
    PathOptions options;
    change(drive, options);
    const PathEstimate path = locate_path(drive.measurements(), options);
    EXPECT_EQ(path.status, Status::InvalidInput);
    EXPECT_TRUE(path.x.empty());
    return text(path);
  };
  EXPECT_EQ(says([](Drive& d, PathOptions&) { d.range[3] = -1; }), "range 3 is negative");
  EXPECT_EQ(says([](Drive& d, PathOptions&) { d.sigma[3] = 0; }), "sigma 3 is not a finite number > 0");
  EXPECT_EQ(says([](Drive& d, PathOptions&) { d.pose[3] = kNan; }),
            "range 3 is from a pose that does not exist");
  EXPECT_EQ(says([](Drive& d, PathOptions&) { d.beacon[3] = -1; }),
            "range 3 is to a beacon that does not exist");
  EXPECT_EQ(says([](Drive& d, PathOptions&) { d.steps[7] = kNan; }),
            "step 2 has a number that is not finite, or too large");
  EXPECT_EQ(says([](Drive& d, PathOptions&) { d.steps.clear(); }), "a path needs at least one step");
  EXPECT_EQ(says([](Drive& d, PathOptions&) { d.sigma.pop_back(); }),
            "pose, beacon, range and sigma have to be of the same length");
  EXPECT_EQ(says([](Drive&, PathOptions& o) { o.max_iterations = 0; }), "max_iterations has to be >= 1");
  EXPECT_EQ(says([](Drive&, PathOptions& o) { o.scale_sigma = -1; }),
            "scale_sigma has to be a finite number >= 0");
  EXPECT_NE(says([](Drive& d, PathOptions&) {
              std::fill(d.steps.begin(), d.steps.end(), 0.0);
            }).find("the robot does not move"),
            std::string::npos);
}

TEST(LocatePath, EndsWhereAskedTo) {
  const Drive drive(200, 0.1);
  std::atomic<bool> stop{true};
  PathOptions options;
  options.stop = &stop;
  const PathEstimate path = locate_path(drive.measurements(), options);
  EXPECT_EQ(path.status, Status::Interrupted);
  EXPECT_EQ(text(path), "asked to stop");
  EXPECT_TRUE(path.x.empty());
  stop = false;
  EXPECT_EQ(locate_path(drive.measurements(), options).status, Status::Converged);
}

TEST(PathStream, IsTheBatch) {
  const Drive drive(500, 0.3);
  PathStreamOptions options;
  options.window = 60;
  options.cutoff = 2;
  options.turn_sigma = 0.03;
  options.shortest = 0.1;
  options.start = {12.3, 9.9, 0.6};
  options.settle_every = 50;
  PathStream stream(options);
  std::size_t most = 0;
  for (std::size_t k = 0; k < 500; ++k) {
    if (k > 0) {
      const double* step = &drive.steps[3 * k - 3];
      EXPECT_TRUE(stream.move(step[0], step[1], step[2]).empty());
    }
    const auto b = static_cast<std::size_t>(2 * drive.beacon[k]);
    EXPECT_TRUE(stream.range(drive.beacons[b], drive.beacons[b + 1], drive.range[k], drive.sigma[k]).empty());
    most = std::max(most, stream.positions().size() / 2);
    const std::array<double, 3> pose = stream.pose();
    EXPECT_LT(std::hypot(pose[0] - drive.truth[2 * k], pose[1] - drive.truth[2 * k + 1]), 1.0) << k;
    if (k > 0 && k % 50 == 0) {
      EXPECT_LT(distance(stream.positions(), stream.batch()), 1e-9) << k;
    }
  }
  EXPECT_LE(most, 66u);
  const std::array<double, 4> covariance = stream.covariance();
  EXPECT_GT(covariance[0], 0);
  EXPECT_GT(covariance[0] * covariance[3], covariance[1] * covariance[2]);
  EXPECT_FALSE(stream.range(0, 0, -1, 1).empty());
  EXPECT_FALSE(stream.move(kNan, 0, 0).empty());
  EXPECT_THROW(PathStream(PathStreamOptions{}), std::invalid_argument);
}

}  // namespace
