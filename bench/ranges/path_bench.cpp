// A path from odometry and ranges: asterism::locate_path beside least squares of full poses (SE(2)) by Ceres,
// and asterism::PathStream over a path that goes on.
//
// asterism-path-bench FILE.pyfg          errors and times of both, beacons known and unknown
// asterism-path-bench --stream N         N ranges, one with each step, window of 10,000 positions

#include <sys/resource.h>
#include <time.h>

#include <algorithm>
#include <asterism/solver/ranges/path.hpp>
#include <cmath>
#include <complex>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <limits>
#include <map>
#include <random>
#include <sstream>
#include <string>
#include <vector>

// Ceres's headers do not know these warnings.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wshadow"
#pragma GCC diagnostic ignored "-Wpedantic"
#include <ceres/ceres.h>
#pragma GCC diagnostic pop

#include "count_of.hpp"

namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// A file of PyFactorGraph.
struct Recording {
  std::vector<double> truth;  ///< x, y, heading of each pose
  std::vector<double> steps, step_sigma, beacons, pose, range, sigma;
  std::vector<int> beacon;

  std::size_t poses() const { return truth.size() / 3; }
};

bool read(const char* path, Recording& to) {
  std::ifstream file(path);
  if (!file) return false;
  std::map<std::string, int> poses, beacons;
  std::string line, kind, first, second;
  double time = 0;
  while (std::getline(file, line)) {
    std::istringstream words(line);
    words >> kind;
    double v[9] = {};
    if (kind == "VERTEX_SE2") {
      words >> time >> first >> v[0] >> v[1] >> v[2];
      poses.emplace(first, static_cast<int>(to.poses()));
      to.truth.insert(to.truth.end(), v, v + 3);
    } else if (kind == "VERTEX_XY") {
      words >> first >> v[0] >> v[1];
      beacons.emplace(first, static_cast<int>(to.beacons.size() / 2));
      to.beacons.insert(to.beacons.end(), v, v + 2);
    } else if (kind == "EDGE_SE2") {
      words >> time >> first >> second;
      for (double& value : v) words >> value;
      to.steps.insert(to.steps.end(), v, v + 3);
      to.step_sigma.insert(to.step_sigma.end(), {std::sqrt(v[3]), std::sqrt(v[6]), std::sqrt(v[8])});
    } else if (kind == "EDGE_RANGE") {
      words >> time >> first >> second >> v[0] >> v[1];
      if (!poses.contains(first) || !beacons.contains(second)) return false;
      to.pose.push_back(poses[first]);
      to.beacon.push_back(beacons[second]);
      to.range.push_back(v[0]);
      to.sigma.push_back(std::sqrt(v[1]));
    }
    if (!words) return false;
  }
  return to.poses() > 1 && to.steps.size() == 3 * (to.poses() - 1);
}

/// Root mean square error of the positions (every `stride` numbers), after the best rigid motion, mirrored or
/// not, if `moved`.
double error_of(const std::vector<double>& x, std::size_t stride, const Recording& of, bool moved) {
  using Complex = std::complex<double>;
  const auto n = static_cast<double>(of.poses());
  std::vector<Complex> found, truth;
  Complex mean, true_mean;
  for (std::size_t k = 0; k < of.poses(); ++k) {
    found.emplace_back(x[stride * k], x[stride * k + 1]);
    truth.emplace_back(of.truth[3 * k], of.truth[3 * k + 1]);
    mean += found[k] / n;
    true_mean += truth[k] / n;
  }
  double best = kInfinity;
  for (int mirrored = 0; mirrored < (moved ? 2 : 1); ++mirrored) {
    Complex sum;
    const auto centred = [&](std::size_t k) {
      return mirrored == 1 ? std::conj(found[k] - mean) : found[k] - mean;
    };
    for (std::size_t k = 0; k < of.poses(); ++k) sum += (truth[k] - true_mean) * std::conj(centred(k));
    const Complex turn = sum / std::abs(sum);
    double squares = 0;
    for (std::size_t k = 0; k < of.poses(); ++k)
      squares += std::norm((moved ? turn * centred(k) + true_mean : found[k]) - truth[k]);
    best = std::min(best, std::sqrt(squares / n));
  }
  return best;
}

