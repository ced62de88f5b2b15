#include "overlap.hpp"

#include <algorithm>
#include <array>
#include <cfloat>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <stdexcept>
#include <utility>

#include "ground_truth.hpp"

namespace asterism::bench {
namespace {

constexpr std::array<std::pair<OverlapRule, std::string_view>, 4> kNames = {
    {{OverlapRule::Exact, "exact"},
     {OverlapRule::VotPython, "vot-python"},
     {OverlapRule::Trax, "trax"},
     {OverlapRule::TraxLegacy, "trax-legacy"}}};

using Polygon = std::vector<cv::Point2d>;

// Coordinates are limited to this: no image is as large, and integers hold whatever is computed from them.
constexpr double kLimit = 1e6;

bool finite(const Region& region) {
  return std::all_of(region.points().begin(), region.points().end(),
                     [](const cv::Point2d& p) { return std::isfinite(p.x) && std::isfinite(p.y); });
}

// --- Exact areas

double cross(const cv::Point2d& a, const cv::Point2d& b) { return a.x * b.y - a.y * b.x; }

// Twice the signed area.
double doubled_area(const Polygon& polygon) {
  double sum = 0;
  for (std::size_t i = 1; i + 1 < polygon.size(); ++i)
    sum += cross(polygon[i] - polygon[0], polygon[i + 1] - polygon[0]);
  return sum;
}

// The part of a convex polygon to the left of the line from a to b (Sutherland and Hodgman, 1974).
Polygon clip(const Polygon& polygon, const cv::Point2d& a, const cv::Point2d& b) {
  Polygon kept;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const cv::Point2d &p = polygon[i], &q = polygon[(i + 1) % polygon.size()];
    const double side_p = cross(b - a, p - a), side_q = cross(b - a, q - a);
    if (side_p >= 0) kept.push_back(p);
    if ((side_p > 0 && side_q < 0) || (side_p < 0 && side_q > 0))
      kept.push_back(p + (q - p) * (side_p / (side_p - side_q)));
  }
  return kept;
}

// A convex part of a polygon, counter-clockwise, and the sign that it counts with.
struct Piece {
  Polygon corners;
  double sign;
};

// The triangles between the first corner and each edge, signed by their orientation, clipped to `frame`
// (convex) if that is not empty. Their signed sum is the polygon, also if that is not convex.
std::vector<Piece> pieces(const Polygon& polygon, const Polygon& frame) {
  std::vector<Piece> list;
  for (std::size_t i = 1; i + 1 < polygon.size(); ++i) {
    Polygon corners = {polygon[0], polygon[i], polygon[i + 1]};
    const double sign = doubled_area(corners) < 0 ? -1 : 1;
    if (sign < 0) std::swap(corners[1], corners[2]);
    for (std::size_t k = 0; k < frame.size(); ++k)
      corners = clip(corners, frame[k], frame[(k + 1) % frame.size()]);
    list.push_back({std::move(corners), sign});
  }
  return list;
}

double doubled_area(const std::vector<Piece>& list) {
  double sum = 0;
  for (const Piece& piece : list) sum += piece.sign * doubled_area(piece.corners);
  return std::abs(sum);
}

double doubled_common_area(const std::vector<Piece>& a, const std::vector<Piece>& b) {
  double sum = 0;
  for (const Piece& s : a) {
    for (const Piece& t : b) {
      Polygon common = s.corners;
      for (std::size_t k = 0; k < t.corners.size(); ++k)
        common = clip(common, t.corners[k], t.corners[(k + 1) % t.corners.size()]);
      if (!t.corners.empty()) sum += s.sign * t.sign * doubled_area(common);
    }
  }
  return std::abs(sum);
}

double exact_overlap(const Region& a, const Region& b, const std::optional<cv::Size>& image) {
  if (a.is_rectangle() && b.is_rectangle() && !image) return tools::overlap(a.box(), b.box());
  if ((a.box() & b.box()).empty()) return 0;
  // Far from the origin, products of coordinates would lose the digits that matter.
  const cv::Point2d& first = a.points()[0];
  const bool is_near = std::max(std::abs(first.x), std::abs(first.y)) <= kLimit;
  const auto moved = [origin = is_near ? first : b.points()[0]](Polygon polygon) {
    for (cv::Point2d& p : polygon) p -= origin;
    return polygon;
  };
  Polygon frame;
  if (image) frame = moved(Region::rectangle({{}, cv::Size2d(*image)}).points());
  const std::vector<Piece> p = pieces(moved(a.points()), frame), q = pieces(moved(b.points()), frame);
  const double common = doubled_common_area(p, q);
  const double all = doubled_area(p) + doubled_area(q) - common;
  // Regions that only touch must not overlap by a rounding error: no overlap at all is a failure.
  return all > 0 && common > 1e-12 * all ? std::min(common / all, 1.0) : 0;
}

// --- Pixels, by spans of rows

// Pixels begin .. end - 1 of a row.
struct Span {
  int begin, end;
};
// Disjoint, from left to right.
using Spans = std::vector<Span>;

void add(Spans& spans, int width, int begin, int end) {
  begin = std::max(begin, 0);
  end = std::min(end, width);
  if (!spans.empty()) begin = std::max(begin, spans.back().end);
  if (begin < end) spans.push_back({begin, end});
}

std::int64_t length_of(const Spans& spans) {
  std::int64_t length = 0;
  for (const Span& span : spans) length += span.end - span.begin;
  return length;
}

std::int64_t common_length(const Spans& a, const Spans& b) {
  std::int64_t length = 0;
  for (std::size_t i = 0, j = 0; i < a.size() && j < b.size();) {
    length += std::max(0, std::min(a[i].end, b[j].end) - std::max(a[i].begin, b[j].begin));
    ++(a[i].end < b[j].end ? i : j);
  }
  return length;
}

// A region as pixel rows of a window. Between two of its `breaks` the same edges cross every row; `enter` is
// called with the first row of each such band, from top to bottom. In the current band, `is_upright` says
// whether all rows are alike, `edges` is the number of edges that cross each, and `row` gives the pixels of
// one. `crossings` is the number of edges summed over all rows of a window, `visits` the same over the first
// rows of sorted bands. Rows are entered in ascending order.
template <class T>
concept Raster = requires(T raster, int y, int width, Spans& spans) {
  { raster.breaks() } -> std::same_as<std::vector<int>>;
  { raster.crossings(y) } -> std::same_as<std::int64_t>;
  { raster.visits(std::vector<int>()) } -> std::same_as<std::int64_t>;
  raster.enter(y);
  { raster.is_upright() } -> std::same_as<bool>;
  { raster.edges() } -> std::same_as<std::size_t>;
  raster.row(y, width, spans);
};

struct Count {
  std::int64_t common = 0, all = 0;
};

// Up to so many crossings all rows are counted, in some 20 ms; regions of 50 edges in each of 8000 rows have
// a tenth of them. Beyond, every band gets an equal share, and in longer bands a row stands for several; if
// one row of each band is too much already, a row stands for several bands.
constexpr std::int64_t kMostCrossings = std::int64_t{1} << 22;

// Counts the pixels of two regions in a window of that size. Of rows that are alike only one is computed, of
// rows that neither region reaches none.
template <Raster A, Raster B>
Count count(int width, int height, A a, B b) {
  std::vector<int> breaks = a.breaks(), fewer = b.breaks();
  if (fewer.size() > breaks.size()) std::swap(breaks, fewer);
  std::sort(fewer.begin(), fewer.end());
  breaks.insert(breaks.end(), fewer.begin(), fewer.end());
  breaks.insert(breaks.end(), {0, height});
  for (int& y : breaks) y = std::clamp(y, 0, height);
  std::sort(breaks.begin(), breaks.end());
  breaks.erase(std::unique(breaks.begin(), breaks.end()), breaks.end());

  Count result;
  Spans row_a, row_b;
  const bool is_wild = a.crossings(height) + b.crossings(height) > kMostCrossings;
  // How many bands are taken for one; those of a region with few corners stay.
  const std::int64_t merged = is_wild ? 1 + 4 * (a.visits(breaks) + b.visits(breaks)) / kMostCrossings : 1;
  const bool keeps = std::ssize(fewer) <= std::ssize(breaks) / merged;
  for (std::size_t i = 1; merged > 1 && i + 1 < breaks.size(); ++i)
    if (static_cast<std::int64_t>(i) % merged != 0 &&
        !(keeps && std::binary_search(fewer.begin(), fewer.end(), breaks[i])))
      breaks[i] = breaks[i - 1];
  breaks.erase(std::unique(breaks.begin(), breaks.end()), breaks.end());
  const std::int64_t share = std::max(std::int64_t{1}, kMostCrossings / std::ssize(breaks));
  for (std::size_t i = 0; i + 1 < breaks.size(); ++i) {
    const int begin = breaks[i], end = breaks[i + 1];
    a.enter(begin);
    b.enter(begin);
    const auto edges = static_cast<std::int64_t>(a.edges() + b.edges());
    if (edges == 0 && merged == 1) continue;
    std::int64_t step = is_wild ? ((end - begin) * edges + share - 1) / share : 1;
    if (merged > 1 || (a.is_upright() && b.is_upright())) step = std::max<std::int64_t>(step, end - begin);
    for (std::int64_t y = begin; y < end; y += step) {
      const std::int64_t rows = std::min(step, end - y);
      const int middle = static_cast<int>(y + rows / 2);
      if (merged > 1) {
        a.enter(middle);
        b.enter(middle);
      }
      row_a.clear();
      row_b.clear();
      a.row(middle, width, row_a);
      b.row(middle, width, row_b);
      const std::int64_t common = common_length(row_a, row_b);
      result.common += common * rows;
      result.all += (length_of(row_a) + length_of(row_b) - common) * rows;
    }
  }
  return result;
}

// The edges of a polygon that cross the current band.
template <class Point>
class ActiveEdges {
 public:
  struct Edge {
    Point p, q;
    int begin, end;  // rows that it crosses
  };

