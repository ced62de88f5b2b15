// Pictorial structures: parts in a star, with maps as detectors make them.
#include <algorithm>
#include <asterism/solver/discrete/loopy_structure.hpp>
#include <asterism/solver/discrete/m_best_placements.hpp>
#include <asterism/solver/discrete/pictorial_structure.hpp>
#include <asterism/solver/discrete/scaled_structure.hpp>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <vector>

#include "bars.hpp"
#include "straightforward_structure.hpp"

#ifdef ASTERISM_BENCH_VLFEAT
extern "C" {
#include <vl/imopv.h>
}
#endif

namespace asterism::bench {

namespace {

struct Star {
  std::vector<std::vector<float>> numbers;
  std::vector<MapView<const float>> maps;
  std::vector<Joint> joints;
};

// Costs of a detector: smooth noise with a deviation of 0.14, and six peaks of 0.4 to 1, 3 px wide.
std::vector<float> response(testing::Rng& rng, int size) {
  const auto at = [size](int x, int y) { return static_cast<std::size_t>(y * size + x); };
  std::vector<float> noise(at(0, size)), rows(at(0, size)), map(at(0, size));
  for (float& number : noise) number = static_cast<float>(rng.uniform(-0.5, 0.5));
  const auto smooth = [&](const std::vector<float>& from, std::vector<float>& to, int dx, int dy) {
    for (int y = 0; y < size; ++y) {
      for (int x = 0; x < size; ++x) {
        float sum = 0;
        for (int k = -2; k <= 2; ++k) sum += from[at((x + k * dx + size) % size, (y + k * dy + size) % size)];
        to[at(x, y)] = sum;
      }
    }
  };
  smooth(noise, rows, 1, 0);
  smooth(rows, map, 0, 1);
  for (float& number : map) number = 1 + 0.1F * number;
  for (int peak = 0; peak < 6; ++peak) {
    const double px = rng.uniform(0, size), py = rng.uniform(0, size), height = rng.uniform(0.4, 1);
    for (int y = 0; y < size; ++y) {
      for (int x = 0; x < size; ++x) {
        const double square = (x - px) * (x - px) + (y - py) * (y - py);
        if (square < 200) map[at(x, y)] -= static_cast<float>(height * std::exp(-square / 18));
      }
    }
  }
  return map;
}

Star random_star(testing::Rng& rng, int parts, int size, double weight) {
  Star star;
  for (int i = 0; i < parts; ++i) {
    star.numbers.push_back(response(rng, size));
    star.maps.emplace_back(star.numbers.back().data(), size, size);
    if (i == 0) continue;
    const auto cost = [&] { return AxisCost::quadratic(weight, rng.uniform(-0.16, 0.16) * size); };
    Joint joint{0, i, {}};
    joint.cost.x = cost();
    joint.cost.y = cost();
    star.joints.push_back(joint);
  }
  return star;
}

// Every pair of parts linked: the star's ideal place for each part, and so the pairs' offsets, with a
// deviation of 1 px.
void link_all(Star& star, testing::Rng& rng, double weight) {
  const std::vector<Joint> given = star.joints;
  for (std::size_t i = 0; i < given.size(); ++i) {
    for (std::size_t j = i + 1; j < given.size(); ++j) {
      const double dx = rng.normal(), dy = rng.normal();
      Joint joint{given[i].child, given[j].child, {}};
      joint.cost.x = AxisCost::quadratic(weight, given[j].cost.x.offset - given[i].cost.x.offset + dx);
      joint.cost.y = AxisCost::quadratic(weight, given[j].cost.y.offset - given[i].cost.y.offset + dy);
      star.joints.push_back(joint);
    }
  }
}

// CPU seconds of work().
template <typename Work>
double cpu_seconds_of(Work&& work) {
  const double before = cpu_seconds();
  work();
  return cpu_seconds() - before;
}

void loops(Bars& bars, int stars) {
  LoopyStructure structure;
  PartPlacement best;
  for (const double weight : {0.1, 0.02, 0.004}) {
    testing::Rng rng(11);
    std::vector<double> seconds, gaps, iterations;
    int closed = 0;
    for (int s = 0; s < stars; ++s) {
      Star star = random_star(rng, 4, 128, weight);
      link_all(star, rng, weight);
      LoopySummary summary;
      seconds.push_back(cpu_seconds_of([&] { summary = structure.solve(star.joints, star.maps, best); }));
      gaps.push_back(summary.energy - summary.lower_bound);
      iterations.push_back(summary.iterations);
      closed += summary.status == Status::Converged;
    }
    bars.line(format("4 parts, all pairs, 128 x 128, weight %g", weight),
              format("%.1f ms, iterations: %.0f; gap closed: %d of %d", 1e3 * median(seconds),
                     median(iterations), closed, stars),
              "-", "-", true, true);
    bars.line("  gap, worst", format("%.2g", *std::max_element(gaps.begin(), gaps.end())), "-", "-", true,
              true);
  }
}

// As many steps to the neighbours as take the time of one lower envelope, for 16 lines.
double steps_of_an_envelope(int lines) {
  constexpr int kSize = 128, kSteps = detail::LineTransform::kMostSteps;
  testing::Rng rng(23);
  std::vector<double> ratios;
  for (int l = 0; l < lines; ++l) {
    const std::vector<float> map = response(rng, kSize);
    const auto seconds = [&map](const AxisCost& cost) {
      detail::LineTransform transform;
      transform.plan(cost, kSize, kSize);
      for (int p = 0; p < kSize; ++p) {
        std::copy_n(map.data() + p * kSize, detail::kLineBlock, transform.source() + p * detail::kLineBlock);
      }
      double least = std::numeric_limits<double>::infinity();
      for (int repeat = 0; repeat < 9; ++repeat) {
        least = std::min(least, cpu_seconds_of([&] {
                           for (int k = 0; k < 20; ++k) transform.run();
                         }));
      }
      return least;
    };
    // Parts that are drawn far away take all steps; with a truncation they are enough.
    constexpr double kWeight = 1e-5;
    AxisCost cost = AxisCost::quadratic(kWeight, 0.3);
    const double both = seconds(cost);
    cost.truncation = kWeight * (kSteps - 1) * (kSteps - 1);
    const double steps = seconds(cost);
    ratios.push_back(kSteps * (both - steps) / steps);
  }
  return median(ratios);
}

// Medians of one solve each [s].
double seconds_of_m_best(int stars, double distance) {
  testing::Rng rng(13);
  MBestPlacements search;
  std::vector<PartPlacement> placements;
  std::vector<double> seconds;
  for (int s = 0; s < stars; ++s) {
    const Star star = random_star(rng, 4, 128, 0.02);
    seconds.push_back(
        cpu_seconds_of([&] { search.solve(star.joints, star.maps, 10, distance, placements); }));
  }
  return median(seconds);
}
double seconds_of_layers(int stars, int layers) {
  testing::Rng rng(17);
  ScaledStructure structure;
  ScaledPlacement best;
  std::vector<double> seconds, scales;
  for (int l = 0; l < layers; ++l) scales.push_back(std::pow(1.2, l));
  for (int s = 0; s < stars; ++s) {
    const Star star = random_star(rng, 4, 128, 0.02);
    std::vector<std::vector<float>> numbers;
    std::vector<MapView<const float>> maps;
    for (int k = 0; k < 4 * layers; ++k) numbers.push_back(response(rng, 128));
    for (const auto& map : numbers) maps.emplace_back(map.data(), 128, 128);
    std::vector<ScaledJoint> joints;
    for (const Joint& joint : star.joints) joints.push_back({joint, AxisCost::quadratic(0.1, 0)});
    structure.solve(joints, scales, maps, best);
    seconds.push_back(cpu_seconds_of([&] { structure.solve(joints, scales, maps, best); }));
  }
  return median(seconds);
}
double seconds_of_lengths(int stars, int reach) {
  testing::Rng rng(19);
  PictorialStructure structure;
  PartPlacement best;
  std::vector<double> seconds;
  for (int s = 0; s < stars; ++s) {
    Star star = random_star(rng, 4, 128, 0.02);
    structure.solve(star.joints, star.maps, best);
    for (Joint& joint : star.joints) {
      const Eigen::Vector2i d = best.positions.col(joint.child) - best.positions.col(joint.parent);
      const double length = std::hypot(joint.cost.x.offset, joint.cost.y.offset);
      joint.cost = DisplacementCost::spring(0.02, length, d.x(), d.y(), reach);
    }
    structure.solve(star.joints, star.maps, best);
    seconds.push_back(cpu_seconds_of([&] { structure.solve(star.joints, star.maps, best); }));
  }
  return median(seconds);
}

struct Times {
  double ours = 0, straightforward = 0;  // medians [s]
  double gap = 0;                        // the greatest difference of two energies
};

// The median over stars of the least time of some solves each.
Times times_of(int stars, int parts, int size, double weight, bool compare = true) {
  testing::Rng rng(7);
  PictorialStructure structure;
  StraightforwardStar straightforward;
  PartPlacement best, other;
  std::vector<double> ours, theirs;
  Times times;
  const auto least = [&](auto&& solve) {
    double seconds = std::numeric_limits<double>::infinity();
    for (int repeat = 0; repeat < 7; ++repeat) seconds = std::min(seconds, cpu_seconds_of(solve));
    return seconds;
  };
  for (int s = 0; s < stars; ++s) {
    const Star star = random_star(rng, parts, size, weight);
    ours.push_back(least([&] { structure.solve(star.joints, star.maps, best); }));
    if (!compare) continue;
    theirs.push_back(least([&] { straightforward.solve(star.joints, star.maps, other); }));
    times.gap = std::max(times.gap, std::abs(best.energy - other.energy));
  }
  times.ours = median(ours);
  if (compare) times.straightforward = median(theirs);
  return times;
}

#ifdef ASTERISM_BENCH_VLFEAT
// Both passes of one transform, with the places, which VLFeat needs to be numbered before.
void against_vlfeat(Bars& bars, int stars) {
  constexpr int kSize = 128;
  constexpr auto kPixels = static_cast<std::size_t>(kSize * kSize);
  testing::Rng rng(7);
  std::vector<float> between(kPixels), result(kPixels), of_vlfeat(kPixels);
  std::vector<vl_uindex> places(kPixels);
  DistanceTransform transform;
  std::vector<double> ours, theirs;
  double gap = 0;
  for (int s = 0; s < stars; ++s) {
    const std::vector<float> f = response(rng, kSize);
    const double x = rng.uniform(-0.5, 0.5), y = rng.uniform(-0.5, 0.5);
    const DisplacementCost cost{AxisCost::quadratic(0.02, x), AxisCost::quadratic(0.02, y)};
    double of_ours = std::numeric_limits<double>::infinity(), of_theirs = of_ours;
    for (int repeat = 0; repeat < 7; ++repeat) {
      double before = cpu_seconds();
      transform.run({f.data(), kSize, kSize}, cost, {result.data(), kSize, kSize});
      of_ours = std::min(of_ours, cpu_seconds() - before);
      before = cpu_seconds();
      for (std::size_t i = 0; i < kPixels; ++i) places[i] = i;
      vl_image_distance_transform_f(f.data(), kSize, kSize, 1, kSize, between.data(), places.data(), 0.02F,
                                    static_cast<float>(-x));
      vl_image_distance_transform_f(between.data(), kSize, kSize, kSize, 1, of_vlfeat.data(), places.data(),
                                    0.02F, static_cast<float>(-y));
      of_theirs = std::min(of_theirs, cpu_seconds() - before);
    }
    ours.push_back(of_ours);
    theirs.push_back(of_theirs);
    for (std::size_t i = 0; i < kPixels; ++i) {
      gap = std::max(gap, static_cast<double>(std::abs(result[i] - of_vlfeat[i])));
    }
  }
  bars.times_faster("one transform against VLFeat", median(ours), median(theirs), 5, 10);
  bars.at_most("  greatest difference", "%.1e", gap, 1e-5, 1e-5);
}
#endif

}  // namespace

void discrete_bars(Bars& bars) {
  if (!bars.wanted("discrete")) return;
  const int stars = bars.quick() ? 5 : 40;
  const Times four = times_of(stars, 4, 128, 0.02);
  bars.at_most("star of 4 parts, 128 x 128, median", "%.3f ms", 1e3 * four.ours, 0.4, 0.2);
  bars.times_faster("  against a straightforward one", four.ours, four.straightforward, 5, 10);
  bars.at_most("  greatest difference of the energies", "%.1e", four.gap, 1e-5, 1e-5);
  const Times five = times_of(stars, 5, 128, 0.02);
  bars.at_most("root and 4 parts, 128 x 128, median", "%.3f ms", 1e3 * five.ours, 0.4, 0.2);
  bars.times_faster("  against a straightforward one", five.ours, five.straightforward, 5, 10);
#ifdef ASTERISM_BENCH_VLFEAT
  against_vlfeat(bars, stars);
#endif
  // Light costs let parts go far, heavy ones leave them where they are.
  for (const double weight : {1.0, 0.1, 0.004, 0.001, 0.0001}) {
    const Times times = times_of(stars, 4, 128, weight);
    bars.line(format("star of 4 parts, 128 x 128, weight %g", weight),
              format("%.3f ms, %.3g x (%.3f ms)", 1e3 * times.ours, times.straightforward / times.ours,
                     1e3 * times.straightforward),
              "-", "-", true, true);
  }
  loops(bars, stars);
  const auto tell = [&bars](const std::string& name, const std::string& value) {
    bars.line(name, value, "-", "-", true, true);
  };
  for (const int reach : {4, 8, 16}) {
    tell(format("star of 4 parts, 128 x 128, lengths, reach %d", reach),
         format("%.2f ms", 1e3 * seconds_of_lengths(stars, reach)));
  }
  for (const int layers : {2, 5}) {
    tell(format("star of 4 parts, 128 x 128, %d layers", layers),
         format("%.2f ms", 1e3 * seconds_of_layers(stars, layers)));
  }
  for (const double distance : {0.0, 8.0}) {
    tell(format("star of 4 parts, 128 x 128, 10 best, distance %g", distance),
         format("%.1f ms", 1e3 * seconds_of_m_best(stars, distance)));
  }
  tell("steps that take the time of an envelope", format("%.0f", steps_of_an_envelope(stars)));
  double first = 0;
  for (const int size : {64, 128, 256, 512, 1024}) {
    const double seconds = times_of(bars.quick() ? 3 : 9, 4, size, 0.02, false).ours;
    const double nanoseconds = 1e9 * seconds / (4.0 * size * size);
    if (size == 64) first = nanoseconds;
    const std::string name = format("star of 4 parts, %d x %d, time a pixel", size, size);
    if (size == 64) {
      bars.line(name, format("%.2f ns", nanoseconds), "-", "-", true, true);
    } else {
      bars.at_most(name, "%.2f ns", nanoseconds, 2 * first, 1.3 * first);
    }
  }
}

}  // namespace asterism::bench
