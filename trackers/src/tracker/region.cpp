#include <algorithm>
#include <array>
#include <asterism/trackers/tracker/region.hpp>
#include <charconv>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <utility>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

constexpr std::size_t kMostCorners = 10'000;

double cross(const cv::Point2d& a, const cv::Point2d& b) { return a.x * b.y - a.y * b.x; }

// The convex hull of the corners. OpenCV selects them in single precision, hence from coordinates relative to
// the bounding box.
std::vector<cv::Point2d> convex_hull(const std::vector<cv::Point2d>& points, const cv::Rect2d& bounds) {
  std::vector<cv::Point2f> scaled;
  scaled.reserve(points.size());
  for (const cv::Point2d& p : points)
    scaled.emplace_back(static_cast<float>((p.x - bounds.x) / bounds.width),
                        static_cast<float>((p.y - bounds.y) / bounds.height));
  std::vector<int> chosen;
  cv::convexHull(scaled, chosen);
  std::vector<cv::Point2d> hull;
  hull.reserve(chosen.size());
  for (const int i : chosen) hull.push_back(points[static_cast<std::size_t>(i)]);
  return hull;
}

cv::Rect2d box_of(const cv::Point2d& centre, double width, double height) {
  return {centre.x - width / 2, centre.y - height / 2, width, height};
}

void append(std::string& text, double value) {
  std::array<char, 32> buffer;
  const auto [end, error] = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value);
  if (!text.empty()) text += ',';
  text.append(buffer.data(), end);
}

}  // namespace

Region Region::rectangle(const cv::Rect2d& b) {
  const double right = b.x + b.width, bottom = b.y + b.height;
  return {true, {{b.x, b.y}, {right, b.y}, {right, bottom}, {b.x, bottom}}, b};
}

Region Region::polygon(std::vector<cv::Point2d> points) {
  if (points.size() < 3) throw std::invalid_argument("a polygon needs at least three corners");
  for (const cv::Point2d& p : points)
    if (!std::isfinite(p.x) || !std::isfinite(p.y))
      throw std::invalid_argument("a polygon's corners must be finite");
  cv::Point2d low = points[0], high = points[0];
  for (const cv::Point2d& p : points) {
    low = {std::min(low.x, p.x), std::min(low.y, p.y)};
    high = {std::max(high.x, p.x), std::max(high.y, p.y)};
  }
  return {false, std::move(points), {low, high}};
}

Region Region::rotated(const cv::RotatedRect& box) {
  std::array<cv::Point2f, 4> corners;
  box.points(corners.data());
  return polygon({corners.begin(), corners.end()});
}

Region Region::mask(const cv::Mat& pixels) {
  if (pixels.type() != CV_8UC1) throw std::invalid_argument("a mask is an 8-bit image of one channel");
  const cv::Moments moments = cv::moments(pixels, true);
  if (moments.m00 == 0) throw std::invalid_argument("a mask must have a pixel that is not 0");
  const cv::Rect2d bounds = cv::boundingRect(pixels);
  const double scale = std::sqrt(moments.m00 / bounds.area());
  // Pixel (0, 0) covers 0 .. 1.
  const cv::Point2d centre(moments.m10 / moments.m00 + 0.5, moments.m01 / moments.m00 + 0.5);
  return rectangle(box_of(centre, scale * bounds.width, scale * bounds.height));
}

cv::Rect2d Region::equal_area_box() const {
  if (rectangle_ || box_.empty()) return box_;
  // Area and centroid from triangles with a common corner; positions relative to it avoid cancellation.
  const std::vector<cv::Point2d> hull = convex_hull(points_, box_);
  double twice_area = 0;
  cv::Point2d moment;
  for (std::size_t i = 1; i + 1 < hull.size(); ++i) {
    const cv::Point2d a = hull[i] - hull[0], b = hull[i + 1] - hull[0];
    const double c = cross(a, b);
    twice_area += c;
    moment += c / 3 * (a + b);
  }
  const double scale = std::sqrt(std::abs(twice_area) / 2 / box_.area());
  if (!(scale > 0) || !std::isfinite(scale)) return box_;
  const auto side = [&](double length) { return std::max(scale * length, std::min(length, 1.0)); };
  return box_of(hull[0] + moment / twice_area, side(box_.width), side(box_.height));
}

std::optional<Region> to_region(std::span<const double> v) {
  if (!std::all_of(v.begin(), v.end(), [](double d) { return std::isfinite(d); })) return {};
  if (v.size() == 4) {
    if (v[2] < 0 || v[3] < 0) return {};
    return Region::rectangle({v[0], v[1], v[2], v[3]});
  }
  if (v.size() < 6 || v.size() % 2 != 0 || v.size() > 2 * kMostCorners) return {};
  std::vector<cv::Point2d> points;
  for (std::size_t i = 0; i < v.size(); i += 2) points.emplace_back(v[i], v[i + 1]);
  return Region::polygon(std::move(points));
}

std::string to_string(const Region& region) {
  std::string text;
  if (region.is_rectangle()) {
    const cv::Rect2d& b = region.box();
    for (const double value : {b.x, b.y, b.width, b.height}) append(text, value);
  } else {
    for (const cv::Point2d& p : region.points()) {
      append(text, p.x);
      append(text, p.y);
    }
  }
  return text;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
