// The distance transform against all pairs of places.
#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/solver/discrete/distance_transform.hpp>
#include <asterism/testing/random_system.hpp>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

namespace asterism {
namespace {

constexpr float kForbidden = std::numeric_limits<float>::infinity();

struct Map {
  int width, height;
  std::vector<float> numbers;

  Map(int w, int h) : width(w), height(h), numbers(static_cast<std::size_t>(w * h)) {}
  float& operator()(int x, int y) { return numbers[static_cast<std::size_t>(y * width + x)]; }
  float operator()(int x, int y) const { return numbers[static_cast<std::size_t>(y * width + x)]; }
  MapView<float> view() { return {numbers.data(), width, height}; }
  MapView<const float> view() const { return {numbers.data(), width, height}; }
};

Map random_map(testing::Rng& rng, int width, int height, double forbidden = 0) {
  Map map(width, height);
  const int kind = static_cast<int>(rng.uniform(0, 3));
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double noise = rng.uniform(-1, 1);
      map(x, y) = static_cast<float>(kind == 0   ? noise
                                     : kind == 1 ? 0.3 * x - 0.2 * y + 0.1 * noise
                                                 : std::round(2 * noise));
      if (rng.uniform(0, 1) < forbidden) map(x, y) = kForbidden;
    }
  }
  return map;
}

// The least cost along one axis after the other, as costs are sums.
Map brute_force(const Map& f, const DisplacementCost& cost, int width, int height) {
  std::vector<double> columns(static_cast<std::size_t>(f.width * height), kForbidden);
  Map result(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < f.width; ++x) {
      double& least = columns[static_cast<std::size_t>(y * f.width + x)];
      for (int p = 0; p < f.height; ++p) least = std::min(least, double{f(x, p)} + cost.y(p - y));
    }
    for (int x = 0; x < width; ++x) {
      double least = kForbidden;
      for (int p = 0; p < f.width; ++p) {
        least = std::min(least, columns[static_cast<std::size_t>(y * f.width + p)] + cost.x(p - x));
      }
      result(x, y) = static_cast<float>(least);
    }
  }
  return result;
}

void expect_equal(const Map& measured, const Map& wanted, const std::string& what) {
  for (int y = 0; y < wanted.height; ++y) {
    for (int x = 0; x < wanted.width; ++x) {
      if (std::isinf(wanted(x, y))) {
        EXPECT_EQ(measured(x, y), wanted(x, y)) << what << " at " << x << ", " << y;
      } else {
        ASSERT_NEAR(measured(x, y), wanted(x, y), 1e-5 * (10 + std::abs(wanted(x, y))))
            << what << " at " << x << ", " << y;
      }
    }
  }
}

AxisCost random_cost(testing::Rng& rng) {
  AxisCost cost;
  cost.weight = std::pow(10, rng.uniform(-4, 1));
  const double kind = rng.uniform(0, 1);
  cost.offset = rng.uniform(-5, 5);
  if (kind < 0.3) cost.offset = std::round(cost.offset);
  if (kind > 0.9) cost.offset *= 20;
  if (rng.uniform(0, 1) < 0.3) cost.shape = CostShape::Absolute;
  if (rng.uniform(0, 1) < 0.2) cost.truncation = rng.uniform(0, 3);
  if (rng.uniform(0, 1) < 0.05) cost.weight = 0;
  return cost;
}

std::string describe(const AxisCost& cost) {
  return (cost.shape == CostShape::Quadratic ? "quadratic, weight " : "absolute, weight ") +
         std::to_string(cost.weight) + ", offset " + std::to_string(cost.offset) + ", truncation " +
         std::to_string(cost.truncation);
}

