// Positions from ranges, against formulas of their own: descents from a grid of starts, all sets of inliers,
// and finite differences.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <asterism/solver/ranges/locate.hpp>
#include <asterism/testing/random_system.hpp>
#include <atomic>
#include <cmath>
#include <limits>
#include <ostream>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "counting_allocator.hpp"

namespace asterism {
namespace {

using testing::allocations_in;
using testing::Rng;

constexpr double kNone = std::numeric_limits<double>::infinity();
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

template <int Dim>
using Point = std::array<double, Dim>;

template <int Dim>
struct Problem {
  std::vector<double> beacons, ranges, sigma;
  double cutoff = kNone;

  std::size_t count() const { return ranges.size(); }
  double distance(std::size_t i, const Point<Dim>& x) const {
    double square = 0;
    for (std::size_t k = 0; k < Dim; ++k) square += std::pow(x[k] - beacons[Dim * i + k], 2);
    return std::sqrt(square);
  }
  double energy(const Point<Dim>& x) const {
    double sum = 0;
    for (std::size_t i = 0; i < count(); ++i)
      sum += std::min(0.5 * std::pow((distance(i, x) - ranges[i]) / sigma[i], 2), 0.5 * cutoff * cutoff);
    return sum;
  }
  /// The next iterate of the majorisation, which never raises the energy of the ranges of `set`.
  Point<Dim> next(const Point<Dim>& x, const std::vector<bool>& set) const {
    Point<Dim> sum{};
    double total = 0;
    for (std::size_t i = 0; i < count(); ++i) {
      if (!set[i]) continue;
      const double w = std::pow(sigma[i], -2), d = distance(i, x);
      total += w;
      for (std::size_t k = 0; k < Dim; ++k) {
        const double b = beacons[Dim * i + k];
        sum[k] += w * (b + (d > 0 ? ranges[i] * (x[k] - b) / d : 0));
      }
    }
    for (double& a : sum) a /= total;
    return sum;
  }
  Point<Dim> descended(Point<Dim> x, const std::vector<bool>& set, int iterations = 3000) const {
    for (int n = 0; n < iterations; ++n) {
      const Point<Dim> y = next(x, set);
      double moved = 0;
      for (std::size_t k = 0; k < Dim; ++k) moved += std::abs(y[k] - x[k]);
      x = y;
      if (moved < 1e-12) break;
    }
    return x;
  }
  std::vector<bool> inliers(const Point<Dim>& x) const {
    std::vector<bool> set(count());
    for (std::size_t i = 0; i < count(); ++i)
      set[i] = std::abs(distance(i, x) - ranges[i]) < cutoff * sigma[i];
    return set;
  }
  /// The same for the set of inliers of each iterate.
  Point<Dim> descended(Point<Dim> x) const {
    for (int n = 0; n < 300; ++n) {
      const std::vector<bool> set = inliers(x);
      if (std::count(set.begin(), set.end(), true) == 0) break;
      x = descended(x, set, cutoff == kNone ? 3000 : 10);
      if (cutoff == kNone) break;
    }
    return x;
  }
  PositionFix<Dim> solve(double within = 5) const {
    LocateOptions options;
    options.cutoff = cutoff;
    options.within = within;
    return locate<Dim>(beacons, ranges, sigma, options);
  }
};

enum Kind { kScattered, kFlat, kAlmostFlat, kUnrelated };

struct Case {
  Kind kind;
  double sigma;
  double cutoff = kNone;
};
void PrintTo(const Case& c, std::ostream* out) {
  *out << "kind " << c.kind << ", sigma " << c.sigma << ", cutoff " << c.cutoff;
}

template <int Dim>
Problem<Dim> random_problem(Rng& rng, Kind kind, double sigma, int beacons) {
  Problem<Dim> problem;
  Point<Dim> tag, normal;
  for (double& a : tag) a = rng.uniform(0, 10);
  double length = 0;
  for (double& a : normal) {
    a = rng.uniform(-1, 1);
    length += a * a;
  }
  for (double& a : normal) a /= std::sqrt(length);
  for (int i = 0; i < beacons; ++i) {
    Point<Dim> b;
    for (double& a : b) a = rng.uniform(0, 10);
    if (kind == kFlat || kind == kAlmostFlat) {
      double height = kind == kFlat ? 0 : rng.uniform(-0.2, 0.2);
      for (std::size_t k = 0; k < Dim; ++k) height += normal[k] * (b[k] - 5);
      for (std::size_t k = 0; k < Dim; ++k) b[k] -= height * normal[k];
    }
    problem.beacons.insert(problem.beacons.end(), b.begin(), b.end());
    problem.sigma.push_back(sigma * rng.uniform(0.5, 2));
    const double true_range = problem.distance(static_cast<std::size_t>(i), tag);
    problem.ranges.push_back(kind == kUnrelated ? rng.uniform(0, 10)
                                                : std::max(0.0, true_range + sigma * rng.uniform(-2, 2)));
  }
  return problem;
}

template <int Dim>
std::string text(const PositionFix<Dim>& fix) {
  return std::string(std::string_view(fix.message));
}

/// Whether a place belongs to a listed minimum: it is there, or the energy between them hardly rises.
template <int Dim>
bool is_listed(const Problem<Dim>& problem, const PositionFix<Dim>& fix, const Point<Dim>& x) {
  for (int i = 0; i < fix.count; ++i) {
    const auto& known = fix.minima[static_cast<std::size_t>(i)];
    double top = 0;
    for (int n = 1; n < 20; ++n) {
      Point<Dim> between;
      for (std::size_t k = 0; k < Dim; ++k) between[k] = x[k] + (known.x[k] - x[k]) * n / 20;
      top = std::max(top, problem.energy(between));
    }
    if (top <= std::max(problem.energy(x), known.energy) + 1e-3) return true;
  }
  return false;
}

/// Whether a point nearby is lower: x is no minimum then.
template <int Dim>
bool is_lower_nearby(const Problem<Dim>& problem, const Point<Dim>& x, Rng& rng) {
  // With a cutoff other minima are near.
  const double largest = (problem.cutoff == kNone ? 1 : 0.03) * problem.sigma[0];
  for (int n = 0; n < 300; ++n) {
    Point<Dim> y = x;
    for (double& a : y) a += largest * std::pow(10, -(n % 4)) * rng.uniform(-1, 1);
    if (problem.energy(y) < problem.energy(x) - 1e-9) return true;
  }
  return false;
}

class Locate : public ::testing::TestWithParam<Case> {};

template <int Dim>
void check_against_a_grid(const Case& c, int problems) {
  Rng rng(static_cast<unsigned>(100 * c.sigma) + 7 * c.kind + Dim);
  for (int n = 0; n < problems; ++n) {
    SCOPED_TRACE(n);
    auto problem = random_problem<Dim>(rng, c.kind, c.sigma, c.cutoff == kNone ? 3 + n % 10 : 7 + n % 3);
    problem.cutoff = c.cutoff;
    if (c.cutoff != kNone) {
      for (std::size_t i = 0; i < 2; ++i) problem.ranges[i] += rng.uniform(1, 10);
    }
    const PositionFix<Dim> fix = problem.solve();
    ASSERT_EQ(fix.status, Status::Converged) << text(fix);
    EXPECT_TRUE(fix.proven) << text(fix);
    EXPECT_TRUE(c.kind != kFlat || c.cutoff != kNone || fix.cells == 0) << "a search, where none is needed";
    // Fewer than Dim inliers do not make a minimum.
    const double most =
        std::min(fix.minima[0].energy + fix.within,
                 (static_cast<double>(problem.count()) - Dim + 0.9) * 0.5 * c.cutoff * c.cutoff);
    double weights = 0;
    for (int i = 0; i < fix.count; ++i) {
      const auto& minimum = fix.minima[static_cast<std::size_t>(i)];
      EXPECT_NEAR(problem.energy(minimum.x), minimum.energy, 1e-9 * (1 + minimum.energy));
      EXPECT_GE(minimum.energy, fix.minima[0].energy);
      EXPECT_LE(minimum.energy, fix.minima[0].energy + 5);
      const Point<Dim> next = problem.next(minimum.x, problem.inliers(minimum.x));
      for (std::size_t k = 0; k < Dim; ++k) EXPECT_NEAR(next[k], minimum.x[k], 1e-6) << "not stationary";
      EXPECT_FALSE(c.cutoff == kNone && is_lower_nearby<Dim>(problem, minimum.x, rng));
      weights += minimum.weight;
    }
    EXPECT_NEAR(weights, 1, 1e-12);
    constexpr int kGrid = Dim == 2 ? 9 : 5;
    for (int g = 0; g < (Dim == 2 ? kGrid * kGrid : kGrid * kGrid * kGrid); ++g) {
      Point<Dim> x;
      for (int k = 0, rest = g; k < Dim; ++k, rest /= kGrid)
        x[static_cast<std::size_t>(k)] = -5 + 20.0 * (rest % kGrid) / (kGrid - 1) + rng.uniform(-0.1, 0.1);
      x = problem.descended(x);
      const double e = problem.energy(x);
      ASSERT_GE(e, fix.minima[0].energy - 1e-7 * (1 + e)) << "a lower energy than the proven one";
      if (e > most - 1e-2 || is_listed<Dim>(problem, fix, x)) continue;
      EXPECT_TRUE(is_lower_nearby<Dim>(problem, x, rng)) << "a minimum is missing, of energy " << e;
    }
  }
}

TEST_P(Locate, FindsAllMinimaThatAGridOfStartsFinds) {
  check_against_a_grid<2>(GetParam(), 40);
  check_against_a_grid<3>(GetParam(), 20);
}

INSTANTIATE_TEST_SUITE_P(Kinds, Locate,
                         ::testing::Values(Case{kScattered, 0.1}, Case{kScattered, 1}, Case{kFlat, 0.05},
                                           Case{kFlat, 0.5}, Case{kAlmostFlat, 0.1}, Case{kAlmostFlat, 0.5},
                                           Case{kUnrelated, 0.5}, Case{kScattered, 0.2, 3},
                                           Case{kFlat, 0.2, 3}, Case{kUnrelated, 0.5, 3}));

// Ranges that have nothing to do with each other: each two meet somewhere, and no place fits better.
// Counted, as a time would depend on the machine: where bounds are lost, a search still ends, after
// thousands.
TEST(Locate, TakesTensOfCellsWithoutACutoff) {
  Rng rng(11);
  double cells = 0;
  constexpr int kFixes = 500;
  for (int n = 0; n < kFixes; ++n) cells += random_problem<3>(rng, kScattered, 0.1, 4).solve().cells;
  EXPECT_LT(cells / kFixes, 100);
}

TEST(Locate, ListsTheLowestMinimaWhereThereAreTooMany) {
  Rng rng(3);
  int cut = 0;
  for (int n = 0; n < 100; ++n) {
    auto problem = random_problem<2>(rng, kUnrelated, 0.1, 12);
    problem.cutoff = 3;
    const PositionFix<2> fix = problem.solve();
    ASSERT_EQ(fix.status, Status::Converged) << text(fix);
    EXPECT_TRUE(fix.proven) << text(fix);
    EXPECT_GE(fix.within, 0);
    if (fix.within == 5) continue;
    ++cut;
    EXPECT_EQ(fix.count, fix.kMost);
    EXPECT_LT(fix.within, 5);
    EXPECT_NE(text(fix).find("more than 32 places fit"), std::string::npos) << text(fix);
    EXPECT_NEAR(problem.solve(fix.within / 2).minima[0].energy, fix.minima[0].energy, 1e-9);
  }
  EXPECT_GE(cut, 5);
}

TEST(Locate, FindsTheBestOfAllSetsOfInliers) {
  Rng rng(5);
  for (int n = 0; n < 12; ++n) {
    SCOPED_TRACE(n);
    auto problem = random_problem<2>(rng, kScattered, 0.1, 7);
    problem.cutoff = 3;
    for (int i = 0; i < 2; ++i) problem.ranges[static_cast<std::size_t>(i)] += rng.uniform(1, 10);
    const PositionFix<2> fix = problem.solve(0.5);
    ASSERT_EQ(fix.status, Status::Converged) << text(fix);
    EXPECT_TRUE(fix.proven) << text(fix);
    double least = kNone;
    for (unsigned set = 0; set < 1U << problem.count(); ++set) {
      std::vector<bool> inliers(problem.count());
      for (std::size_t i = 0; i < problem.count(); ++i) inliers[i] = (set >> i & 1U) != 0;
      if (std::count(inliers.begin(), inliers.end(), true) < 3) continue;
      for (int g = 0; g < 9; ++g) {
        const Point<2> x = problem.descended({-2 + 7.0 * (g % 3), -2 + 7.0 * (g / 3)}, inliers, 300);
        least = std::min(least, problem.energy(x));
      }
    }
    EXPECT_LE(fix.minima[0].energy, least + 1e-9);
    EXPECT_NEAR(fix.minima[0].energy, least, 1e-3);
  }
}

/// Descends in the least squares of every set of inliers, from many places: where the inliers of the end are
/// the set, that is a minimum, which has to be listed. Whether the fix is proven; otherwise it need not be.
template <int Dim>
bool agrees_with_all_sets(Rng& rng, Problem<Dim> problem) {
  for (std::size_t i = 0; i < 2; ++i) problem.ranges[i] += rng.uniform(0, 10);
  problem.cutoff = 2;
  const PositionFix<Dim> fix = problem.solve();
  if (fix.status == Status::InvalidInput) return true;  // no place agrees with Dim ranges
  EXPECT_EQ(fix.status, Status::Converged) << text(fix);
  if (fix.status != Status::Converged || !fix.proven) return false;
  // Fewer than Dim inliers do not make a minimum.
  const double most =
      std::min(fix.minima[0].energy + fix.within, 2 * (static_cast<double>(problem.count()) - Dim + 0.9)) -
      1e-2;
  for (unsigned set = 0; set < 1U << problem.count(); ++set) {
    std::vector<bool> inliers(problem.count());
    for (std::size_t i = 0; i < problem.count(); ++i) inliers[i] = (set >> i & 1U) != 0;
    const auto count = std::count(inliers.begin(), inliers.end(), true);
    if (count < Dim ||
        2.0 * static_cast<double>(problem.ranges.size() - static_cast<std::size_t>(count)) > most)
      continue;
    for (int g = 0; g < (Dim == 2 ? 9 : 27); ++g) {
      Point<Dim> x;
      for (int k = 0, rest = g; k < Dim; ++k, rest /= 3)
        x[static_cast<std::size_t>(k)] = -1 + 6 * (rest % 3) + rng.uniform(-0.1, 0.1);
      x = problem.descended(x, inliers, 2000);
      const Point<Dim> next = problem.next(x, inliers);
      double moved = 0;
      for (std::size_t k = 0; k < Dim; ++k) moved += std::abs(next[k] - x[k]);
      if (moved > 1e-9 || problem.inliers(x) != inliers) continue;
      const double e = problem.energy(x);
      EXPECT_GE(e, fix.minima[0].energy - 1e-7 * (1 + e)) << "a lower energy than the proven one";
      if (e > most || is_listed<Dim>(problem, fix, x)) continue;
      EXPECT_TRUE(is_lower_nearby<Dim>(problem, x, rng)) << "a minimum is missing, of energy " << e;
    }
  }
  return true;
}

TEST(Locate, FindsTheMinimaOfAllSetsOfInliers) {
  Rng rng(21);
  for (const Kind kind : {kScattered, kFlat, kAlmostFlat, kUnrelated}) {
    for (int n = 0; n < 6; ++n) {
      SCOPED_TRACE(::testing::Message() << "kind " << kind << ", " << n);
      EXPECT_TRUE(agrees_with_all_sets<2>(rng, random_problem<2>(rng, kind, 0.2, 4 + n % 5)));
      EXPECT_TRUE(agrees_with_all_sets<3>(rng, random_problem<3>(rng, kind, 0.2, 5 + n % 4)));
    }
  }
}

TEST(Locate, BeaconsThatWereHeardTwiceOrAreOnOneLine) {
  Rng rng(22);
  int proven = 0;
  for (int n = 0; n < 4; ++n) {
    SCOPED_TRACE(n);
    auto plane = random_problem<2>(rng, kScattered, 0.2, 6);
    auto space = random_problem<3>(rng, kScattered, 0.2, 7);
    for (std::size_t k = 0; k < 2; ++k) plane.beacons[k] = plane.beacons[2 + k];
    for (std::size_t k = 0; k < 3; ++k) {
      space.beacons[k] = space.beacons[3 + k];
      space.beacons[6 + k] = 2 * space.beacons[9 + k] - space.beacons[3 + k];
    }
    proven += agrees_with_all_sets<2>(rng, plane) ? 1 : 0;
    proven += agrees_with_all_sets<3>(rng, space) ? 1 : 0;
  }
  EXPECT_GE(proven, 6);  // of 8: some searches are too long
}

/// Where three ranges meet: in coordinates along the first two beacons and in the plane of the three.
std::vector<Point<3>> meets(const Problem<3>& problem, const std::array<std::size_t, 3>& set) {
  const auto from_first = [&](std::size_t i) {
    Point<3> p;
    for (std::size_t k = 0; k < 3; ++k) p[k] = problem.beacons[3 * i + k] - problem.beacons[3 * set[0] + k];
    return p;
  };
  const auto dot = [](const Point<3>& a, const Point<3>& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  };
  const auto normalised = [&](Point<3> a) {
    const double length = std::sqrt(dot(a, a));
    for (double& value : a) value /= length;
    return a;
  };
  const Point<3> second = from_first(set[1]), third = from_first(set[2]);
  const Point<3> e = normalised(second);
  Point<3> across = third;
  for (std::size_t k = 0; k < 3; ++k) across[k] -= dot(third, e) * e[k];
  const Point<3> f = normalised(across);
  const Point<3> g{e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]};
  const auto square = [&](std::size_t n) { return problem.ranges[set[n]] * problem.ranges[set[n]]; };
  const double x = (square(0) - square(1) + dot(second, second)) / (2 * dot(second, e));
  const double y = (square(0) - square(2) + dot(third, third) - 2 * dot(third, e) * x) / (2 * dot(third, f));
  const double height = square(0) - x * x - y * y;
  std::vector<Point<3>> places;
  for (const double side : {-1, 1}) {
    if (!(height >= 0)) continue;
    Point<3> place;
    for (std::size_t k = 0; k < 3; ++k)
      place[k] = problem.beacons[3 * set[0] + k] + x * e[k] + y * f[k] + side * std::sqrt(height) * g[k];
    places.push_back(place);
  }
  return places;
}

// Beacons near one another leave long, curved valleys. A saddle in one is no minimum, and a place where three
// ranges meet, and no other is an inlier, is one.
TEST(Locate, BeaconsNearOneAnother) {
  Rng rng(23);
  int judged = 0;
  for (int n = 0; n < 60; ++n) {
    SCOPED_TRACE(n);
    auto problem = random_problem<3>(rng, kScattered, 0.03, 7);
    problem.cutoff = 2;
    for (std::size_t i = 1; i < (n % 2 == 0 ? 2U : 7U); i += 2) {
      for (std::size_t k = 0; k < 3; ++k)
        problem.beacons[3 * i + k] = problem.beacons[3 * i - 3 + k] + rng.uniform(-0.015, 0.015);
      problem.ranges[i] = std::max(0.0, problem.ranges[i - 1] + rng.uniform(-0.06, 0.06));
    }
    for (double& r : problem.ranges)
      if (rng.uniform(0, 1) < 0.3) r += rng.uniform(0, 10);
    const PositionFix<3> fix = problem.solve();
    ASSERT_EQ(fix.status, Status::Converged) << text(fix);
    for (int i = 0; i < fix.count; ++i) {
      const auto& c = fix.minima[static_cast<std::size_t>(i)].covariance;
      EXPECT_TRUE(c[0] > 0 && c[4] > 0 && c[8] > 0)
          << "a saddle of energy " << fix.minima[static_cast<std::size_t>(i)].energy;
    }
    if (!fix.proven || fix.minima[0].energy + fix.within < 8.1) continue;
    for (std::size_t k = 2; k < 7; ++k) {
      for (std::size_t j = 1; j < k; ++j) {
        for (std::size_t i = 0; i < j; ++i) {
          for (const Point<3>& x : meets(problem, {i, j, k})) {
            std::vector<bool> set(7);
            set[i] = set[j] = set[k] = true;
            if (problem.inliers(x) != set) continue;
            ++judged;
            EXPECT_TRUE(is_listed<3>(problem, fix, x)) << i << " " << j << " " << k;
          }
        }
      }
    }
  }
  EXPECT_GT(judged, 200);
}

// Not a millimetre from a minimum, the second range becomes an outlier, and the energy falls towards another
// minimum, a metre away. The ridge is 2e-5 high.
TEST(Locate, ARidgeCloseToAMinimumIsABarrier) {
  Problem<2> problem;
  problem.beacons = {6.4857197465253345, 7.1580563185513313, 7.2252144315388991, 8.6373402412645746,
                     6.4698576444764866, 7.1891414870654673, 7.2107569171022323, 8.5887108541392294,
                     6.5090787939954042, 7.166747830200566};
  problem.ranges = {4.9970227624200412, 6.7345383027093577, 5.0817713557637942, 6.5698476072504501,
                    6.2172712060362434};
  problem.sigma.assign(5, 0.03);
  problem.cutoff = 2;
  const std::vector<bool> set{true, true, true, true, false};
  const Point<2> x = problem.descended({4.8046662, 2.4170693}, set, 100000);
  ASSERT_EQ(problem.inliers(x), set);
  const PositionFix<2> fix = problem.solve();
  ASSERT_TRUE(fix.proven);
  double nearest = kNone;
  for (int i = 0; i < fix.count; ++i) {
    const auto& known = fix.minima[static_cast<std::size_t>(i)];
    nearest = std::min(nearest, std::hypot(known.x[0] - x[0], known.x[1] - x[1]));
  }
  EXPECT_LT(nearest, 1e-5);
}

TEST(Locate, FindsTheInliersAmongManyRanges) {
  Rng rng(11);
  for (int n = 0; n < 5; ++n) {
    auto problem = random_problem<3>(rng, kScattered, 0.1, 90);
    std::vector<bool> right(problem.count(), true);
    for (std::size_t i = 0; i < problem.count(); i += 3) {
      problem.ranges[i] += rng.uniform(5, 10);
      right[i] = false;
    }
    problem.cutoff = 5;
    const PositionFix<3> fix = problem.solve();
    ASSERT_EQ(fix.status, Status::Converged) << text(fix);
    EXPECT_TRUE(fix.proven) << text(fix);
    EXPECT_EQ(problem.inliers(fix.minima[0].x), right);
    const Point<3> x = problem.descended(fix.minima[0].x, right);
    for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(fix.minima[0].x[k], x[k], 1e-9);
  }
}

TEST(Locate, TheMirrorImageOfFlatBeaconsIsAMinimum) {
  // Beacons under a ceiling at z = 3, a tag at a height of 1.
  Problem<3> problem;
  problem.beacons = {0, 0, 3, 8, 0, 3, 8, 5, 3, 0, 5, 3};
  problem.sigma.assign(4, 0.1);
  for (std::size_t i = 0; i < 4; ++i) problem.ranges.push_back(problem.distance(i, {2, 1, 1}));
  const PositionFix<3> fix = problem.solve();
  ASSERT_EQ(fix.count, 2);
  EXPECT_TRUE(fix.proven);
  for (int i = 0; i < 2; ++i) {
    const auto& minimum = fix.minima[static_cast<std::size_t>(i)];
    EXPECT_NEAR(minimum.x[0], 2, 1e-9);
    EXPECT_NEAR(minimum.x[1], 1, 1e-9);
    EXPECT_NEAR(std::abs(minimum.x[2] - 3), 2, 1e-9);
    EXPECT_NEAR(minimum.weight, 0.5, 1e-9);
  }
  EXPECT_NE(text(fix).find("mirror"), std::string::npos);
}

TEST(Locate, AHigherMinimumIsNotTakenForTheLowerOne) {
  // Halfway between the two the energy is below that of the higher one, which has a barrier beside it.
  Problem<3> problem;
  problem.beacons = {4.28549, 4.4233,  1.12917, 3.88751, 1.01574, 4.35286,
                     2.34886, 7.90289, 7.37784, 7.17121, 7.32162, 1.46928};
  problem.ranges = {5.30116, 7.21259, 3.36972, 5.43629};
  problem.sigma.assign(4, 0.5);
  const PositionFix<3> fix = problem.solve();
  EXPECT_TRUE(fix.proven);
  ASSERT_EQ(fix.count, 2);
  Point<3> middle;
  for (std::size_t k = 0; k < 3; ++k) middle[k] = 0.5 * (fix.minima[0].x[k] + fix.minima[1].x[k]);
  EXPECT_LT(problem.energy(middle), fix.minima[1].energy);
}

TEST(Locate, TheCovarianceIsTheInverseOfTheHessian) {
  Rng rng(3);
  const auto problem = random_problem<3>(rng, kScattered, 0.2, 8);
  const auto minimum = problem.solve().minima[0];
  constexpr double kStep = 1e-4;
  double hessian[3][3];
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t l = 0; l < 3; ++l) {
      double sum = 0;
      for (const int a : {-1, 1}) {
        for (const int b : {-1, 1}) {
          Point<3> x = minimum.x;
          x[k] += a * kStep;
          x[l] += b * kStep;
          sum += a * b * problem.energy(x);
        }
      }
      hessian[k][l] = sum / (4 * kStep * kStep);
    }
  }
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t l = 0; l < 3; ++l) {
      double product = 0;
      for (std::size_t j = 0; j < 3; ++j) product += hessian[k][j] * minimum.covariance[3 * j + l];
      EXPECT_NEAR(product, k == l ? 1 : 0, 1e-4);
    }
  }
}

