#include "overlap.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <climits>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

namespace asterism::bench {
namespace {

constexpr OverlapRule kRules[] = {OverlapRule::Exact, OverlapRule::VotPython, OverlapRule::Trax,
                                  OverlapRule::TraxLegacy};
using Points = std::vector<cv::Point2d>;

Region rectangle(double x, double y, double w, double h) { return Region::rectangle({x, y, w, h}); }
Region polygon(Points points) { return Region::polygon(std::move(points)); }

Region moved(const Region& region, double x, double y) {
  const cv::Point2d offset(x, y);
  if (region.is_rectangle()) return Region::rectangle(region.box() + offset);
  Points points = region.points();
  for (cv::Point2d& p : points) p += offset;
  return polygon(points);
}

// Random regions in a field of 0 .. 60 px; coordinates are multiples of 1/8, so that nothing below is rounded
// in single precision.
class Random {
 public:
  double eighth(int low, int high) { return std::uniform_int_distribution(low * 8, high * 8)(engine_) / 8.0; }

  Region convex() {
    if (engine_() % 3 == 0) return rectangle(eighth(0, 30), eighth(0, 30), eighth(2, 30), eighth(2, 30));
    const double x = eighth(12, 40), y = eighth(12, 40), a = eighth(3, 12), b = eighth(3, 12);
    const double angle = eighth(0, 6);
    Points points;
    for (int k = 0; k < 4; ++k) {
      const double t = angle + k * std::acos(-1.0) / 2;
      points.emplace_back(std::round(8 * (x + a * std::cos(t))) / 8,
                          std::round(8 * (y + b * std::sin(t))) / 8);
    }
    if (engine_() % 2 == 0) std::reverse(points.begin(), points.end());
    return polygon(points);
  }

  // A star-shaped polygon, in general not convex.
  Region star() {
    const double x = eighth(20, 35), y = eighth(20, 35);
    Points points;
    const int corners = 5 + static_cast<int>(engine_() % 5);
    for (int k = 0; k < corners; ++k) {
      const double t = 2 * std::acos(-1.0) * k / corners, r = eighth(4, 18);
      points.emplace_back(x + r * std::cos(t), y + r * std::sin(t));
    }
    if (engine_() % 2 == 0) std::reverse(points.begin(), points.end());
    return polygon(points);
  }