TEST(DistanceTransform, IsTheLeastOverAllPlaces) {
  testing::Rng rng(1);
  DistanceTransform transform;  // one for all sizes
  for (int trial = 0; trial < 3000; ++trial) {
    const auto size = [&] { return static_cast<int>(std::exp(rng.uniform(0, 4.4))); };
    const int width = size(), height = size(), result_width = size(), result_height = size();
    const double forbidden = rng.uniform(0, 1) < 0.3 ? rng.uniform(0, 1) : 0;
    const Map f = random_map(rng, width, height, forbidden);
    DisplacementCost cost;
    cost.x = random_cost(rng);
    cost.y = random_cost(rng);
    Map result(result_width, result_height);
    const Message message = transform.run(f.view(), cost, result.view());
    ASSERT_TRUE(message.empty()) << message;
    const std::string what = std::to_string(width) + " x " + std::to_string(height) + " to " +
                             std::to_string(result_width) + " x " + std::to_string(result_height) + ", x " +
                             describe(cost.x) + ", y " + describe(cost.y);
    expect_equal(result, brute_force(f, cost, result_width, result_height), what);
    if (HasFailure()) return;
    for (int k = 0; k < 5; ++k) {
      const int x = static_cast<int>(rng.uniform(0, result_width));
      const int y = static_cast<int>(rng.uniform(0, result_height));
      const Eigen::Vector2i p = transform.best_place(f.view(), cost, x, y);
      if (std::isinf(result(x, y))) {
        EXPECT_EQ(p, Eigen::Vector2i(-1, -1)) << what;
        continue;
      }
      ASSERT_TRUE(p.x() >= 0 && p.x() < width && p.y() >= 0 && p.y() < height) << what;
      EXPECT_NEAR(f(p.x(), p.y()) + cost(p.x() - x, p.y() - y), result(x, y),
                  1e-5 * (10 + std::abs(result(x, y))))
          << what;
    }
  }
}

// The least over all pairs of places, for costs of which nothing is known.
TEST(DistanceTransform, OfALengthIsTheLeastOverTheWindow) {
  testing::Rng rng(11);
  DistanceTransform transform;
  for (int trial = 0; trial < 300; ++trial) {
    const auto size = [&] { return static_cast<int>(std::exp(rng.uniform(0, 3.6))); };
    const int width = size(), height = size(), result_width = size(), result_height = size();
    const Map f = random_map(rng, width, height, trial % 3 == 0 ? 0.5 : 0);
    DisplacementCost cost =
        DisplacementCost::spring(std::pow(10, rng.uniform(-2, 1)), rng.uniform(0, 9), rng.uniform(-12, 12),
                                 rng.uniform(-12, 12), static_cast<int>(rng.uniform(0, 12)));
    if (trial % 2 == 0) cost.y.weight = rng.uniform(0, 1);
    if (trial % 4 < 2) cost.length.weight = 0;  // the window alone
    Map result(result_width, result_height);
    // Axes alone in between: the workspace is for both.
    ASSERT_TRUE(transform.run(f.view(), {}, result.view()).empty());
    const Message message = transform.run(f.view(), cost, result.view());
    ASSERT_TRUE(message.empty()) << message;
    for (int y = 0; y < result_height; ++y) {
      for (int x = 0; x < result_width; ++x) {
        double least = kForbidden;
        for (int v = 0; v < height; ++v) {
          for (int u = 0; u < width; ++u) {
            const int dx = u - x, dy = v - y;
            if (std::abs(dx - std::lround(cost.x.offset)) > cost.length.reach) continue;
            if (std::abs(dy - std::lround(cost.y.offset)) > cost.length.reach) continue;
            const double excess = std::hypot(dx, dy) - cost.length.length;
            const double along_y = cost.y.weight * std::pow(dy - cost.y.offset, 2);
            least = std::min(least, double{f(u, v)} + along_y + cost.length.weight * excess * excess);
          }
        }
        const Eigen::Vector2i p = transform.best_place(f.view(), cost, x, y);
        if (std::isinf(least)) {
          ASSERT_EQ(result(x, y), kForbidden);
          EXPECT_EQ(p, Eigen::Vector2i(-1, -1));
        } else {
          ASSERT_NEAR(result(x, y), least, 1e-5 * (10 + std::abs(least)));
          EXPECT_NEAR(f(p.x(), p.y()) + cost(p.x() - x, p.y() - y), least, 1e-5 * (10 + std::abs(least)));
        }
      }
    }
  }
}

TEST(DistanceTransform, ReadsAndWritesMapsWithStrides) {
  testing::Rng rng(2);
  const Map f = random_map(rng, 21, 34);
  DistanceTransform transform;
  for (const DisplacementCost& cost :
       {DisplacementCost{AxisCost::quadratic(0.05, 1.5), AxisCost::absolute(0.1, -2), {}},
        DisplacementCost::spring(0.5, 4, 2, -3, 5)}) {
    Map wanted(30, 19);
    ASSERT_TRUE(transform.run(f.view(), cost, wanted.view()).empty());

    // Columns one after the other, three numbers apart.
    std::vector<float> numbers(static_cast<std::size_t>(3 * 21 * 34 + 100), -100.0F);
    const MapView<float> strided(numbers.data() + 7, 21, 34, 3, 3 * 34 + 2);
    for (int y = 0; y < 34; ++y) {
      for (int x = 0; x < 21; ++x) strided(x, y) = f(x, y);
    }
    std::vector<float> results(static_cast<std::size_t>(2 * 30 * 19 + 19 * 5), -7.0F);
    const MapView<float> result(results.data(), 30, 19, 2 * 30 + 5, 2);
    ASSERT_TRUE(transform.run(strided, cost, result).empty());
    for (int y = 0; y < 19; ++y) {
      for (int x = 0; x < 30; ++x) {
        EXPECT_EQ(result(x, y), wanted(x, y));
        result(x, y) = -7;
      }
    }
    EXPECT_EQ(std::count(results.begin(), results.end(), -7.0F), static_cast<std::ptrdiff_t>(results.size()))
        << "a number between those of the map was written";
  }
}