TEST(Locate, RangesOfZeroAndRangesThatWereNotHeard) {
  const std::vector<double> beacons{0, 0, 4, 0, 0, 3, 7, 7}, sigma(4, 0.1);
  for (const std::vector<double>& ranges :
       {std::vector<double>{0, 4, 3, kNaN}, std::vector<double>{0, 4, kNaN, std::sqrt(98.0)}}) {
    const PositionFix<2> fix = locate<2>(beacons, ranges, sigma);
    ASSERT_EQ(fix.status, Status::Converged) << text(fix);
    EXPECT_TRUE(fix.proven);
    EXPECT_NEAR(fix.minima[0].x[0], 0, 1e-9);
    EXPECT_NEAR(fix.minima[0].x[1], 0, 1e-9);
  }
  const std::vector<double> zero(4, 0.0);  // the mean of the beacons
  const PositionFix<2> fix = locate<2>(beacons, zero, sigma);
  ASSERT_EQ(fix.status, Status::Converged) << text(fix);
  EXPECT_TRUE(fix.proven);
  EXPECT_NEAR(fix.minima[0].x[0], 11.0 / 4, 1e-9);
  EXPECT_NEAR(fix.minima[0].x[1], 10.0 / 4, 1e-9);
}

TEST(Locate, TheUnitOfLengthDoesNotMatter) {
  Rng rng(8);
  const auto problem = random_problem<3>(rng, kScattered, 0.3, 6);
  const PositionFix<3> expected = problem.solve();
  for (const double unit : {0x1p-200, 0x1p+200}) {
    auto scaled = problem;
    for (auto* numbers : {&scaled.beacons, &scaled.ranges, &scaled.sigma})
      for (double& number : *numbers) number *= unit;
    const PositionFix<3> fix = scaled.solve();
    ASSERT_EQ(fix.count, expected.count) << text(fix);
    EXPECT_TRUE(fix.proven);
    EXPECT_NEAR(fix.minima[0].energy, expected.minima[0].energy, 1e-12);
    for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(fix.minima[0].x[k] / unit, expected.minima[0].x[k], 1e-9);
    EXPECT_NEAR(fix.minima[0].covariance[0] / unit / unit, expected.minima[0].covariance[0], 1e-9);
  }
}

