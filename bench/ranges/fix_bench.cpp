// One position from ranges: asterism::locate on random fixes. Its time, alone and in a batch; a grid search
// as the judge of what it proves; and errors where some ranges are too long.
//
// asterism-fix-bench [FIXES [JUDGED [SEED]]]     of each row of the tables, 20000 and 1000 by default

#include <time.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <asterism/solver/ranges/locate.hpp>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>
#include <random>
#include <vector>

#include "count_of.hpp"

namespace {

double cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

template <int Dim>
using Point = std::array<double, Dim>;

/// Tags in a room of 10 m, each with beacons of its own.
template <int Dim>
struct Tags {
  int beacons_per_tag;
  double sigma;
  std::vector<double> truth, beacons, ranges, sigmas;
  std::vector<bool> is_long;  ///< of each range

  /// `is_flat`: the beacons of a tag are on one line (in space: in one plane). `longer`: the share of ranges
  /// that are too long by up to 10 m.
  Tags(int count, int beacon_count, double deviation, bool is_flat, double longer, int seed)
      : beacons_per_tag(beacon_count),
        sigma(deviation),
        sigmas(static_cast<std::size_t>(beacon_count), deviation) {
    std::mt19937_64 generator(static_cast<unsigned>(seed));
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> in_room(0, 10), share(0, 1);
    for (int tag = 0; tag < count; ++tag) {
      Point<Dim> x, across;
      double square = 0;
      for (double& a : x) a = in_room(generator);
      for (double& a : across) {
        a = normal(generator);
        square += a * a;
      }
      truth.insert(truth.end(), x.begin(), x.end());
      for (int i = 0; i < beacon_count; ++i) {
        Point<Dim> b;
        double height = 0, distance = 0;
        for (std::size_t k = 0; k < Dim; ++k) {
          b[k] = in_room(generator);
          height += is_flat ? across[k] * (b[k] - 5) / square : 0;
        }
        for (std::size_t k = 0; k < Dim; ++k) {
          b[k] -= height * across[k];
          distance += (x[k] - b[k]) * (x[k] - b[k]);
        }
        beacons.insert(beacons.end(), b.begin(), b.end());
        is_long.push_back(share(generator) < longer);
        ranges.push_back(std::max(0.0, std::sqrt(distance) + sigma * normal(generator)) +
                         (is_long.back() ? in_room(generator) : 0));
      }
    }
  }

  int count() const { return static_cast<int>(truth.size()) / Dim; }
  std::span<const double> beacons_of(int tag) const { return part(beacons, tag, Dim * beacons_per_tag); }
  std::span<const double> ranges_of(int tag) const { return part(ranges, tag, beacons_per_tag); }
  std::span<const double> truth_of(int tag) const { return part(truth, tag, Dim); }

 private:
  static std::span<const double> part(const std::vector<double>& of, int tag, int size) {
    return std::span(of).subspan(static_cast<std::size_t>(tag) * static_cast<std::size_t>(size),
                                 static_cast<std::size_t>(size));
  }
};

template <int Dim>
struct Descent {
  Point<Dim> x;
  bool has_converged;
};

/// The judge: least squares of one tag by formulas of its own.
template <int Dim>
class GridSearch {
 public:
  GridSearch(const Tags<Dim>& tags, int tag)
      : beacons_(tags.beacons_of(tag)),
        ranges_(tags.ranges_of(tag)),
        weight_(1 / (tags.sigma * tags.sigma)) {}

  double energy(const Point<Dim>& x) const {
    double sum = 0;
    for (std::size_t i = 0; i < ranges_.size(); ++i) {
      const double stretch = distance(x, i) - ranges_[i];
      sum += weight_ / 2 * stretch * stretch;
    }
    return sum;
  }