TEST(DistanceTransform, MovesWithTheMapAndWithTheOffset) {
  testing::Rng rng(3);
  const Map f = random_map(rng, 40, 40);
  DistanceTransform transform;
  Map at_zero(60, 60), moved(60, 60);
  const auto cost = [](double dx, double dy) {
    return DisplacementCost{AxisCost::quadratic(0.03, 0.25 + dx), AxisCost::quadratic(0.3, dy)};
  };
  ASSERT_TRUE(transform.run(f.view(), cost(0, 0), at_zero.view()).empty());
  ASSERT_TRUE(transform.run(f.view(), cost(-7, 4), moved.view()).empty());
  for (int y = 0; y < 50; ++y) {
    for (int x = 10; x < 60; ++x) EXPECT_NEAR(moved(x, y), at_zero(x - 7, y + 4), 1e-5);
  }
}

TEST(DistanceTransform, OfALongLineIsTheEnvelopeOfParabolas) {
  // One allowed place far away: more steps than the chain has.
  Map f(1000, 1);
  std::fill(f.numbers.begin(), f.numbers.end(), kForbidden);
  f(900, 0) = 2;
  Map result(1000, 1);
  const DisplacementCost cost{AxisCost::quadratic(1e-3, 0), AxisCost::quadratic(1, 0)};
  DistanceTransform transform;
  ASSERT_TRUE(transform.run(f.view(), cost, result.view()).empty());
  for (int x = 0; x < 1000; ++x) EXPECT_NEAR(result(x, 0), 2 + 1e-3 * (900 - x) * (900 - x), 1e-4);
  EXPECT_EQ(transform.best_place(f.view(), cost, 3, 0), Eigen::Vector2i(900, 0));
}

TEST(DistanceTransform, RefusesBadInputByName) {
  testing::Rng rng(4);
  Map f = random_map(rng, 8, 8);
  Map result(8, 8);
  DistanceTransform transform;
  const auto run = [&](const DisplacementCost& cost) { return transform.run(f.view(), cost, result.view()); };
  const float infinity = kForbidden, nan = std::numeric_limits<float>::quiet_NaN();
  std::fill(result.numbers.begin(), result.numbers.end(), -5.0F);

  EXPECT_EQ(transform.run(MapView<const float>(), {}, result.view()), "map is empty");
  EXPECT_EQ(transform.run(f.view(), {}, MapView<float>()), "result is empty");
  DisplacementCost cost;
  cost.x.weight = -1;
  EXPECT_EQ(run(cost), "cost has a weight that is negative or not finite");
  cost.x.weight = nan;
  EXPECT_EQ(run(cost), "cost has a weight that is negative or not finite");
  cost = {};
  cost.y.offset = infinity;
  EXPECT_EQ(run(cost), "cost has an offset that is not finite or beyond 2^20 px");
  cost = {};
  cost.y.truncation = nan;
  EXPECT_EQ(run(cost), "cost has a truncation that is negative or NaN");
  EXPECT_EQ(run(DisplacementCost::spring(-1, 3, 0, 0, 4)),
            "cost has a weight of its length that is negative or not finite");
  EXPECT_EQ(run(DisplacementCost::spring(1, -3, 0, 0, 4)),
            "cost has a length that is negative, not finite or beyond 2^20 px");
  for (const int reach : {-2, -1, 256}) {
    EXPECT_EQ(run(DisplacementCost::spring(1, 3, 0, 0, reach)), "cost has a reach below 0 or above 255 px");
  }
  EXPECT_EQ(run(DisplacementCost::spring(0, 3, 0, 0, -2)), "cost has a reach below 0 or above 255 px");
  for (const float bad : {nan, -nan, -infinity}) {
    f(5, 6) = bad;
    EXPECT_EQ(run({}), "map has a number that is NaN or minus infinity");
  }
  EXPECT_EQ(std::count(result.numbers.begin(), result.numbers.end(), -5.0F), 64);
  f(5, 6) = infinity;
  EXPECT_EQ(run({}), "");
}

}  // namespace
}  // namespace asterism