TEST(Locate, SaysWhatIsWrong) {
  struct Wrong {
    std::vector<double> beacons, ranges, sigma;
    const char* says;
    LocateOptions options;
  };
  const std::vector<double> square{0, 0, 1, 0, 1, 1}, ones(3, 1.0);
  LocateOptions cutoff, within, cells, tight;
  cutoff.cutoff = 0;
  within.within = kNaN;
  cells.max_cells = 0;
  tight.cutoff = 1;
  for (const Wrong& wrong : {
           Wrong{square, {1, -1, 1}, ones, "range 1 is negative", {}},
           Wrong{square, {1, 1, kNone}, ones, "range 2 is too large or infinite", {}},
           Wrong{square, ones, {1, 1, 0}, "sigma 2 is not a finite number > 0", {}},
           Wrong{square, ones, {-1, 1, 1}, "sigma 0 is not", {}},
           Wrong{square, ones, {kNaN, 1, 1}, "sigma 0 is not", {}},
           Wrong{{0, 0, kNaN, 0, 1, 1},
                 ones,
                 ones,
                 "beacon 1 has a coordinate that is not finite, or too large",
                 {}},
           Wrong{square, ones, {1, 1, 1e-30}, "sigma is out of proportion to the distances", {}},
           Wrong{square, {1, kNaN, kNaN}, ones, "needs ranges to at least 2 beacons, found 1", {}},
           Wrong{{5, 5, 5, 5, 5, 5}, ones, ones, "all in one place", {}},
           Wrong{square, {1, 1}, ones, "same number of beacons", {}},
           Wrong{square, ones, ones, "cutoff", cutoff},
           Wrong{square, ones, ones, "within", within},
           Wrong{square, ones, ones, "max_cells", cells},
           Wrong{{0, 0, 50, 0}, {1, 1}, {0.1, 0.1}, "no position agrees with 2 ranges", tight},
       }) {
    const PositionFix<2> fix = locate<2>(wrong.beacons, wrong.ranges, wrong.sigma, wrong.options);
    EXPECT_EQ(fix.status, Status::InvalidInput) << wrong.says;
    EXPECT_NE(text(fix).find(wrong.says), std::string::npos) << text(fix);
    EXPECT_EQ(fix.count, 0);
    EXPECT_FALSE(fix.proven);
  }
  const std::vector<double> line{0, 0, 0, 1, 2, 3, 2, 4, 6, -1, -2, -3}, four(4, 3.0);
  EXPECT_NE(text(locate<3>(line, four, four)).find("on one line"), std::string::npos);
}

