// Which maxima of the parts' responses are chosen together.
#include <gtest/gtest.h>

#include <asterism/trackers/constellation/mode_search.hpp>
#include <asterism/trackers/dpt/dpt.hpp>
#include <cmath>
#include <vector>

#include "moving_square.hpp"

namespace asterism {
namespace {

constexpr double kCell = 3;  // [px]
constexpr int kSide = 21, kMiddle = kSide / 2;

// A part whose response is given, on a grid around the position of the search.
struct GivenPart {
  ResponseMap map;
  void init(const Frame&, const Point2&, const Size2&) {}
  Evidence localize(const Frame&, const Point2& around) {
    map.origin = around - Point2::Constant(kCell * kMiddle);
    map.spacing = Size2::Constant(kCell);
    return evidence_of(map);
  }
  double similarity_at(const Point2& position) const { return map.at(position); }
  void adapt(const Frame&, const Point2&) {}
  const ResponseMap& response() const { return map; }
};

// The same without its map.
struct SparsePart {
  GivenPart part;
  void init(const Frame&, const Point2&, const Size2&) {}
  Evidence localize(const Frame& frame, const Point2& around) { return part.localize(frame, around); }
  double similarity_at(const Point2& position) const { return part.similarity_at(position); }
  void adapt(const Frame&, const Point2&) {}
};

// Peaks of some height, 1.5 cells wide, at (x, y) cells from the middle.
struct Peak {
  double x, y, height;
};
GivenPart part_with(const std::vector<Peak>& peaks) {
  GivenPart part;
  part.map.values.setZero(kSide, kSide);
  part.map.periodic = false;
  for (const Peak& peak : peaks) {
    for (int row = 0; row < kSide; ++row) {
      for (int col = 0; col < kSide; ++col) {
        const double square = std::pow(col - kMiddle - peak.x, 2) + std::pow(row - kMiddle - peak.y, 2);
        part.map.values(row, col) += static_cast<float>(peak.height * std::exp(-square / (2 * 1.5 * 1.5)));
      }
    }
  }
  return part;
}

struct Choice {
  std::vector<Evidence> before, after;
};
Choice choose(std::vector<AnyPart> parts, double stiffness) {
  const auto count = static_cast<Eigen::Index>(parts.size());
  DptSystem::Points x(2, count);
  Choice choice;
  const cv::Mat image = draw_frame(0);
  const Frame frame(image);
  for (Eigen::Index i = 0; i < count; ++i) {
    x.col(i) = Point2(40.25 + 31.5 * static_cast<double>(i), 50.75);
    choice.before.push_back(parts[static_cast<std::size_t>(i)].localize(frame, x.col(i)));
  }
  choice.after = choice.before;
  ModeSearch search;
  const std::vector<double> stiffnesses(parts.size(), stiffness);
  search.choose(parts, x, stiffnesses, choice.after);
  return choice;
}

void expect_same(const Evidence& a, const Evidence& b) {
  EXPECT_EQ(a.position, b.position);
  EXPECT_EQ(a.peak, b.peak);
  EXPECT_EQ(a.covariance, b.covariance);
}

// Parts 1 and 2 are at rest. Part 0 has a higher maximum 6 cells away, and a lower one where it fits. Springs
// of s / 3 between three parts cost s / 3 x 18^2 px^2 at the higher one, of which half counts for two
// springs.
TEST(ModeSearch, WeighsTheResponseAgainstTheSpringsOfAllPairs) {
  const double low = 0.6, high = 0.9, gain = (high - low) / 2, away = 6 * kCell;
  const double threshold = 3 * gain / (away * away);
  const auto parts = [&]() -> std::vector<AnyPart> {
    return {part_with({{0, 0, low}, {6, 0, high}}), part_with({{0, 0, 0.8}}), part_with({{0, 0, 0.8}})};
  };
  const Choice soft = choose(parts(), 0.95 * threshold);
  for (std::size_t i = 0; i < 3; ++i) expect_same(soft.after[i], soft.before[i]);
  const Choice stiff = choose(parts(), 1.05 * threshold);
  for (std::size_t i = 1; i < 3; ++i) expect_same(stiff.after[i], stiff.before[i]);
  const Evidence &chosen = stiff.after[0], &highest = stiff.before[0];
  EXPECT_NEAR(highest.position.x(), 40.25 + away, 0.2);
  EXPECT_NEAR(chosen.position.x(), 40.25, 0.2);
  EXPECT_NEAR(chosen.position.y(), 50.75, 1e-6);
  EXPECT_NEAR(chosen.peak, low, 1e-3);
  // The higher maximum is far away from it, and counts more.
  EXPECT_GT(chosen.covariance(0, 0), highest.covariance(0, 0));
}

TEST(ModeSearch, FindsTheMaximumBelowTheCell) {
  const Choice choice = choose(
      {part_with({{0.3, -0.2, 0.6}, {-7, 5, 0.9}}), part_with({{0, 0, 0.8}}), part_with({{0, 0, 0.8}})}, 0.1);
  EXPECT_NEAR(choice.after[0].position.x(), 40.25 + 0.3 * kCell, 0.15 * kCell);
  EXPECT_NEAR(choice.after[0].position.y(), 50.75 - 0.2 * kCell, 0.15 * kCell);
}

// All parts move together at no cost, also where each has a distractor of its own.
TEST(ModeSearch, FollowsAMotionOfAllParts) {
  const Choice choice =
      choose({part_with({{4, 3, 0.6}, {-7, 5, 0.7}}), part_with({{4, 3, 0.6}, {8, -8, 0.7}}),
              part_with({{4, 3, 0.6}, {-4, -8, 0.7}}), part_with({{4, 3, 0.6}, {0, 8, 0.7}})},
             0.05);
  for (int i = 0; i < 4; ++i) {
    EXPECT_NEAR(choice.after[static_cast<std::size_t>(i)].position.x(), 40.25 + 31.5 * i + 4 * kCell, 0.5);
    EXPECT_NEAR(choice.after[static_cast<std::size_t>(i)].position.y(), 50.75 + 3 * kCell, 0.5);
  }
}

TEST(ModeSearch, LeavesThePeakOfAPartWithoutAMap) {
  const GivenPart doubtful = part_with({{0, 0, 0.6}, {6, 0, 0.9}});
  Choice choice =
      choose({SparsePart{doubtful}, doubtful, part_with({{0, 0, 0.8}}), part_with({{0, 0, 0.8}})}, 1);
  expect_same(choice.after[0], choice.before[0]);
  EXPECT_NEAR(choice.after[1].peak, 0.6, 1e-3);
  choice = choose({SparsePart{doubtful}, SparsePart{part_with({{0, 0, 0.8}})}}, 1);
  for (std::size_t i = 0; i < 2; ++i) expect_same(choice.after[i], choice.before[i]);
}

// No response where the part has to be: it stays there, without a pull.
TEST(ModeSearch, HasNoPullWithoutAResponse) {
  GivenPart blind = part_with({{9, 9, 0.9}});
  blind.map.values.topLeftCorner(15, 15).setZero();
  const Choice choice = choose({blind, part_with({{-3, -3, 0.8}}), part_with({{-3, -3, 0.8}})}, 10);
  EXPECT_EQ(choice.after[0].peak, 0);
  EXPECT_NEAR(choice.after[0].position.x(), 40.25 - 3 * kCell, 1e-9);
  EXPECT_TRUE(choice.after[0].covariance.allFinite());
}

TEST(ModeSearch, DptTracksWithIt) {
  DptOptions options;
  options.anchor_search = AnchorSearch::Dense;
  Dpt tracker(options), copy(options);
  tracker.init(draw_frame(0), true_box(0));
  for (int t = 1; t <= 15; ++t) {
    if (t == 8) copy = tracker;
    const TrackResult result = tracker.update(draw_frame(t));
    EXPECT_NEAR(result.box.x, true_box(t).x, 2) << t;
    EXPECT_NEAR(result.box.y, true_box(t).y, 2) << t;
    if (t < 8) continue;
    const TrackResult same = copy.update(draw_frame(t));
    EXPECT_EQ(same.box, result.box);
  }
}

}  // namespace
}  // namespace asterism