 private:
  std::mt19937 engine_{1};
};

TEST(OverlapRules, HaveNames) {
  for (const OverlapRule rule : kRules) EXPECT_EQ(parse_overlap_rule(std::string(to_string(rule))), rule);
  EXPECT_THROW(parse_overlap_rule("exakt"), std::invalid_argument);
}

TEST(ExactOverlap, IsThatOfTheAreas) {
  const auto exact = [](const Region& a, const Region& b) { return overlap(a, b, OverlapRule::Exact); };
  EXPECT_DOUBLE_EQ(exact(rectangle(0, 0, 10, 10), rectangle(5, 0, 10, 10)), 1.0 / 3);
  // A diamond of area 50, with the square of 100 around it and with a quarter of that square.
  const Region diamond = polygon({{5, 0}, {10, 5}, {5, 10}, {0, 5}});
  EXPECT_NEAR(exact(diamond, rectangle(0, 0, 10, 10)), 0.5, 1e-15);
  EXPECT_NEAR(exact(diamond, rectangle(0, 0, 5, 5)), 12.5 / (50 + 25 - 12.5), 1e-15);
  // An L of area 75 lacks a corner of the square; a square inside that corner does not overlap it.
  const Region l_shape = polygon({{0, 0}, {10, 0}, {10, 5}, {5, 5}, {5, 10}, {0, 10}});
  EXPECT_NEAR(exact(l_shape, rectangle(0, 0, 10, 10)), 0.75, 1e-15);
  EXPECT_EQ(exact(l_shape, rectangle(5, 5, 5, 5)), 0);
  EXPECT_NEAR(exact(l_shape, rectangle(4, 4, 2, 2)), 3.0 / (75 + 4 - 3), 1e-15);
  EXPECT_NEAR(exact(polygon({{0, 0}, {8, 0}, {0, 6}}), polygon({{0, 0}, {0, 6}, {8, 6}, {8, 0}})), 0.5,
              1e-15);
}

TEST(ExactOverlap, OfRegionsThatOnlyTouchIsNone) {
  const double third = 1.0 / 3;
  const Region left = polygon({{third, 0.1}, {7.7, 3.3}, {5.1, 9.9}});
  const Region right = polygon({{third, 0.1}, {7.7, 3.3}, {9.3, -4.7}});
  EXPECT_EQ(overlap(left, right, OverlapRule::Exact), 0);
}

TEST(ExactOverlap, CountsOnlyTheImage) {
  const Region half_out = rectangle(-10, 0, 20, 10), inside = rectangle(0, 0, 10, 10);
  EXPECT_DOUBLE_EQ(overlap(half_out, inside, OverlapRule::Exact), 0.5);
  EXPECT_DOUBLE_EQ(overlap(half_out, inside, OverlapRule::Exact, cv::Size(40, 30)), 1);
  EXPECT_EQ(overlap(rectangle(-10, 0, 5, 5), rectangle(-10, 0, 5, 5), OverlapRule::Exact, cv::Size(40, 30)),
            0);
}

TEST(VotPythonOverlap, RoundsHalfToEvenAndIncludesThePolygonsBoundary) {
  const auto vot = [](const Region& a, const Region& b) { return overlap(a, b, OverlapRule::VotPython); };
  EXPECT_DOUBLE_EQ(vot(rectangle(0, 0, 10, 10), rectangle(5, 0, 10, 10)), 1.0 / 3);
  EXPECT_DOUBLE_EQ(vot(rectangle(0.5, 0, 10, 10), rectangle(0, 0, 10, 10)), 1);
  EXPECT_DOUBLE_EQ(vot(rectangle(1.5, 0, 10, 10), rectangle(0, 0, 10, 10)), 80.0 / 120);
  // Corners at 0 and 9 span ten pixels.
  EXPECT_DOUBLE_EQ(vot(polygon({{0, 0}, {9, 0}, {9, 9}, {0, 9}}), rectangle(0, 0, 10, 10)), 1);
  // A triangle of 1 + 2 + 3 + 4 pixels.
  EXPECT_DOUBLE_EQ(vot(polygon({{0, 0}, {3, 3}, {0, 3}}), rectangle(0, 0, 4, 4)), 10.0 / 16);
  // Regions without width: equal for the toolkit.
  EXPECT_EQ(vot(rectangle(3, 3, 0, 0), rectangle(3, 3, 1, 1)), 1);
}

TEST(VotPythonOverlap, LimitsRectanglesLeftOfTheImageAsTheToolkitDoes) {
  // The window is -10 .. 9; of the rectangle's columns 0 .. 19 the toolkit keeps those up to 9, its right
  // border.
  EXPECT_DOUBLE_EQ(overlap(rectangle(-10, 0, 20, 10), rectangle(-10, 0, 10, 10), OverlapRule::VotPython), 1);
  // With the image as the bound this does not happen.
  EXPECT_DOUBLE_EQ(
      overlap(rectangle(-10, 0, 20, 10), rectangle(-5, 0, 10, 10), OverlapRule::VotPython, cv::Size(40, 30)),
      0.5);
}

TEST(TraxOverlap, CountsARectanglesLastPixelUnlessLegacy) {
  const Region square = polygon({{0, 0}, {10, 0}, {10, 10}, {0, 10}});  // 11 x 11 pixels, legacy 10 x 10
  EXPECT_FLOAT_EQ(static_cast<float>(overlap(square, rectangle(0, 0, 10, 10), OverlapRule::Trax)),
                  100.0F / 121.0F);
  EXPECT_EQ(overlap(square, rectangle(0, 0, 10, 10), OverlapRule::TraxLegacy), 1);
  EXPECT_FLOAT_EQ(static_cast<float>(overlap(square, rectangle(0, 0, 5, 10), OverlapRule::TraxLegacy)), 0.5F);
  // In legacy mode half pixels are truncated, not rounded: columns 2 .. 9 of 0 .. 9.
  EXPECT_FLOAT_EQ(static_cast<float>(overlap(square, rectangle(2.5, 0, 7.5, 10), OverlapRule::TraxLegacy)),
                  0.8F);
  EXPECT_FLOAT_EQ(static_cast<float>(overlap(square, rectangle(2.5, 0, 8.5, 11), OverlapRule::Trax)),
                  88.0F / 121.0F);  // rounded half away from zero: from 3 on
  EXPECT_EQ(overlap(rectangle(0, 0, 0, 0), rectangle(0, 0, 0, 0), OverlapRule::TraxLegacy), 0);
}

TEST(EveryOverlap, IsSymmetricAndOneForTheSameRegion) {
  Random random;
  for (int k = 0; k < 300; ++k) {
    const Region a = k % 2 ? random.star() : random.convex(), b = random.convex();
    for (const OverlapRule rule : kRules) {
      const double ab = overlap(a, b, rule);
      EXPECT_NEAR(ab, overlap(b, a, rule), 1e-12) << to_string(rule);
      EXPECT_GE(ab, 0);
      EXPECT_LE(ab, 1);
      EXPECT_NEAR(overlap(a, a, rule), 1, 1e-12) << to_string(rule);
    }
  }
}

TEST(EveryOverlap, DoesNotChangeWithAShiftByWholePixels) {
  Random random;
  for (int k = 0; k < 200; ++k) {
    const Region a = random.convex(), b = random.convex();
    for (const OverlapRule rule : kRules)  // by even numbers, as halves round to even
      EXPECT_NEAR(overlap(moved(a, 124, 16), moved(b, 124, 16), rule), overlap(a, b, rule), 1e-12)
          << to_string(rule) << ": " << to_string(a) << " and " << to_string(b);
  }
}

TEST(EveryOverlap, ConvergesToTheExactOneWithTheResolution) {
  Random random;
  const auto scaled = [](const Region& region, double s) {
    if (region.is_rectangle()) {
      const cv::Rect2d& b = region.box();
      return rectangle(b.x * s, b.y * s, b.width * s, b.height * s);
    }
    Points points = region.points();
    for (cv::Point2d& p : points) p *= s;
    return polygon(points);
  };
  for (int k = 0; k < 20; ++k) {
    const Region a = random.star(), b = k % 2 ? random.star() : random.convex();
    const double exact = overlap(a, b, OverlapRule::Exact);
    for (const OverlapRule rule : kRules)
      EXPECT_NEAR(overlap(scaled(a, 40), scaled(b, 40), rule), exact, 0.012) << to_string(rule);
  }
}

// The toolkits' formulas evaluated for each pixel separately: for convex regions at the origin.
struct Oracle {
  OverlapRule rule;

