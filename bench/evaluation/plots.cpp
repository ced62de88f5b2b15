#include "plots.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <utility>

namespace asterism::bench {

namespace {

constexpr std::size_t kColors = 9;
constexpr double kWidth = 720;         // of every chart [px]
constexpr double kTop = 34;            // below the title
constexpr double kBottom = 44;         // for the ticks and the label of the horizontal axis
constexpr double kLeft = 58;           // for those of the vertical axis
constexpr double kPlotHeight = 300;    // of charts with two axes
constexpr double kLine = 15;           // between lines of text
constexpr double kLetter = 6.8;        // of a letter at 12 px, about
constexpr double kNear = 24;           // a line that ends this near to its label has a leader to it
constexpr std::size_t kTooltips = 40;  // of a line, at most
constexpr std::size_t kColumns = 320;  // of a timeline, at most

double text_width(std::string_view text) {
  // Continuation bytes of UTF-8 are not counted.
  return kLetter *
         static_cast<double>(std::ranges::count_if(text, [](char c) { return (c & 0xC0) != 0x80; }));
}

template <class... Parts>
std::string join(const Parts&... parts) {
  std::string result;
  (result.append(parts), ...);
  return result;
}

std::string fixed_text(double value, int decimals) {
  std::array<char, 400> buffer{};
  std::snprintf(buffer.data(), buffer.size(), "%.*f", decimals, value);
  return buffer.data();
}

/// A position in the drawing, to a tenth of a pixel.
std::string px(double value) { return number_text(value, 1); }

/// An attribute: ` name="value"`.
std::string attribute(std::string_view name, std::string_view value) {
  return join(" ", name, "=\"", escaped(value), "\"");
}
std::string attribute(std::string_view name, double value) { return attribute(name, px(value)); }

std::string title(std::string_view text) { return join("<title>", escaped(text), "</title>"); }

std::string text(double x, double y, std::string_view classes, std::string_view content) {
  return join("<text", attribute("class", classes), attribute("x", x), attribute("y", y), ">",
              escaped(content), "</text>\n");
}

std::string line(double x1, double y1, double x2, double y2, std::string_view classes) {
  return join("<line", attribute("class", classes), attribute("x1", x1), attribute("y1", y1),
              attribute("x2", x2), attribute("y2", y2), "/>\n");
}

std::string rectangle(double x, double y, double width, double height, std::string_view classes,
                      std::string_view tooltip = {}) {
  return join("<rect", attribute("class", classes), attribute("x", x), attribute("y", y),
              attribute("width", width), attribute("height", height), ">",
              tooltip.empty() ? std::string() : title(tooltip), "</rect>\n");
}

/// The classes that give a tracker its color and dash.
std::string classes_of(std::size_t tracker) {
  return join("c", std::to_string(tracker % kColors), " d", std::to_string(tracker / kColors % 3));
}

/// One shape for each color, so that trackers do not differ by color alone.
std::string marker(double x, double y, std::size_t tracker, std::string_view tooltip = {}) {
  constexpr std::array<std::string_view, kColors> kShapes = {
      "M-5,0a5,5 0 1 0 10,0a5,5 0 1 0 -10,0z",                         // disc
      "M-4.5,-4.5h9v9h-9z",                                            // square
      "M0,-5.8L5.4,4.2H-5.4z",                                         // triangle
      "M0,-6L6,0L0,6L-6,0z",                                           // diamond
      "M0,5.8L5.4,-4.2H-5.4z",                                         // triangle that points down
      "M-1.8,-5.5h3.6v3.7h3.7v3.6h-3.7v3.7h-3.6v-3.7h-3.7v-3.6h3.7z",  // plus
      "M-6,0L-3,-5.2H3L6,0L3,5.2H-3z",                                 // hexagon
      "M-5.8,0L4.2,-5.4V5.4z",                                         // triangle that points left
      "M5.8,0L-4.2,5.4V-5.4z"};                                        // triangle that points right
  return join("<path", attribute("class", join("marker ", classes_of(tracker))),
              attribute("transform", join("translate(", px(x), ",", px(y), ")")),
              attribute("d", kShapes[tracker % kColors]), ">",
              tooltip.empty() ? std::string() : title(tooltip), "</path>\n");
}

/// Maps values to pixels.
struct Scale {
  double low, high, from, to;
  double operator()(double value) const { return from + (value - low) / (high - low) * (to - from); }
  bool has(double value) const { return value >= low && value <= high; }
};

/// The number of decimals that tells the ticks apart.
int decimals_of(const std::vector<double>& ticks) {
  if (ticks.size() < 2) return 2;
  return std::max(0, static_cast<int>(std::ceil(-std::log10(ticks[1] - ticks[0]) - 1e-9)));
}

struct Range {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  void add(double value) {
    if (!std::isfinite(value)) return;
    low = std::min(low, value);
    high = std::max(high, value);
  }
};

struct AxisScale {
  Scale scale;
  std::vector<double> ticks;
  int decimals;
};

/// The axis from pixel `from` to `to`, with its given ends, or else those of the data widened to the next
/// ticks.
AxisScale axis_scale(const PlotAxis& axis, Range data, double from, double to, int tick_count) {
  double low = axis.low.value_or(data.low), high = axis.high.value_or(data.high);
  if (!std::isfinite(low) || !std::isfinite(high)) low = 0, high = 1;  // no data
  if (!(low < high)) {
    const double margin = low == 0 ? 1 : std::abs(low) / 2;
    low -= margin;
    high += margin;
  }
  std::vector<double> ticks = round_ticks(low, high, tick_count);
  if (ticks.size() > 1) {
    const double step = ticks[1] - ticks[0], slack = 1e-9 * step;
    if (!axis.low && ticks.front() > low + slack) low = ticks.front() - step;
    if (!axis.high && ticks.back() < high - slack) high = ticks.back() + step;
    ticks = round_ticks(low, high, tick_count);
  }
  if (axis.reversed) std::swap(from, to);
  const int decimals = decimals_of(ticks);
  return {{low, high, from, to}, std::move(ticks), decimals};
}

std::string horizontal_axis(const AxisScale& axis, const std::string& label, double top, double bottom) {
  std::string result;
  for (const double tick : axis.ticks) {
    result += line(axis.scale(tick), top, axis.scale(tick), bottom, "grid");
    result += text(axis.scale(tick), bottom + 16, "tick middle", number_text(tick, axis.decimals));
  }
  result += line(axis.scale.from, bottom, axis.scale.to, bottom, "axis");
  return result + text((axis.scale.from + axis.scale.to) / 2, bottom + 35, "label middle", label);
}

std::string vertical_axis(const AxisScale& axis, const std::string& label, double left, double right) {
  std::string result;
  for (const double tick : axis.ticks) {
    result += line(left, axis.scale(tick), right, axis.scale(tick), "grid");
    result += text(left - 8, axis.scale(tick) + 4, "tick end", number_text(tick, axis.decimals));
  }
  const double middle = (axis.scale.from + axis.scale.to) / 2;
  return join(result, "<text class=\"label middle\"",
              attribute("transform", join("translate(14,", px(middle), ") rotate(-90)")), ">", escaped(label),
              "</text>\n");
}

std::string whole(const std::string& heading, double height, const std::string& content) {
  return join("<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"plot\" role=\"img\"",
              attribute("aria-label", heading), attribute("width", kWidth), attribute("height", height),
              attribute("viewBox", join("0 0 ", px(kWidth), " ", px(height))), ">\n",
              text(0, 16, "title", heading), content, "</svg>\n");
}

/// Moves the wanted heights of labels apart: in the same order, at least a line apart, and within [top,
/// bottom] if they fit.
std::vector<double> spread(std::vector<double> heights, double top, double bottom) {
  std::vector<std::size_t> order(heights.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order, {}, [&](std::size_t i) { return heights[i]; });
  double least = top;
  for (const std::size_t i : order) {
    heights[i] = std::max(heights[i], least);
    least = heights[i] + kLine;
  }
  double most = bottom;
  for (auto i = order.rbegin(); i != order.rend(); ++i) {
    heights[*i] = std::min(heights[*i], most);
    most = heights[*i] - kLine;
  }
  return heights;
}

template <class Items>
double widest_name(const Items& items) {
  double width = 0;
  for (const auto& item : items) width = std::max(width, text_width(item.name));
  return width;
}

/// The height of a chart with two axes whose legend has `lines`.
double plot_height(std::size_t lines) { return std::max(kPlotHeight, kLine * static_cast<double>(lines)); }

/// The last visible point of a line.
std::optional<std::pair<double, double>> end_of(const Series& series, const Scale& x, const Scale& y) {
  for (std::size_t i = series.x.size(); i-- > 0;)
    if (x.has(series.x[i]) && y.has(series.y[i])) return std::pair(x(series.x[i]), y(series.y[i]));
  return {};
}

std::string polyline(const Series& series, const Scale& x, const Scale& y) {
  std::string path;
  bool drawing = false;
  for (std::size_t i = 0; i < series.x.size(); ++i) {
    const bool visible = x.has(series.x[i]) && std::isfinite(series.y[i]);
    if (visible)
      path +=
          join(drawing ? "L" : "M", px(x(series.x[i])), ",", px(y(std::clamp(series.y[i], y.low, y.high))));
    drawing = visible;
  }
  return join("<path", attribute("class", join("line ", classes_of(series.tracker))), attribute("d", path),
              ">", title(series.name), "</path>\n");
}

/// Spots with tooltips, evenly along a line.
std::string tooltips(const Series& series, const AxisScale& x, const AxisScale& y) {
  std::string result;
  const std::size_t step = std::max<std::size_t>(1, (series.x.size() + kTooltips - 1) / kTooltips);
  for (std::size_t i = 0; i < series.x.size(); i += step) {
    if (!x.scale.has(series.x[i]) || !y.scale.has(series.y[i])) continue;
    result += join("<circle class=\"spot\"", attribute("cx", x.scale(series.x[i])),
                   attribute("cy", y.scale(series.y[i])), attribute("r", 7), ">",
                   title(join(series.name, ": ", number_text(series.y[i], y.decimals + 2), " at ",
                              number_text(series.x[i], x.decimals + 1))),
                   "</circle>\n");
  }
  return result;
}

struct Area {
  double left, top, right, bottom;
  bool meets(const Area& other) const {
    return left < other.right && other.left < right && top < other.bottom && other.top < bottom;
  }
};

/// The columns of a strip: the overlaps of single frames, or means of consecutive ones if there are too many.
std::vector<double> columns_of(const std::vector<double>& overlaps) {
  const std::size_t count = std::min(overlaps.size(), kColumns);
  std::vector<double> columns(count);
  for (std::size_t c = 0; c < count; ++c) {
    const std::size_t begin = c * overlaps.size() / count, end = (c + 1) * overlaps.size() / count;
    double sum = 0, number = 0;
    for (std::size_t t = begin; t < end; ++t) {
      if (std::isnan(overlaps[t])) continue;
      sum += overlaps[t];
      ++number;
    }
    columns[c] = number > 0 ? sum / number : 0;
  }
  return columns;
}

}  // namespace

std::string escaped(std::string_view text) {
  std::string result;
  for (const char c : text) {
    switch (c) {
      case '&':
        result += "&amp;";
        break;
      case '<':
        result += "&lt;";
        break;
      case '>':
        result += "&gt;";
        break;
      case '"':
        result += "&quot;";
        break;
      default:
        if (static_cast<unsigned char>(c) >= ' ' || c == '\n' || c == '\t') result += c;
    }
  }
  return result;
}

std::string number_text(double value, int decimals) {
  std::string result = fixed_text(value, decimals);
  if (result.find('.') != std::string::npos) {
    result.erase(result.find_last_not_of('0') + 1);
    if (result.back() == '.') result.pop_back();
  }
  return result == "-0" ? "0" : result;
}

std::vector<double> round_ticks(double low, double high, int count) {
  if (!(low < high) || count < 1) throw std::invalid_argument("ticks of an empty range");
  const double rough = (high - low) / count;
  const double power = std::pow(10, std::floor(std::log10(rough)));
  double step = 10 * power;
  for (const double factor : {5.0, 2.0, 1.0})
    if (factor * power >= rough * (1 - 1e-9)) step = factor * power;
  std::vector<double> ticks;
  for (double i = std::ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; ++i)
    ticks.push_back(i * step);
  return ticks;
}

std::string plot_style() {
  return R"(.plot {
  --ink: #0b0b0b; --soft: #52514e; --faint: #e1e0d9; --rule: #a5a49c; --paper: #fcfcfb; --alarm: #d0021b;
  --c0: #275cc1; --c1: #ad4308; --c2: #019873; --c3: #d98e00;
  --c4: #875c8f; --c5: #00a5fc; --c6: #623283; --c7: #84223b;
  --c8: #3c000f;
  max-width: 100%; height: auto; overflow: visible;
  background: var(--paper); font: 12px system-ui, sans-serif;
}
@media (prefers-color-scheme: dark) {
  .plot {
    --ink: #ffffff; --soft: #c3c2b7; --faint: #2c2c2a; --rule: #6b6a64; --paper: #1a1a19; --alarm: #ff5c5c;
    --c0: #0a8fb6; --c1: #fbb469; --c2: #00e6bf; --c3: #8c7507;
    --c4: #b1376b; --c5: #90ade9; --c6: #6356c2; --c7: #e17a70;
    --c8: #ffef00;
  }
}
.plot text { fill: var(--ink); }
.plot .title { font-size: 14px; font-weight: 600; }
.plot .tick, .plot .label { fill: var(--soft); }
.plot .tick { font-variant-numeric: tabular-nums; }
.plot .middle { text-anchor: middle; }
.plot .end { text-anchor: end; }
.plot .grid { stroke: var(--faint); }
.plot .axis, .plot .leader { stroke: var(--rule); }
.plot .whisker { stroke: var(--ink); stroke-width: 1.5; }
.plot .shade { fill: var(--faint); opacity: 0.6; }
.plot .line { fill: none; stroke: var(--c); stroke-width: 2; stroke-linejoin: round; }
.plot .marker { fill: var(--c); stroke: var(--paper); }
.plot .marker.d1 { fill: var(--paper); stroke: var(--c); stroke-width: 2; }
.plot .marker.d2 { stroke: var(--ink); }
.plot .bar, .plot .overlap { fill: var(--c); }
.plot .strip { fill: var(--faint); opacity: 0.6; }
.plot .failure { fill: var(--alarm); }
.plot .spot { fill: transparent; }
.plot .spot:hover { fill: var(--rule); opacity: 0.5; }
.plot .line.d1 { stroke-dasharray: 7 4; }
.plot .line.d2 { stroke-dasharray: 2 3; }
.plot .c0 { --c: var(--c0); }
.plot .c1 { --c: var(--c1); }
.plot .c2 { --c: var(--c2); }
.plot .c3 { --c: var(--c3); }
.plot .c4 { --c: var(--c4); }
.plot .c5 { --c: var(--c5); }
.plot .c6 { --c: var(--c6); }
.plot .c7 { --c: var(--c7); }
.plot .c8 { --c: var(--c8); }
)";
}