TEST(Locate, IsNotProvenWhereTheSearchIsCutShort) {
  Rng rng(2);
  auto problem = random_problem<3>(rng, kAlmostFlat, 1, 6);
  LocateOptions options;
  options.max_cells = 3;
  const PositionFix<3> fix = locate<3>(problem.beacons, problem.ranges, problem.sigma, options);
  ASSERT_EQ(fix.status, Status::Converged);
  EXPECT_FALSE(fix.proven);
  EXPECT_NE(text(fix).find("max_cells"), std::string::npos);
}

TEST(Locate, NeedsNoHeap) {
  Rng rng(4);
  for (const Kind kind : {kScattered, kFlat, kUnrelated}) {
    auto problem = random_problem<3>(rng, kind, 0.3, 12);
    EXPECT_EQ(allocations_in([&] { problem.solve(); }), 0);
    problem.cutoff = 3;
    EXPECT_EQ(allocations_in([&] { problem.solve(); }), 0);
  }
}

/// Whether two results are the same, up to rounding. Minima are compared in units of their deviations.
template <int Dim>
bool is_same(const PositionFix<Dim>& a, const PositionFix<Dim>& b) {
  if (a.status != b.status || a.proven != b.proven || a.count != b.count || a.within != b.within ||
      text(a) != text(b))
    return false;
  for (std::size_t i = 0; i < static_cast<std::size_t>(a.count); ++i) {
    const auto &x = a.minima[i], &y = b.minima[i];
    if (std::abs(x.energy - y.energy) > 1e-9 * (1 + y.energy) || std::abs(x.weight - y.weight) > 1e-5)
      return false;
    for (std::size_t k = 0; k < Dim; ++k) {
      const double deviation = std::sqrt(y.covariance[k * Dim + k]);
      if (std::abs(x.x[k] - y.x[k]) > 1e-5 * deviation) return false;
      for (std::size_t l = 0; l < Dim; ++l) {
        const double most = 1e-5 * deviation * std::sqrt(y.covariance[l * Dim + l]);
        if (std::abs(x.covariance[k * Dim + l] - y.covariance[k * Dim + l]) > most) return false;
      }
    }
  }
  return true;
}