struct Between {
  const double *step, *sigma;

  template <typename T>
  bool operator()(const T* a, const T* b, T* residual) const {
    const T c = ceres::cos(a[2]), s = ceres::sin(a[2]), x = b[0] - a[0], y = b[1] - a[1];
    residual[0] = (c * x + s * y - step[0]) / sigma[0];
    residual[1] = (c * y - s * x - step[1]) / sigma[1];
    const T turn = b[2] - a[2] - step[2];
    residual[2] = ceres::atan2(ceres::sin(turn), ceres::cos(turn)) / sigma[2];
    return true;
  }
};

struct Range {
  double range, sigma;

  template <typename T>
  bool operator()(const T* pose, const T* beacon, T* residual) const {
    const T x = pose[0] - beacon[0], y = pose[1] - beacon[1];
    residual[0] = (ceres::sqrt(x * x + y * y + 1e-12) - range) / sigma;
    return true;
  }
};

/// Of this thread.
double cpu_seconds() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// Full poses, from dead reckoning at the true first pose and from the true places of the beacons.
void peer(const Recording& of, bool known, bool robust) {
  std::vector<double> x(of.truth.begin(), of.truth.begin() + 3);
  for (std::size_t k = 0; k + 1 < of.poses(); ++k) {
    const double *a = &x[3 * k], *s = &of.steps[3 * k], c = std::cos(a[2]), t = std::sin(a[2]);
    const double next[3] = {a[0] + c * s[0] - t * s[1], a[1] + t * s[0] + c * s[1], a[2] + s[2]};
    x.insert(x.end(), next, next + 3);
  }
  std::vector<double> beacons = of.beacons;
  const double start = cpu_seconds();
  ceres::Problem problem;
  for (std::size_t k = 0; k + 1 < of.poses(); ++k)
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Between, 3, 3, 3>(
                                 new Between{&of.steps[3 * k], &of.step_sigma[3 * k]}),
                             nullptr, &x[3 * k], &x[3 * k + 3]);
  for (std::size_t i = 0; i < of.range.size(); ++i) {
    double* beacon = &beacons[2 * static_cast<std::size_t>(of.beacon[i])];
    problem.AddResidualBlock(
        new ceres::AutoDiffCostFunction<Range, 1, 3, 2>(new Range{of.range[i], of.sigma[i]}),
        robust ? new ceres::CauchyLoss(2) : nullptr, &x[3 * static_cast<std::size_t>(of.pose[i])], beacon);
    if (known) problem.SetParameterBlockConstant(beacon);
  }
  if (!known) problem.SetParameterBlockConstant(x.data());
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.max_num_iterations = 200;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  const double seconds = cpu_seconds() - start;
  std::printf("  %-30s %8.3f m %8.3f s  %d iterations\n",
              robust ? "Ceres, poses, Cauchy's loss" : "Ceres, poses", error_of(x, 3, of, !known), seconds,
              static_cast<int>(summary.iterations.size()));
}

void ours(const Recording& of, bool known, double cutoff, bool bound) {
  std::vector<double> beacons = of.beacons;
  if (!known) std::ranges::fill(beacons, kNan);
  asterism::PathOptions options;
  options.cutoff = cutoff;
  options.lower_bound = bound;
  const double start = cpu_seconds();
  const asterism::PathEstimate path =
      asterism::locate_path({of.steps, beacons, of.pose, of.beacon, of.range, of.sigma}, options);
  const double seconds = cpu_seconds() - start;
  if (path.x.empty()) {
    std::printf("  locate_path: %s\n", std::string(std::string_view(path.message)).c_str());
    return;
  }
  const std::string name =
      std::string("locate_path") + (cutoff < kInfinity ? ", cutoff 2" : "") + (bound ? ", bound" : "");
  std::printf("  %-30s %8.3f m %8.3f s  turn_sigma %.5f, energy ", name.c_str(),
              error_of(path.x, 2, of, !known), seconds, path.turn_sigma);
  if (bound)
    std::printf("in [%.1f, %.1f]\n", path.lower_bound, path.energy);
  else
    std::printf("%.1f\n", path.energy);
}