  double rounded(double v) const {
    return rule == OverlapRule::VotPython ? std::nearbyint(v) : rule == OverlapRule::Trax ? std::round(v) : v;
  }

  Points corners(const Region& region) const {
    Points points = region.points();
    if (region.is_rectangle()) {
      const cv::Rect2d& b = region.box();
      const bool vot = rule == OverlapRule::VotPython;
      const double less = rule == OverlapRule::TraxLegacy ? 0 : 1;
      const double x = vot ? rounded(b.x) : b.x, y = vot ? rounded(b.y) : b.y;
      const double right = x + (vot ? rounded(b.width) : b.width) - less;
      const double bottom = y + (vot ? rounded(b.height) : b.height) - less;
      points = {{x, y}, {right, y}, {right, bottom}, {x, bottom}};
    }
    for (cv::Point2d& p : points) p = {rounded(p.x), rounded(p.y)};
    return points;
  }

  bool contains(const Points& c, int x, int y) const {
    int crossings = 0, least = INT_MAX, greatest = INT_MIN;
    for (std::size_t i = 0; i < c.size(); ++i) {
      const cv::Point2d &p = c[(i + 1) % c.size()], &q = c[i];
      if (rule == OverlapRule::TraxLegacy) {
        if ((p.y < y) == (q.y < y)) continue;
        const auto f = [](double v) { return static_cast<float>(v); };
        crossings += static_cast<int>(f(p.x) + (f(y) - f(p.y)) / (f(q.y) - f(p.y)) * (f(q.x) - f(p.x))) <= x;
      } else if (y >= std::min(p.y, q.y) && y <= std::max(p.y, q.y)) {
        const int node = static_cast<int>(p.y == q.y ? p.x : p.x + (y - p.y) / (q.y - p.y) * (q.x - p.x));
        least = std::min({least, node, p.y == q.y ? static_cast<int>(q.x) : node});
        greatest = std::max({greatest, node, p.y == q.y ? static_cast<int>(q.x) : node});
      }
    }
    return rule == OverlapRule::TraxLegacy ? crossings % 2 == 1 : x >= least && x <= greatest;
  }