template <int Dim>
void check_each(Kind kind, int beacons, bool has_own_beacons, bool has_own_sigma) {
  Rng rng(static_cast<unsigned>(6 + kind));
  constexpr int kTags = 1003;
  const auto shared = random_problem<Dim>(rng, kind, 0.1, beacons);
  Problem<Dim> all;
  std::vector<PositionFix<Dim>> expected;
  for (int tag = 0; tag < kTags; ++tag) {
    auto one = random_problem<Dim>(rng, kind, 0.1, beacons);
    if (!has_own_beacons) one.beacons = shared.beacons;
    if (!has_own_sigma) one.sigma = shared.sigma;
    if (tag == 7) one.ranges[2] = -1;  // only this tag is refused
    if (tag % 5 == 0) one.ranges[0] = kNaN;
    if (tag % 5 == 0 && has_own_beacons) one.beacons[0] = kNaN;
    all.beacons.insert(all.beacons.end(), one.beacons.begin(), one.beacons.end());
    all.ranges.insert(all.ranges.end(), one.ranges.begin(), one.ranges.end());
    all.sigma.insert(all.sigma.end(), one.sigma.begin(), one.sigma.end());
    expected.push_back(one.solve());
  }
  const RangeBatch batch{kTags, beacons, has_own_beacons ? all.beacons : shared.beacons, all.ranges,
                         has_own_sigma ? all.sigma : shared.sigma};
  std::vector<std::atomic<int>> calls(kTags);
  std::atomic<int> different{0};
  EXPECT_TRUE(locate_each<Dim>(batch, {}, 3, [&](int tag, const PositionFix<Dim>& fix) {
    ++calls[static_cast<std::size_t>(tag)];
    if (!is_same(fix, expected[static_cast<std::size_t>(tag)])) ++different;
  }));
  EXPECT_EQ(different, 0);
  EXPECT_TRUE(std::all_of(calls.begin(), calls.end(), [](const auto& n) { return n == 1; }));
  EXPECT_EQ(expected[7].status, Status::InvalidInput);
}

