#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace asterism::bench {

// Static charts as inline SVG for a page that holds plot_style() once. No script: details are in tooltips.
// Texts may contain any character. A chart takes the width of its container up to its own. Values that are
// NaN are left out.

/// The style sheet of all charts, without <style>: colors for light and dark pages, safe for color-blind
/// readers.
std::string plot_style();

/// Text escaped for XML; control characters, which XML cannot represent, are left out.
std::string escaped(std::string_view text);

/// `value` with up to `decimals` decimals, without trailing zeros.
std::string number_text(double value, int decimals);

/// Multiples of 1, 2 or 5 times a power of ten in [low, high], about `count` of them. Throws
/// std::invalid_argument unless low < high.
std::vector<double> round_ticks(double low, double high, int count);

struct PlotAxis {
  std::string label;
  /// By default as wide as the data, to the next ticks.
  std::optional<double> low = {}, high = {};
  bool reversed = false;  ///< with the high end at the left or bottom, for ranks
};

/// A tracker has the color, marker and dash of its number in every chart of a page. The colors repeat after
/// eight, with another dash.
struct Series {
  std::string name;
  std::vector<double> x, y;  ///< as many; NaN interrupts the line
  std::size_t tracker = 0;
};

/// Lines, each labelled at its end.
struct LineChart {
  std::string title;
  PlotAxis x, y;
  std::vector<Series> series;
  std::optional<std::pair<double, double>> shaded = {};  ///< an interval of x
};
/// Throws std::invalid_argument for a series with other numbers of x and y.
std::string svg(const LineChart& chart);

struct ScatterPoint {
  std::string name;
  double x = 0, y = 0;
  std::size_t tracker = 0;
};

/// A marker for each tracker, with its name beside it where there is room, and a legend.
struct ScatterChart {
  std::string title;
  PlotAxis x, y;
  std::vector<ScatterPoint> points;
};
std::string svg(const ScatterChart& chart);

struct Bar {
  std::string name;
  double value = 0;
  std::optional<std::pair<double, double>> interval = {};
  std::size_t tracker = 0;
};

/// Horizontal bars from zero in the given order, with their intervals and values.
struct BarChart {
  std::string title;
  PlotAxis x;
  std::vector<Bar> bars;
};
std::string svg(const BarChart& chart);

struct Strip {
  std::string name;
  std::vector<double> overlaps;       ///< of each frame, in [0, 1]
  std::vector<std::size_t> failures;  ///< frames, from 0
  std::size_t tracker = 0;
};

/// The overlap of each tracker along one sequence, failures marked. The axis counts frames from 1;
/// neighbouring frames of long sequences share a column, which shows their mean.
struct Timeline {
  std::string title;
  std::vector<Strip> strips;
};
std::string svg(const Timeline& timeline);

}  // namespace asterism::bench