  // `rows` gives the first row that an edge crosses, and the first below it.
  template <class Rows>
  ActiveEdges(const std::vector<Point>& corners, Rows rows) {
    for (std::size_t i = 0, j = corners.size() - 1; i < corners.size(); j = i++) {
      const auto [begin, end] = rows(corners[i], corners[j]);
      if (begin < end) waiting_.push_back({corners[i], corners[j], begin, end});
    }
    std::sort(waiting_.begin(), waiting_.end(),
              [](const Edge& a, const Edge& b) { return a.begin > b.begin; });
  }

  std::vector<int> breaks() const {
    std::vector<int> rows;
    for (const Edge& edge : waiting_) rows.insert(rows.end(), {edge.begin, edge.end});
    return rows;
  }
  std::int64_t crossings(int height) const {
    std::int64_t sum = 0;
    for (const Edge& edge : waiting_)
      sum += std::max(0, std::min(edge.end, height) - std::max(edge.begin, 0));
    return sum;
  }
  std::int64_t visits(const std::vector<int>& rows) const {
    std::int64_t sum = 0;
    for (const Edge& edge : waiting_)
      sum += std::lower_bound(rows.begin(), rows.end(), edge.end) -
             std::lower_bound(rows.begin(), rows.end(), edge.begin);
    return sum;
  }
  void enter(int y) {
    std::erase_if(active_, [&](const Edge& edge) { return edge.end <= y; });
    for (; !waiting_.empty() && waiting_.back().begin <= y; waiting_.pop_back())
      if (waiting_.back().end > y) active_.push_back(waiting_.back());
  }
  bool are_upright() const {
    return std::all_of(active_.begin(), active_.end(), [](const Edge& edge) { return edge.p.x == edge.q.x; });
  }
  const std::vector<Edge>& active() const { return active_; }