std::string svg(const LineChart& chart) {
  Range x_data, y_data;
  for (const Series& series : chart.series) {
    if (series.x.size() != series.y.size())
      throw std::invalid_argument("series '" + series.name + "' has not as many x as y");
    std::ranges::for_each(series.x, [&](double x) { x_data.add(x); });
    std::ranges::for_each(series.y, [&](double y) { y_data.add(y); });
  }
  const double right = kWidth - widest_name(chart.series) - 46;
  const double bottom = kTop + plot_height(chart.series.size());
  const AxisScale x = axis_scale(chart.x, x_data, kLeft, right, 8);
  const AxisScale y = axis_scale(chart.y, y_data, bottom, kTop, 6);

  std::string content;
  if (chart.shaded) {
    const double from = x.scale(std::max(chart.shaded->first, x.scale.low));
    const double to = x.scale(std::min(chart.shaded->second, x.scale.high));
    if (from < to) content += rectangle(from, kTop, to - from, bottom - kTop, "shade");
  }
  content += vertical_axis(y, chart.y.label, kLeft, right) + horizontal_axis(x, chart.x.label, kTop, bottom);
  std::vector<double> ends;
  for (const Series& series : chart.series) {
    content += polyline(series, x.scale, y.scale);
    const auto end = end_of(series, x.scale, y.scale);
    ends.push_back(end ? end->second : bottom);
  }
  const std::vector<double> labels = spread(ends, kTop, bottom);
  for (std::size_t i = 0; i < chart.series.size(); ++i) {
    const Series& series = chart.series[i];
    // A leader from far inside the plot would cross other lines.
    if (const auto end = end_of(series, x.scale, y.scale); end && end->first > right - kNear)
      content += line(end->first, end->second, right + 12, labels[i], "leader");
    content += line(right + 14, labels[i], right + 36, labels[i], join("line ", classes_of(series.tracker)));
    content += text(right + 41, labels[i] + 4, "name", series.name);
  }
  for (const Series& series : chart.series) content += tooltips(series, x, y);
  return whole(chart.title, bottom + kBottom, content);
}