TEST(LocateEach, IsLocateOfEachTag) {
  for (const Kind kind : {kScattered, kFlat, kAlmostFlat, kUnrelated}) {
    for (const int beacons : {4, 5, 9}) {
      for (const bool has_own : {false, true}) {
        SCOPED_TRACE(::testing::Message() << kind << " " << beacons << " " << has_own);
        check_each<2>(kind, beacons, has_own, true);
        check_each<3>(kind, beacons, true, has_own);
      }
    }
  }
  check_each<2>(kScattered, 70, false, false);
}

TEST(LocateEach, StopsAndRefuses) {
  Rng rng(6);
  auto problem = random_problem<2>(rng, kScattered, 0.1, 5);
  RangeBatch batch{1, 5, problem.beacons, problem.ranges, problem.sigma};
  std::atomic<int> calls{0};
  const auto count = [&](int, const PositionFix<2>& fix) {
    ++calls;
    EXPECT_EQ(fix.status, Status::InvalidInput);
  };
  EXPECT_FALSE(locate_each<2>(batch, {}, 1, count, [] { return true; }));
  EXPECT_EQ(calls, 0);
  LocateOptions options;
  options.within = -1;
  EXPECT_TRUE(locate_each<2>(batch, options, 1, count));
  EXPECT_EQ(calls, 1);
  batch.tags = 2;
  EXPECT_FALSE(locate_each<2>(batch, {}, 1, count)) << "the sizes do not match";
}

}  // namespace
}  // namespace asterism