  /// Descends from each point of a grid that is lower than its neighbours.
  template <typename Visit>
  void for_each_minimum(Visit&& visit) const {
    constexpr int kSide = Dim == 2 ? 61 : 25;
    constexpr double kFirst = -10, kStep = 30.0 / (kSide - 1);
    int size = 1;
    std::array<int, Dim> stride;
    for (int& s : stride) {
      s = size;
      size *= kSide;
    }
    std::vector<double> energies(static_cast<std::size_t>(size));
    const auto point = [&](int n) {
      Point<Dim> x;
      for (double& a : x) {
        a = kFirst + kStep * (n % kSide);
        n /= kSide;
      }
      return x;
    };
    for (int n = 0; n < size; ++n) energies[static_cast<std::size_t>(n)] = energy(point(n));
    for (int n = 0; n < size; ++n) {
      bool is_lowest = true;
      for (std::size_t k = 0; k < Dim; ++k) {
        const int at = n / stride[k] % kSide;
        for (const int side : {-1, 1}) {
          if (at + side < 0 || at + side >= kSide) continue;
          is_lowest = is_lowest && energies[static_cast<std::size_t>(n)] <=
                                       energies[static_cast<std::size_t>(n + side * stride[k])];
        }
      }
      if (is_lowest) visit(descended(point(n)));
    }
  }

  /// Whether the energy rises on the straight way between two points, by more than their difference.
  bool has_barrier(const Point<Dim>& a, const Point<Dim>& b) const {
    const double top = std::max(energy(a), energy(b)) + 1e-3;
    for (int n = 1; n < 30; ++n) {
      Point<Dim> between;
      for (std::size_t k = 0; k < Dim; ++k) between[k] = a[k] + (b[k] - a[k]) * n / 30;
      if (energy(between) > top) return true;
    }
    return false;
  }

  // The minimum below x, or below a point a little beside it, as x may be a saddle: by Levenberg and
  // Marquardt's steps on the true Hessian.
  Descent<Dim> descended(Point<Dim> x) const {
    using Vector = Eigen::Matrix<double, Dim, 1>;
    using Matrix = Eigen::Matrix<double, Dim, Dim>;
    for (std::size_t k = 0; k < Dim; ++k) x[k] += 1e-3 * std::sin(static_cast<double>(7 * k + 1));
    double damping = 1, here = energy(x), slope = 0;
    for (int n = 0; n < 2000 && damping < 1e12; ++n) {
      Vector gradient = Vector::Zero();
      Matrix hessian = Matrix::Zero();
      for (std::size_t i = 0; i < ranges_.size(); ++i) {
        Vector p;
        for (int k = 0; k < Dim; ++k)
          p[k] = x[static_cast<std::size_t>(k)] - beacons_[Dim * i + static_cast<std::size_t>(k)];
        const double d = std::max(p.norm(), 1e-9), share = ranges_[i] / d;
        gradient += weight_ * (1 - share) * p;
        hessian += weight_ * ((1 - share) * Matrix::Identity() + share / (d * d) * p * p.transpose());
      }
      slope = gradient.norm();
      if (slope < 1e-9 * weight_) break;
      const double least = Eigen::SelfAdjointEigenSolver<Matrix>(hessian).eigenvalues()[0];
      const double shift = weight_ * damping * 1e-6 + std::max(0.0, -1.1 * least);
      const Vector step = (hessian + shift * Matrix::Identity()).ldlt().solve(gradient);
      Point<Dim> next;
      for (int k = 0; k < Dim; ++k)
        next[static_cast<std::size_t>(k)] = x[static_cast<std::size_t>(k)] - step[k];
      const double there = energy(next);
      damping = there < here ? damping / 10 : std::max(damping, 1e-3) * 10;
      if (!(there < here)) continue;
      here = there;
      x = next;
    }
    return {x, slope < 1e-5};  // in a curved valley it takes too long
  }

 private:
  double distance(const Point<Dim>& x, std::size_t i) const {
    double square = 0;
    for (std::size_t k = 0; k < Dim; ++k)
      square += (x[k] - beacons_[Dim * i + k]) * (x[k] - beacons_[Dim * i + k]);
    return std::sqrt(square);
  }