std::string svg(const ScatterChart& chart) {
  Range x_data, y_data;
  for (const ScatterPoint& point : chart.points) {
    x_data.add(point.x);
    y_data.add(point.y);
  }
  const double right = kWidth - widest_name(chart.points) - 40;
  const double bottom = kTop + plot_height(chart.points.size());
  const AxisScale x = axis_scale(chart.x, x_data, kLeft, right, 8);
  const AxisScale y = axis_scale(chart.y, y_data, bottom, kTop, 6);
  const auto visible = [&](const ScatterPoint& point) {
    return x.scale.has(point.x) && y.scale.has(point.y);
  };

  std::string content =
      vertical_axis(y, chart.y.label, kLeft, right) + horizontal_axis(x, chart.x.label, kTop, bottom);
  const auto at_marker = [&](const ScatterPoint& point) -> Area {
    const double cx = x.scale(point.x), cy = y.scale(point.y);
    return {cx - 6, cy - 6, cx + 6, cy + 6};
  };
  std::vector<Area> labels;
  for (std::size_t i = 0; i < chart.points.size(); ++i) {
    const ScatterPoint& point = chart.points[i];
    const double height = kTop + kLine * (static_cast<double>(i) + 0.5);
    content += marker(right + 18, height, point.tracker) + text(right + 30, height + 4, "name", point.name);
    if (!visible(point)) continue;
    const double cx = x.scale(point.x), cy = y.scale(point.y), width = text_width(point.name);
    content += marker(cx, cy, point.tracker,
                      join(point.name, ": ", number_text(point.x, x.decimals + 2), ", ",
                           number_text(point.y, y.decimals + 2)));
    // The name goes to the first free place of right, left, above and below.
    struct Place {
      double x, base, share;  // of the width, left of x
      const char* classes;
    };
    for (const auto& [at, base, share, classes] :
         {Place{cx + 9, cy + 4, 0, "name"}, Place{cx - 9, cy + 4, 1, "name end"},
          Place{cx, cy - 10, 0.5, "name middle"}, Place{cx, cy + 19, 0.5, "name middle"}}) {
      const double left = at - share * width;
      const Area area = {left, base - 10, left + width, base + 3};
      // Nearer to another marker than to its own, a name would seem to be that one's.
      const Area around = {area.left - 9, area.top - 3, area.right + 9, area.bottom + 3};
      const auto is_near = [&](const ScatterPoint& other) {
        return &other != &point && visible(other) && around.meets(at_marker(other));
      };
      if (area.left < kLeft || area.right > right || area.top < kTop || area.bottom > bottom ||
          std::ranges::any_of(chart.points, is_near) ||
          std::ranges::any_of(labels, [&](const Area& other) { return around.meets(other); }))
        continue;
      content += text(at, base, classes, point.name);
      labels.push_back(area);
      break;
    }
  }
  return whole(chart.title, bottom + kBottom, content);
}