 private:
  std::vector<Edge> waiting_, active_;  // the next one last
};

// A polygon with integer coordinates in the window, its boundary included, as in both toolkits.
class ClosedPolygon {
 public:
  explicit ClosedPolygon(const Polygon& corners)
      : edges_(corners, [](const cv::Point2d& p, const cv::Point2d& q) {
          return std::pair(static_cast<int>(std::min(p.y, q.y)), static_cast<int>(std::max(p.y, q.y)) + 1);
        }) {
    for (const cv::Point2d& corner : corners)
      corner_rows_.insert(corner_rows_.end(), {static_cast<int>(corner.y), static_cast<int>(corner.y) + 1});
  }

  // Rows with corners are bands of their own: two edges meet there, and horizontal edges lie in no other row.
  std::vector<int> breaks() const { return corner_rows_; }
  std::int64_t crossings(int height) const { return edges_.crossings(height); }
  std::int64_t visits(const std::vector<int>& rows) const { return edges_.visits(rows); }
  void enter(int y) { edges_.enter(y); }
  bool is_upright() const { return edges_.are_upright(); }
  std::size_t edges() const { return edges_.active().size(); }

  void row(int y, int width, Spans& spans) {
    nodes_.clear();
    for (const auto& [p, q, begin, end] : edges_.active()) {
      // A horizontal edge adds one corner, its neighbour the other. Rounding is towards zero, not down.
      nodes_.push_back(static_cast<int>(p.y == q.y ? p.x : p.x + (y - p.y) / (q.y - p.y) * (q.x - p.x)));
    }
    std::sort(nodes_.begin(), nodes_.end());
    // Spans lie between pairs of nodes. A corner at which the outline goes on upwards or downwards gives the
    // same node twice: the first is skipped unless they are the last two.
    for (std::size_t i = 0; i + 1 < nodes_.size() && nodes_[i] < width;) {
      if (nodes_[i] == nodes_[i + 1] && i + 2 < nodes_.size()) {
        ++i;
        continue;
      }
      add(spans, width, nodes_[i], nodes_[i + 1] + 1);
      i += 2;
    }
  }

