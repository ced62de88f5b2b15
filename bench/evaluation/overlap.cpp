#include "overlap.hpp"

#include <algorithm>
#include <array>
#include <cfloat>
#include <cmath>
#include <cstdint>
#include <functional>
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

// The triangles between the first corner and each edge, signed by their orientation, within `frame` (convex)
// where that is not empty. Their signed sum is the polygon, whatever its shape.
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
  const auto moved = [origin = a.points()[0]](Polygon polygon) {
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

// --- Pixels, row by row

using Row = std::vector<unsigned char>;

struct Count {
  std::int64_t common = 0, all = 0;
};

// Pixels of two regions in a window of that size; `a(y, row)` sets those of one row.
template <class A, class B>
Count count(int width, int height, A a, B b) {
  Count result;
  Row row_a(static_cast<std::size_t>(width)), row_b(row_a);
  for (int y = 0; y < height; ++y) {
    std::fill(row_a.begin(), row_a.end(), 0);
    std::fill(row_b.begin(), row_b.end(), 0);
    a(y, row_a);
    b(y, row_b);
    for (std::size_t x = 0; x < row_a.size(); ++x) {
      result.common += row_a[x] & row_b[x];
      result.all += row_a[x] | row_b[x];
    }
  }
  return result;
}

void fill(Row& row, int begin, int end) {
  end = std::min(end, static_cast<int>(row.size()));
  for (int x = std::max(begin, 0); x < end; ++x) row[static_cast<std::size_t>(x)] = 1;
}

// A polygon with whole coordinates in the window, its boundary included: both toolkits.
class ClosedPolygon {
 public:
  explicit ClosedPolygon(Polygon corners) : corners_(std::move(corners)) {}

  void operator()(int y, Row& row) {
    const int width = static_cast<int>(row.size());
    nodes_.clear();
    for (std::size_t i = 0, j = corners_.size() - 1; i < corners_.size(); j = i++) {
      const cv::Point2d &p = corners_[i], &q = corners_[j];
      if (y < std::min(p.y, q.y) || y > std::max(p.y, q.y)) continue;
      // A level edge gives its one corner here and the other by its neighbour. Towards zero, not down.
      nodes_.push_back(static_cast<int>(p.y == q.y ? p.x : p.x + (y - p.y) / (q.y - p.y) * (q.x - p.x)));
    }
    std::sort(nodes_.begin(), nodes_.end());
    // From pairs of nodes. A corner within an edge's course gives the same node twice: the first is passed
    // over unless they are the last two.
    for (std::size_t i = 0; i + 1 < nodes_.size() && nodes_[i] < width;) {
      if (nodes_[i] == nodes_[i + 1] && i + 2 < nodes_.size()) {
        ++i;
        continue;
      }
      fill(row, nodes_[i], nodes_[i + 1] + 1);
      i += 2;
    }
  }

 private:
  Polygon corners_;
  std::vector<int> nodes_;
};

// No image is as large; without a limit, a tracker that went astray would cost hours and gigabytes.
constexpr double kLimit = 1e6;

// A region in single precision, as the toolkits store it.
struct Shape {
  bool rectangle;
  cv::Rect2f box;  // of a rectangle
  std::vector<cv::Point2f> corners;
};

Shape to_shape(const Region& region) {
  const auto limited = [](double v) { return static_cast<float>(std::clamp(v, -kLimit, kLimit)); };
  const cv::Rect2d& b = region.box();
  Shape shape{region.is_rectangle(), {limited(b.x), limited(b.y), limited(b.width), limited(b.height)}, {}};
  for (const cv::Point2d& p : region.points()) shape.corners.emplace_back(limited(p.x), limited(p.y));
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

// The pixels begin .. last of `size` as an array slice takes them: from the end where the end is negative.
std::pair<int, int> slice(int begin, int last, int size) {
  const int end = last + 1;
  return {begin, std::clamp(end < 0 ? end + size : end, 0, size)};
}

class RoundedRectangle {
 public:
  RoundedRectangle(const Window& r, const Window& w) {
    if (r.left > w.right || r.right < w.left || r.top > w.bottom || r.bottom < w.top) return;
    // The toolkit limits the right end, which counts from the window's left, by the window's right, which
    // counts from the image's. That differs where the window begins at negative coordinates.
    columns_ = slice(std::max(0, r.left - w.left), std::min(w.right, r.right - w.left), w.right - w.left + 1);
    rows_ = slice(std::max(0, r.top - w.top), std::min(w.bottom, r.bottom - w.top), w.bottom - w.top + 1);
  }
  void operator()(int y, Row& row) const {
    if (y >= rows_.first && y < rows_.second) fill(row, columns_.first, columns_.second);
  }

 private:
  std::pair<int, int> columns_, rows_;
};

std::function<void(int, Row&)> vot_python_raster(const Shape& s, const Window& w) {
  if (s.rectangle) return RoundedRectangle(rounded_bounds(s), w);
  Polygon corners;
  for (const cv::Point2f& p : s.corners)
    corners.emplace_back(half_even(p.x) - w.left, half_even(p.y) - w.top);
  return ClosedPolygon(std::move(corners));
}

double vot_python_overlap(const Shape& a, const Shape& b, const std::optional<cv::Size>& image) {
  const Window s = rounded_bounds(a), t = rounded_bounds(b);
  Window w{std::min(s.left, t.left), std::min(s.top, t.top), std::max(s.right, t.right),
           std::max(s.bottom, t.bottom)};
  if (w.left >= w.right || w.top >= w.bottom) return 1;  // both of no size: the same to the toolkit
  if (image) {
    w = {std::max(0, w.left), std::max(0, w.top), std::min(image->width - 1, w.right),
         std::min(image->height - 1, w.bottom)};
  }
  if (w.left >= w.right || w.top >= w.bottom) return 0;
  const Count n =
      count(w.right - w.left + 1, w.bottom - w.top + 1, vot_python_raster(a, w), vot_python_raster(b, w));
  return n.all > 0 ? static_cast<double>(n.common) / static_cast<double>(n.all) : 0;
}

// --- libtrax

struct Bounds {
  float left, top, right, bottom;
};

// As a polygon: with the legacy flag a rectangle ends where it ends, else at its last pixel.
std::vector<cv::Point2f> trax_corners(const Shape& s, bool legacy) {
  if (!s.rectangle) return s.corners;
  const float less = legacy ? 0.F : 1.F;
  const float right = s.box.x + s.box.width - less, bottom = s.box.y + s.box.height - less;
  return {{s.box.x, s.box.y}, {right, s.box.y}, {right, bottom}, {s.box.x, bottom}};
}

Bounds trax_bounds(const std::vector<cv::Point2f>& corners, bool rectangle, const Bounds& limits,
                   bool legacy) {
  // Of a rectangle narrower than a pixel the right end may be left of the left one.
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

// A polygon without its right boundary, coordinates as they are: libtrax with its legacy flag.
class LegacyPolygon {
 public:
  explicit LegacyPolygon(std::vector<cv::Point2f> corners) : corners_(std::move(corners)) {}

  void operator()(int row_index, Row& row) {
    const auto y = static_cast<float>(row_index);
    const int width = static_cast<int>(row.size());
    nodes_.clear();
    for (std::size_t i = 0, j = corners_.size() - 1; i < corners_.size(); j = i++) {
      const cv::Point2f &p = corners_[i], &q = corners_[j];
      if ((p.y < y) == (q.y < y)) continue;
      nodes_.push_back(static_cast<int>(p.x + (y - p.y) / (q.y - p.y) * (q.x - p.x)));
    }
    std::sort(nodes_.begin(), nodes_.end());
    for (std::size_t i = 0; i + 1 < nodes_.size() && nodes_[i] < width; i += 2) {
      // An end beyond the row leaves its last pixel out, one at its end does not.
      if (nodes_[i + 1] > 0) fill(row, nodes_[i], nodes_[i + 1] > width ? width - 1 : nodes_[i + 1]);
    }
  }

 private:
  std::vector<cv::Point2f> corners_;
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
  if (n.all == 0) return 0;  // libtrax gives NaN, which its users take for none
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