std::string svg(const BarChart& chart) {
  constexpr double kRow = 24, kThickness = 14;
  Range data;
  data.add(0);
  for (const Bar& bar : chart.bars) {
    data.add(bar.value);
    if (!bar.interval) continue;
    data.add(bar.interval->first);
    data.add(bar.interval->second);
  }
  const double left = widest_name(chart.bars) + 12;
  const double bottom = kTop + kRow * static_cast<double>(chart.bars.size());
  const AxisScale x = axis_scale(chart.x, data, left, kWidth - 60, 7);

  std::string content = horizontal_axis(x, chart.x.label, kTop, bottom);
  const double zero = x.scale(std::clamp(0.0, x.scale.low, x.scale.high));
  for (std::size_t i = 0; i < chart.bars.size(); ++i) {
    const Bar& bar = chart.bars[i];
    const double middle = kTop + kRow * (static_cast<double>(i) + 0.5);
    content += text(left - 8, middle + 4, "name end", bar.name);
    if (std::isnan(bar.value)) continue;
    const auto shown = [&](double value) { return fixed_text(value, x.decimals + 2); };
    std::string tooltip = join(bar.name, ": ", shown(bar.value));
    double end = x.scale(std::clamp(bar.value, x.scale.low, x.scale.high));
    std::string whiskers;
    if (bar.interval) {
      const auto [low, high] = *bar.interval;
      tooltip += join(" (", shown(low), " to ", shown(high), ")");
      const double from = x.scale(std::max(low, x.scale.low)), to = x.scale(std::min(high, x.scale.high));
      whiskers = line(from, middle, to, middle, "whisker") +
                 line(from, middle - 4, from, middle + 4, "whisker") +
                 line(to, middle - 4, to, middle + 4, "whisker");
    }
    content += rectangle(std::min(zero, end), middle - kThickness / 2, std::abs(end - zero), kThickness,
                         join("bar ", classes_of(bar.tracker)), tooltip);
    content += whiskers;
    if (bar.interval) end = std::max(end, x.scale(std::min(bar.interval->second, x.scale.high)));
    content += text(std::max(end, zero) + 7, middle + 4, "tick", shown(bar.value));
  }
  content += line(zero, kTop, zero, bottom, "axis");
  return whole(chart.title, bottom + kBottom, content);
}