 private:
  ActiveEdges<cv::Point2d> edges_;
  std::vector<int> corner_rows_, nodes_;
};

// A region in single precision, as the toolkits store it.
struct Shape {
  bool rectangle;
  cv::Rect2f box;  // of a rectangle
  std::vector<cv::Point2f> corners;
};

Shape to_shape(const Region& region) {
  const auto limited = [](double v) { return std::clamp(v, -kLimit, kLimit); };
  // If an end is limited, the size is the distance between the limited ends.
  const auto size = [&](double begin, double length) {
    return limited(begin) == begin && limited(begin + length) == begin + length
               ? length
               : limited(begin + length) - limited(begin);
  };
  const cv::Rect2d& b = region.box();
  const cv::Rect2d box(limited(b.x), limited(b.y), size(b.x, b.width), size(b.y, b.height));
  Shape shape{region.is_rectangle(), cv::Rect2f(box), {}};
  for (const cv::Point2d& p : region.points())
    shape.corners.emplace_back(static_cast<float>(limited(p.x)), static_cast<float>(limited(p.y)));
  return shape;
}

// --- VOT's Python toolkit

struct Window {
  int left, top, right, bottom;  // all inclusive
};

int half_even(float v) { return static_cast<int>(std::nearbyint(v)); }

Window rounded_bounds(const Shape& s) {
  if (s.rectangle) {
    const int x = half_even(s.box.x), y = half_even(s.box.y);
    return {x, y, x + half_even(s.box.width) - 1, y + half_even(s.box.height) - 1};
  }
  Window w{half_even(s.corners[0].x), half_even(s.corners[0].y), 0, 0};
  w.right = w.left;
  w.bottom = w.top;
  for (const cv::Point2f& p : s.corners) {
    w = {std::min(w.left, half_even(p.x)), std::min(w.top, half_even(p.y)), std::max(w.right, half_even(p.x)),
         std::max(w.bottom, half_even(p.y))};
  }
  return w;
}

// The slice begin .. last of an array of `size` as in NumPy: a negative end counts from the array's end.
std::pair<int, int> slice(int begin, int last, int size) {
  const int end = last + 1;
  return {begin, std::clamp(end < 0 ? end + size : end, 0, size)};
}

class RoundedRectangle {
 public:
  RoundedRectangle(const Window& r, const Window& w) {
    if (r.left > w.right || r.right < w.left || r.top > w.bottom || r.bottom < w.top) return;
    // As in the toolkit, the right end relative to the window's left is limited by the window's right
    // relative to the image's left. This cuts pixels off if the window begins at negative coordinates.
    columns_ = slice(std::max(0, r.left - w.left), std::min(w.right, r.right - w.left), w.right - w.left + 1);
    rows_ = slice(std::max(0, r.top - w.top), std::min(w.bottom, r.bottom - w.top), w.bottom - w.top + 1);
  }
  std::vector<int> breaks() const { return {rows_.first, rows_.second}; }
  static std::int64_t crossings(int) { return 0; }
  static std::int64_t visits(const std::vector<int>&) { return 0; }
  void enter(int y) { inside_ = y >= rows_.first && y < rows_.second; }
  static bool is_upright() { return true; }
  std::size_t edges() const { return inside_ ? 2 : 0; }
  void row(int, int width, Spans& spans) const {
    if (inside_) add(spans, width, columns_.first, columns_.second);
  }