  double operator()(const Region& a, const Region& b) const {
    const Points p = corners(a), q = corners(b);
    double common = 0, all = 0;
    for (int y = -1; y < 80; ++y) {
      for (int x = -1; x < 80; ++x) {
        const bool in_a = contains(p, x, y), in_b = contains(q, x, y);
        common += in_a && in_b;
        all += in_a || in_b;
      }
    }
    return common / all;
  }
};

TEST(PixelOverlap, IsThatOfEveryPixelByItself) {
  Random random;
  int overlapping = 0;
  for (int k = 0; k < 400; ++k) {
    Region a = random.convex(), b = random.convex();
    const cv::Rect2d both = a.box() | b.box();
    a = moved(a, -std::floor(both.x), -std::floor(both.y));
    b = moved(b, -std::floor(both.x), -std::floor(both.y));
    for (const OverlapRule rule : {OverlapRule::VotPython, OverlapRule::Trax, OverlapRule::TraxLegacy}) {
      const double expected = Oracle{rule}(a, b), got = overlap(a, b, rule);
      overlapping += expected > 0;
      // libtrax's quick test for disjoint boxes ignores a common boundary.
      if (rule != OverlapRule::VotPython && got == 0 && expected < 0.05) continue;
      EXPECT_FLOAT_EQ(static_cast<float>(got), static_cast<float>(expected))
          << to_string(rule) << ": " << to_string(a) << " and " << to_string(b);
    }
  }
  EXPECT_GT(overlapping, 400);
}

TEST(EveryOverlap, SurvivesWildRegions) {
  const double infinity = std::numeric_limits<double>::infinity();
  const Region box = rectangle(10, 10, 20, 20);
  const cv::Size image(64, 48);
  for (const OverlapRule rule : kRules) {
    for (const Region& wild : {rectangle(-1e300, -1e300, 2e300, 2e300), rectangle(1e9, 1e9, 5, 5),
                               rectangle(0, 0, 1e18, 0), polygon({{-1e12, 3}, {1e12, 4}, {0, 1e12}}),
                               rectangle(5, 5, -10, -10), polygon({{3, 3}, {3, 3}, {3, 3}})}) {
      const double value = overlap(wild, box, rule, image);
      EXPECT_TRUE(value >= 0 && value <= 1) << to_string(rule) << " " << to_string(wild);
    }
    EXPECT_EQ(overlap(rectangle(infinity, 0, 1, 1), box, rule), 0);
    EXPECT_EQ(overlap(rectangle(0, 0, std::nan(""), 1), box, rule), 0);
  }
  EXPECT_LT(overlap(rectangle(-1e7, 20, 2e7, 2), box, OverlapRule::Trax), 1e-4);
}

// Extreme results of a lost tracker: the time to compare them must not grow with their extent.
struct WildPair {
  const char* name;
  Region wild, box;
  double exact, bounded;  // overlap of the areas, and within an image of 640 x 480
};

std::vector<WildPair> wild_pairs() {
  const Region box = rectangle(100, 100, 50, 40);
  const double image = 50.0 * 40 / (640 * 480);
  Points fan, comb, zigzag;
  for (int k = 0; k < 10000; ++k)
    zigzag.emplace_back(k % 2 ? 1e9 : -1e9, 200.0 * (k * 7919 % 10000) - 1e6);  // each in a row of its own
  for (int k = 0; k < 1000; ++k) {
    fan.emplace_back(3 * k, k % 2 ? 1e6 : -1e6);
    comb.emplace_back(k % 2 ? 1e6 : -1e6, 0.5 * k);
  }
  return {{"million", rectangle(0, 0, 1e6, 1e6), box, 2e-9, image},
          {"from_afar", rectangle(-5e5, -5e5, 1e6, 1e6), box, 2e-9, image},
          {"both_ends", rectangle(-9e5, -9e5, 1.8e6, 1.8e6), box, 2000 / 3.24e12, image},
          {"beyond_the_limit", rectangle(-1e12, -1e12, 2e12, 2e12), box, 2e-21, image},
          {"off", rectangle(900000, 900000, 10, 10), box, 0, 0},
          {"far_to_the_left", rectangle(-9e5, 100, 10, 40), box, 0, 0},
          {"slopes", polygon({{-1e6, -1e6}, {1e6, -1e6}, {0, 1e6}}), box, 1e-9, image},
          {"two_of_them", polygon({{-1e6, -1e6}, {1e6, -1e6}, {0, 1e6}}),
           polygon({{-1e6, 1e6}, {1e6, 1e6}, {0, -1e6}}), 1.0 / 3, 1},
          {"zigzag", polygon(fan), box, -1, -1},
          {"comb", polygon(comb), box, -1, -1},
          {"zigzag_of_all_rows", polygon(zigzag), box, -1, -1}};
}

class WildOverlap : public testing::TestWithParam<WildPair> {};

TEST_P(WildOverlap, IsThatOfTheAreasAndCostsWhatAnImageCosts) {
  const auto& [name, wild, box, exact, bounded] = GetParam();
  const auto begin = std::chrono::steady_clock::now();
  for (const OverlapRule rule : kRules) {
    for (const bool swapped : {false, true}) {
      const double free = swapped ? overlap(box, wild, rule) : overlap(wild, box, rule);
      const double within = swapped ? overlap(box, wild, rule, cv::Size(640, 480))
                                    : overlap(wild, box, rule, cv::Size(640, 480));
      EXPECT_TRUE(free >= 0 && free <= 1 && within >= 0 && within <= 1) << to_string(rule);
      if (exact < 0) continue;
      // Tolerances for boundary pixels and for coordinates that the pixel rules clamp.
      EXPECT_NEAR(free, exact, 1e-8 + 1e-4 * exact) << to_string(rule);
      EXPECT_NEAR(within, bounded, 0.01 * bounded) << to_string(rule);
    }
  }
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
  EXPECT_LT(seconds.count(), 10) << "16 overlaps of at most some 50 ms, on a busy machine";
}

INSTANTIATE_TEST_SUITE_P(Regions, WildOverlap, testing::ValuesIn(wild_pairs()),
                         [](const auto& instance) { return std::string(instance.param.name); });

}  // namespace
}  // namespace asterism::bench