  std::span<const double> beacons_, ranges_;
  double weight_;
};

struct Verdict {
  std::atomic<int> wrong = 0, missing = 0, different = 0;
};

/// Whether a tag has the same minima in a batch and alone.
template <int Dim>
bool is_same(const asterism::PositionFix<Dim>& a, const asterism::PositionFix<Dim>& b) {
  bool is_same = a.status == b.status && a.proven == b.proven && a.count == b.count;
  for (std::size_t i = 0; is_same && i < static_cast<std::size_t>(a.count); ++i) {
    is_same = std::abs(a.minima[i].energy - b.minima[i].energy) < 1e-9 * (1 + b.minima[i].energy);
    for (std::size_t k = 0; k < Dim; ++k)
      is_same = is_same && std::abs(a.minima[i].x[k] - b.minima[i].x[k]) <
                               1e-5 * std::sqrt(b.minima[i].covariance[k * Dim + k]);
  }
  return is_same;
}

/// Judges the fixes of a batch.
template <int Dim>
void judge(const Tags<Dim>& tags, int judged, Verdict& verdict) {
  const int count = std::min(judged, tags.count());
  const auto beacons = static_cast<std::size_t>(count * tags.beacons_per_tag);
  asterism::locate_each<Dim>(
      {count, tags.beacons_per_tag, std::span(tags.beacons).first(Dim * beacons),
       std::span(tags.ranges).first(beacons), tags.sigmas},
      {}, 0, [&](int tag, const asterism::PositionFix<Dim>& fix) {
        verdict.different +=
            !is_same(fix, asterism::locate<Dim>(tags.beacons_of(tag), tags.ranges_of(tag), tags.sigmas));
        if (fix.status != asterism::Status::Converged || !fix.proven) return;
        const GridSearch<Dim> grid(tags, tag);
        bool is_wrong = false, is_missing = false;
        for (int i = 0; i < fix.count; ++i) {  // each is a minimum
          const auto& listed = fix.minima[static_cast<std::size_t>(i)];
          is_wrong = is_wrong ||
                     grid.energy(grid.descended(listed.x).x) < listed.energy - 1e-5 * (1 + listed.energy);
        }
        grid.for_each_minimum([&](const Descent<Dim>& to) {
          const Point<Dim>& x = to.x;
          const double e = grid.energy(x), least = fix.minima[0].energy;
          is_wrong = is_wrong || e < least - 1e-6 * (1 + least);
          if (!to.has_converged || e > least + fix.within - 0.01) return;
          bool is_listed = false;
          for (int i = 0; i < fix.count; ++i)
            is_listed = is_listed || !grid.has_barrier(x, fix.minima[static_cast<std::size_t>(i)].x);
          is_missing = is_missing || !is_listed;
        });
        verdict.wrong += is_wrong;
        verdict.missing += is_missing;
      });
}

template <int Dim>
void least_squares(int beacons, bool is_flat, int fixes, int judged, int seed) {
  const Tags<Dim> tags(fixes, beacons, 0.1, is_flat, 0, seed);
  int proven = 0, closed = 0;
  const double start = cpu_seconds();
  for (int tag = 0; tag < fixes; ++tag) {
    const auto fix = asterism::locate<Dim>(tags.beacons_of(tag), tags.ranges_of(tag), tags.sigmas);
    proven += fix.proven;
    closed += fix.proven && fix.cells == 0;
  }
  const double alone = cpu_seconds() - start;
  double batch = std::numeric_limits<double>::infinity();  // the least of a few, as other programs may run
  std::vector<char> is_proven(static_cast<std::size_t>(fixes));
  for (int round = 0; round < 9; ++round) {
    const auto begin = std::chrono::steady_clock::now();
    asterism::locate_each<Dim>({fixes, beacons, tags.beacons, tags.ranges, tags.sigmas}, {}, 0,
                               [&](int tag, const asterism::PositionFix<Dim>& fix) {
                                 is_proven[static_cast<std::size_t>(tag)] = fix.proven;
                               });
    batch = std::min(batch, std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
  }
  Verdict verdict;
  judge(tags, judged, verdict);
  std::printf("| %d | %d | %s | %.2f | %.2f | %d %% | %d of %d | %d | %d | %d |\n", Dim, beacons,
              is_flat ? "yes" : "no", 1e6 * alone / fixes, 1e6 * batch / fixes, 100 * closed / fixes, proven,
              fixes, verdict.wrong.load(), verdict.missing.load(), verdict.different.load());
  std::fflush(stdout);
}

template <int Dim>
double error(const asterism::PositionFix<Dim>& fix, std::span<const double> truth) {
  double square = 0;
  for (std::size_t k = 0; k < Dim; ++k) square += std::pow(fix.minima[0].x[k] - truth[k], 2);
  return std::sqrt(square);
}

double median(std::vector<double> of) {
  const auto middle = of.begin() + static_cast<std::ptrdiff_t>(of.size() / 2);
  std::nth_element(of.begin(), middle, of.end());
  return *middle;
}

template <int Dim>
void with_outliers(int beacons, double within, int fixes, int seed) {
  const Tags<Dim> tags(fixes, beacons, 0.1, false, 0.3, seed);
  asterism::LocateOptions options;
  options.cutoff = 3;
  options.within = within;
  int proven = 0;
  double slowest = 0, total = 0;
  std::vector<double> errors, of_inliers;
  for (int tag = 0; tag < fixes; ++tag) {
    const double start = cpu_seconds();
    const auto fix = asterism::locate<Dim>(tags.beacons_of(tag), tags.ranges_of(tag), tags.sigmas, options);
    const double seconds = cpu_seconds() - start;
    total += seconds;
    slowest = std::max(slowest, seconds);
    proven += fix.proven;
    std::vector<double> ranges(tags.ranges_of(tag).begin(), tags.ranges_of(tag).end());
    for (std::size_t i = 0; i < ranges.size(); ++i) {
      if (tags.is_long[static_cast<std::size_t>(tag * beacons) + i])
        ranges[i] = std::numeric_limits<double>::quiet_NaN();
    }
    const auto right = asterism::locate<Dim>(tags.beacons_of(tag), ranges, tags.sigmas);
    // Dim + 1 right ranges tell a place, and two more, which of the sets is right.
    if (std::count_if(ranges.begin(), ranges.end(), [](double r) { return r >= 0; }) < Dim + 3) continue;
    if (fix.status != asterism::Status::Converged || right.status != asterism::Status::Converged) continue;
    errors.push_back(error(fix, tags.truth_of(tag)));
    of_inliers.push_back(error(right, tags.truth_of(tag)));
  }
  std::printf("| %d | %d | %.0f | %.0f | %.1f | %d of %d | %zu | ", Dim, beacons, within, 1e6 * total / fixes,
              1e3 * slowest, proven, fixes, errors.size());
  if (errors.empty())
    std::printf("- | - |\n");
  else
    std::printf("%.3f | %.3f |\n", median(errors), median(of_inliers));
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  const int fixes = argc > 1 ? count_of(argv[1]) : 20'000, judged = argc > 2 ? count_of(argv[2]) : 1000;
  const int seed = argc > 3 ? count_of(argv[3]) : 1;
  if (argc > 4 || fixes < 1 || judged < 0 || seed < 0) {
    std::fprintf(stderr, "asterism-fix-bench [FIXES [JUDGED [SEED]]]: fixes in each row, at least 1 and 0\n");
    return 2;
  }
  std::printf(
      "| dimensions | beacons | flat | CPU alone [us] | in a batch [us] | closed form | proven | wrong | "
      "missing | not the same alone "
      "|\n|---|---|---|---|---|---|---|---|---|---|\n");
  for (const bool is_flat : {false, true})
    for (const int beacons : {3, 4, 5, 6, 8, 12}) least_squares<2>(beacons, is_flat, fixes, judged, seed);
  for (const int beacons : {4, 5, 6, 8, 12}) least_squares<3>(beacons, false, fixes, judged, seed);
  for (const int beacons : {3, 4, 5, 6, 8, 12}) least_squares<3>(beacons, true, fixes, judged, seed);
  std::printf(
      "\n| dimensions | beacons | within | CPU [us] | slowest [ms] | proven | scored | median error [m] | of "
      "the "
      "right inliers [m] |\n|---|---|---|---|---|---|---|---|---|\n");
  for (const double within : {0.0, 5.0}) {
    for (const int beacons : {8, 10, 12}) with_outliers<2>(beacons, within, std::max(1, fixes / 10), seed);
    for (const int beacons : {8, 10, 12}) with_outliers<3>(beacons, within, std::max(1, fixes / 20), seed);
  }
}