 private:
  std::pair<int, int> columns_, rows_;
  bool inside_ = false;
};

ClosedPolygon rounded_polygon(const Shape& s, const Window& w) {
  Polygon corners;
  for (const cv::Point2f& p : s.corners)
    corners.emplace_back(half_even(p.x) - w.left, half_even(p.y) - w.top);
  return ClosedPolygon(corners);
}

Count vot_python_count(const Shape& a, const Shape& b, const Window& w) {
  const int width = w.right - w.left + 1, height = w.bottom - w.top + 1;
  const auto rectangle = [&](const Shape& s) { return RoundedRectangle(rounded_bounds(s), w); };
  if (a.rectangle && b.rectangle) return count(width, height, rectangle(a), rectangle(b));
  if (a.rectangle) return count(width, height, rectangle(a), rounded_polygon(b, w));
  if (b.rectangle) return count(width, height, rounded_polygon(a, w), rectangle(b));
  return count(width, height, rounded_polygon(a, w), rounded_polygon(b, w));
}

double vot_python_overlap(const Shape& a, const Shape& b, const std::optional<cv::Size>& image) {
  const Window s = rounded_bounds(a), t = rounded_bounds(b);
  Window w{std::min(s.left, t.left), std::min(s.top, t.top), std::max(s.right, t.right),
           std::max(s.bottom, t.bottom)};
  if (w.left >= w.right || w.top >= w.bottom) return 1;  // both are empty: equal to the toolkit
  if (image) {
    w = {std::max(0, w.left), std::max(0, w.top), std::min(image->width - 1, w.right),
         std::min(image->height - 1, w.bottom)};
  }
  if (w.left >= w.right || w.top >= w.bottom) return 0;
  const Count n = vot_python_count(a, b, w);
  return n.all > 0 ? static_cast<double>(n.common) / static_cast<double>(n.all) : 0;
}

// --- libtrax

struct Bounds {
  float left, top, right, bottom;
};

// The corners of a shape. With the legacy flag a rectangle ends at its far edges, else at its last pixels.
std::vector<cv::Point2f> trax_corners(const Shape& s, bool legacy) {
  if (!s.rectangle) return s.corners;
  const float less = legacy ? 0.F : 1.F;
  const float right = s.box.x + s.box.width - less, bottom = s.box.y + s.box.height - less;
  return {{s.box.x, s.box.y}, {right, s.box.y}, {right, bottom}, {s.box.x, bottom}};
}

Bounds trax_bounds(const std::vector<cv::Point2f>& corners, bool rectangle, const Bounds& limits,
                   bool legacy) {
  // A rectangle narrower than a pixel may have its right end left of its left one.
  Bounds b{corners[0].x, corners[0].y, corners[2].x, corners[2].y};
  if (!rectangle) {
    for (const cv::Point2f& p : corners) {
      b = {std::min(b.left, p.x), std::min(b.top, p.y), std::max(b.right, p.x), std::max(b.bottom, p.y)};
    }
  }
  if (!legacy) b = {std::floor(b.left), std::floor(b.top), std::ceil(b.right), std::ceil(b.bottom)};
  return {std::max(b.left, limits.left), std::max(b.top, limits.top), std::min(b.right, limits.right),
          std::min(b.bottom, limits.bottom)};
}

float trax_area(const Bounds& b) { return (b.right - b.left) * (b.bottom - b.top); }

// A polygon without its right boundary, coordinates not rounded, as in libtrax with its legacy flag.
class LegacyPolygon {
 public:
  explicit LegacyPolygon(const std::vector<cv::Point2f>& corners)
      : edges_(corners, [](const cv::Point2f& p, const cv::Point2f& q) {
          // An edge crosses the rows that have one of its ends above them and the other not.
          const auto below = [](float v) { return static_cast<int>(std::floor(v)) + 1; };
          return std::pair(below(std::min(p.y, q.y)), below(std::max(p.y, q.y)));
        }) {}

  std::vector<int> breaks() const { return edges_.breaks(); }
  std::int64_t crossings(int height) const { return edges_.crossings(height); }
  std::int64_t visits(const std::vector<int>& rows) const { return edges_.visits(rows); }
  void enter(int y) { edges_.enter(y); }
  bool is_upright() const { return edges_.are_upright(); }
  std::size_t edges() const { return edges_.active().size(); }

