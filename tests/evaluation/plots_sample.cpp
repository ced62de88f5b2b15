// Prints a page with a chart of each kind, for plots_test.py and for visual inspection.

#include <cmath>
#include <iostream>
#include <limits>

#include "plots.hpp"

namespace {

using namespace asterism::bench;

// Names of trackers, and one with characters that XML must escape.
const std::vector<std::string> kNames = {"dpt",        "coarse", "kcf", "CSRT", "a <b> & \"c\" \x01 d",
                                         "MedianFlow", "MOSSE",  "MIL", "TLD",  "Boosting",
                                         "dlib"};

LineChart lines() {
  LineChart chart{.title = "Expected average overlap",
                  .x = {.label = "frames", .low = 1},
                  .y = {.label = "overlap", .low = 0},
                  .series = {},
                  .shaded = std::pair(166.0, 377.0)};
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    Series series{.name = kNames[i], .x = {}, .y = {}, .tracker = i};
    for (int n = 1; n < 600 - 20 * static_cast<int>(i); ++n) {
      series.x.push_back(n);
      series.y.push_back((0.8 - 0.03 * static_cast<double>(i)) * std::exp(-n / 500.0) +
                         0.01 * std::sin(n / 9.0));
    }
    chart.series.push_back(series);
  }
  chart.series[1].y[100] = std::numeric_limits<double>::quiet_NaN();
  return chart;
}

ScatterChart scatter() {
  ScatterChart chart{.title = "Accuracy and robustness",
                     .x = {.label = "robustness (S = 30)", .low = 0, .high = 1},
                     .y = {.label = "accuracy"},
                     .points = {}};
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    const auto a = static_cast<double>(i);
    chart.points.push_back({kNames[i], 0.5 + 0.45 * std::cos(2.4 * a), 0.55 + 0.1 * std::sin(1.7 * a), i});
  }
  chart.points[1].x = 0.4;
  chart.points[2].x = 0.513;  // a name between these two would stand at both
  chart.points[1].y = chart.points[2].y = 0.57;
  return chart;
}

BarChart bars() {
  BarChart chart{.title = "Average overlap, and its interval", .x = {.label = "average overlap"}, .bars = {}};
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    const double value = 0.6 - 0.04 * static_cast<double>(i);
    chart.bars.push_back({kNames[i], value, std::pair(value - 0.05, value + 0.04), i});
  }
  return chart;
}

BarChart differences() {
  return {.title = "Difference from dpt",
          .x = {.label = "difference of EAO"},
          .bars = {{"coarse", -0.031, std::pair(-0.07, 0.01), 1}, {"kcf", 0.05, {}, 2}}};
}

Timeline timeline() {
  Timeline result{.title = "gymnastics", .strips = {}};
  for (std::size_t i = 0; i < 4; ++i) {
    Strip strip{.name = kNames[i], .overlaps = {}, .failures = {40 + 30 * i, 150}, .tracker = i};
    for (int t = 0; t < (i == 3 ? 1000 : 207); ++t)
      strip.overlaps.push_back(0.5 + 0.4 * std::sin(t / (9.0 + static_cast<double>(i))));
    result.strips.push_back(strip);
  }
  result.strips[2].failures.clear();
  return result;
}

}  // namespace

int main() {
  std::cout
      << "<html xmlns=\"http://www.w3.org/1999/xhtml\"><head><title>Charts</title><style>\n"
      << plot_style() << "body { background: #fcfcfb; }\n"
      << "@media (prefers-color-scheme: dark) { body { background: #1a1a19; } }\n</style></head><body>\n"
      << svg(lines()) << svg(scatter()) << svg(bars()) << svg(differences()) << svg(timeline())
      << svg(LineChart{.title = "Empty", .x = {}, .y = {}, .series = {}}) << "</body></html>\n";
}