/// The largest distance between two lists of positions.
double largest(const std::vector<double>& a, const std::vector<double>& b) {
  double most = 0;
  for (std::size_t i = 0; i < a.size(); ++i) most = std::max(most, std::abs(a[i] - b[i]));
  return most;
}

void stream(int count) {
  asterism::PathStreamOptions options;
  options.shortest = 0.2;
  options.cutoff = 2;
  options.turn_sigma = 0.01;
  options.step_sigma = 0.1;
  options.start = {10, 10, 0};
  asterism::PathStream path(options);
  const double beacons[4][2] = {{0, 0}, {60, 5}, {50, 60}, {-5, 50}};
  std::mt19937_64 generator(1);
  std::normal_distribution<double> normal;
  double x = 10, y = 10, heading = 0, time = 0, slowest = 0, worst = 0, squares = 0;
  long memory = 0;
  int checks = 0;
  for (int i = 0; i < count; ++i) {
    // Through the hall, turned back at its walls.
    const double aim = std::atan2(30 + 20 * std::sin(i / 900.0) - y, 30 + 20 * std::cos(i / 1300.0) - x);
    const double turn = std::clamp(std::remainder(aim - heading, 6.283185307179586), -0.1, 0.1);
    x += 0.4 * std::cos(heading);
    y += 0.4 * std::sin(heading);
    heading += turn;
    const auto& beacon = beacons[i % 4];
    double range = std::hypot(x - beacon[0], y - beacon[1]) + 0.3 * normal(generator);
    if (generator() % 20 == 0) range += 5;
    const double forward = 0.4 + 0.002 * normal(generator), odometry = turn + 0.003 * normal(generator);
    const double start = cpu_seconds();
    path.move(forward, 0, odometry);
    path.range(beacon[0], beacon[1], std::max(range, 0.0), 0.3);
    const std::array<double, 3> pose = path.pose();
    const double seconds = cpu_seconds() - start;
    time += seconds;
    slowest = std::max(slowest, seconds);
    squares += std::pow(pose[0] - x, 2) + std::pow(pose[1] - y, 2);
    // After a hundred: everywhere at first, then now and then, as the batch takes as long as 1000 ranges.
    if ((i + 1) % 100 == 0 && (i < 3000 || (i + 1) % 2500 == 0)) {
      worst = std::max(worst, largest(path.positions(), path.batch()));
      ++checks;
    }
    if (i + 1 == 20'000 || i + 1 == count) {
      rusage usage{};
      getrusage(RUSAGE_SELF, &usage);
      std::printf(
          "%d ranges: %.1f us of CPU a range, the slowest %.1f ms; window %zu positions; memory %.1f MB "
          "(%+ld kB); "
          "%d times beside the batch: at most %.1e m; error of the current position %.3f m\n",
          i + 1, 1e6 * time / (i + 1), 1e3 * slowest, path.positions().size() / 2,
          static_cast<double>(usage.ru_maxrss) / 1024, memory > 0 ? usage.ru_maxrss - memory : 0, checks,
          worst, std::sqrt(squares / (i + 1)));
      std::fflush(stdout);
      memory = usage.ru_maxrss;
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 3 && std::string(argv[1]) == "--stream") {
    if (const int steps = count_of(argv[2]); steps > 0) {
      stream(steps);
      return 0;
    }
    argc = 0;
  }
  if (argc != 2) {
    std::fprintf(stderr, "asterism-path-bench FILE.pyfg, or --stream N\n");
    return 2;
  }
  Recording recording;
  if (!std::ifstream(argv[1])) {
    std::printf("skipped: there is no %s\n", argv[1]);
    return 0;
  }
  if (!read(argv[1], recording)) {
    std::fprintf(stderr, "%s: expected a file of PyFactorGraph with poses, steps and ranges\n", argv[1]);
    return 1;
  }
  for (const bool known : {true, false}) {
    std::printf("%zu poses, %zu ranges, beacons %s\n", recording.poses(), recording.range.size(),
                known ? "known" : "unknown, after the best rigid motion");
    for (const bool bound : {false, true})
      for (const double cutoff : {kInfinity, 2.0}) ours(recording, known, cutoff, bound);
    for (const bool robust : {false, true}) peer(recording, known, robust);
  }
}