  void row(int row_index, int width, Spans& spans) {
    const auto y = static_cast<float>(row_index);
    nodes_.clear();
    for (const auto& [p, q, begin, end] : edges_.active())
      nodes_.push_back(static_cast<int>(p.x + (y - p.y) / (q.y - p.y) * (q.x - p.x)));
    std::sort(nodes_.begin(), nodes_.end());
    for (std::size_t i = 0; i + 1 < nodes_.size() && nodes_[i] < width; i += 2) {
      // A span that ends beyond the row loses the row's last pixel, one that ends with the row does not.
      add(spans, width, nodes_[i], nodes_[i + 1] > width ? width - 1 : nodes_[i + 1]);
    }
  }

 private:
  ActiveEdges<cv::Point2f> edges_;
  std::vector<int> nodes_;
};

double trax_overlap(const Shape& a, const Shape& b, const std::optional<cv::Size>& image, bool legacy) {
  const Bounds limits =
      image ? Bounds{0, 0, static_cast<float>(image->width - 1), static_cast<float>(image->height - 1)}
            : Bounds{-FLT_MAX, -FLT_MAX, FLT_MAX, FLT_MAX};
  const std::vector<cv::Point2f> p = trax_corners(a, legacy), q = trax_corners(b, legacy);
  const Bounds s = trax_bounds(p, a.rectangle, limits, legacy),
               t = trax_bounds(q, b.rectangle, limits, legacy);
  const int x = static_cast<int>(std::min(s.left, t.left)), y = static_cast<int>(std::min(s.top, t.top));
  const int width = static_cast<int>(std::max(s.right, t.right) - static_cast<float>(x)) + 1;
  const int height = static_cast<int>(std::max(s.bottom, t.bottom) - static_cast<float>(y)) + 1;

  const double area_s = trax_area(s), area_t = trax_area(t);
  if (area_s / area_t < 1e-10 || area_t / area_s < 1e-10 || width < 1 || height < 1) return 0;
  const float common_box = trax_area({std::max(s.left, t.left), std::max(s.top, t.top),
                                      std::min(s.right, t.right), std::min(s.bottom, t.bottom)});
  if (common_box / (trax_area(s) + trax_area(t) - common_box) <= 0) return 0;

  const cv::Point2f origin(static_cast<float>(x), static_cast<float>(y));
  const auto moved = [&](std::vector<cv::Point2f> corners) {
    for (cv::Point2f& c : corners) c -= origin;
    return corners;
  };
  const auto rounded = [&](const std::vector<cv::Point2f>& corners) {
    Polygon whole;
    for (const cv::Point2f& c : moved(corners)) whole.emplace_back(std::round(c.x), std::round(c.y));
    return whole;
  };
  const Count n = legacy ? count(width, height, LegacyPolygon(moved(p)), LegacyPolygon(moved(q)))
                         : count(width, height, ClosedPolygon(rounded(p)), ClosedPolygon(rounded(q)));
  if (n.all == 0) return 0;  // libtrax gives NaN, which its users take for no overlap
  return static_cast<float>(n.common) / static_cast<float>(n.all);
}

}  // namespace

std::string_view to_string(OverlapRule rule) {
  return std::find_if(kNames.begin(), kNames.end(), [&](const auto& n) { return n.first == rule; })->second;
}

OverlapRule parse_overlap_rule(const std::string& name) {
  std::string known;
  for (const auto& [rule, text] : kNames) {
    if (text == name) return rule;
    known += (known.empty() ? "" : ", ") + std::string(text);
  }
  throw std::invalid_argument("unknown overlap rule \"" + name + "\" (known: " + known + ")");
}

double overlap(const Region& a, const Region& b, OverlapRule rule, std::optional<cv::Size> image) {
  if (!finite(a) || !finite(b)) return 0;
  if (rule == OverlapRule::Exact) return exact_overlap(a, b, image);
  const Shape s = to_shape(a), t = to_shape(b);
  if (rule == OverlapRule::VotPython) return vot_python_overlap(s, t, image);
  return trax_overlap(s, t, image, rule == OverlapRule::TraxLegacy);
}

}  // namespace asterism::bench