std::string svg(const Timeline& timeline) {
  constexpr double kHeight = 26, kRow = 36;
  std::size_t frames = 0;
  for (const Strip& strip : timeline.strips) frames = std::max(frames, strip.overlaps.size());
  const double left = widest_name(timeline.strips) + 12;
  const double bottom = kTop + kRow * static_cast<double>(timeline.strips.size());
  // Frame t is drawn from t to t + 1, so that its tick is at the middle.
  const AxisScale x = axis_scale({.label = "frame", .low = 0.5, .high = static_cast<double>(frames) + 0.5},
                                 {}, left, kWidth - 18, 8);

  std::string content = horizontal_axis(x, "frame", kTop, bottom);
  for (std::size_t i = 0; i < timeline.strips.size(); ++i) {
    const Strip& strip = timeline.strips[i];
    const double top = kTop + kRow * static_cast<double>(i) + 5, base = top + kHeight;
    content += text(left - 8, top + kHeight / 2 + 4, "name end", strip.name);
    if (strip.overlaps.empty()) continue;
    const auto from = [&](double frame) { return x.scale(frame + 0.5); };
    const auto length = static_cast<double>(strip.overlaps.size());
    content += rectangle(left, top, from(length) - left, kHeight, "strip");
    const std::vector<double> columns = columns_of(strip.overlaps);
    std::string path = join("M", px(left), ",", px(base));
    for (std::size_t c = 0; c < columns.size(); ++c) {
      const std::size_t end = (c + 1) * strip.overlaps.size() / columns.size();
      path += join("V", px(base - kHeight * std::clamp(columns[c], 0.0, 1.0)), "H",
                   px(from(static_cast<double>(end))));
    }
    double mean = 0, number = 0;
    for (const double overlap : strip.overlaps) {
      if (std::isnan(overlap)) continue;
      mean += overlap;
      ++number;
    }
    content += join("<path", attribute("class", join("overlap ", classes_of(strip.tracker))),
                    attribute("d", join(path, "V", px(base), "z")), ">",
                    title(join(strip.name, ": mean overlap ", number_text(number > 0 ? mean / number : 0, 3),
                               ", ", std::to_string(strip.failures.size()), " failures")),
                    "</path>\n");
    for (const std::size_t failure : strip.failures) {
      const double at = from(static_cast<double>(failure) + 0.5);
      content +=
          join("<path class=\"failure\"",
               attribute("d", join("M", px(at - 4), ",", px(top - 4), "h8L", px(at + 0.8), ",", px(top + 4),
                                   "V", px(base), "h-1.6V", px(top + 4), "z")),
               ">", title(join(strip.name, ": failure in frame ", std::to_string(failure + 1))), "</path>\n");
    }
  }
  return whole(timeline.title, bottom + kBottom, content);
}

}  // namespace asterism::bench
