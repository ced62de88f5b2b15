#include <algorithm>
#include <asterism/trackers/around/interruption.hpp>
#include <asterism/trackers/tracker/tracker_base.hpp>
#include <cmath>
#include <opencv2/core.hpp>
#include <stdexcept>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Correlation below which two views show different scenes: they share less than a quarter of their variance.
constexpr double kSameScene = 0.5;
// Variance of a view [gray levels^2] below which it counts as blank.
constexpr double kLeastVariance = 1;
// A cell whose gray levels differ by at most this is blank: filler of a decoder, or saturated light.
constexpr int kOneLevel = 2;
// The object is hidden if more than one in this many of the cells with content around the object is now
// blank.
constexpr int kHidden = 4;
// In another scene the tracker must be as sure of its object as this, relative to the frame before the break:
// noise has a best match, too.
constexpr double kLeastConfidence = 0.5;
// Side of the neighbourhood of the object [sides of its box].
constexpr double kNear = 2;

// Correlation of neighbouring pixels below which a frame is noise. Images have more than 0.8.
constexpr double kLeastNeighbourCorrelation = 0.25;

// Samples along each side of a cell.
constexpr int kSamples = 4;

// Visits the cells of a window row by row with the sum and range of their sampled gray levels; outside the
// image its border is continued.
template <std::size_t kCells, typename Visit>
void visit_cells(const cv::Mat& gray, const cv::Rect2d& window, Visit&& visit) {
  constexpr std::size_t kSide = kCells * kSamples;
  const auto positions = [](double begin, double length, int limit) {
    std::array<int, kSide> result;
    for (std::size_t i = 0; i < kSide; ++i) {
      const double at = begin - 0.5 + (static_cast<double>(i) + 0.5) * length / kSide;
      result[i] = static_cast<int>(std::lround(std::clamp(at, 0.0, limit - 1.0)));
    }
    return result;
  };
  const auto cols = positions(window.x, window.width, gray.cols),
             rows = positions(window.y, window.height, gray.rows);
  for (std::size_t row = 0; row < kCells; ++row)
    for (std::size_t col = 0; col < kCells; ++col) {
      int sum = 0, least = 255, most = 0;
      for (std::size_t i = 0; i < kSamples; ++i) {
        const std::uint8_t* const line = gray.ptr<std::uint8_t>(rows[row * kSamples + i]);
        for (std::size_t j = 0; j < kSamples; ++j) {
          const int level = line[cols[col * kSamples + j]];
          sum += level, least = std::min(least, level), most = std::max(most, level);
        }
      }
      visit(row * kCells + col, sum, most - least);
    }
}

// Whether the box and its surroundings, of twice its sides, have the same values everywhere: filler of a
// decoder, or saturated light. The box overlaps the image.
bool is_blank_around(const Frame& frame, const cv::Rect2d& box) {
  const cv::Size size = frame.size();
  const auto begin = [](double centre, double side, int limit) {
    return static_cast<int>(std::clamp(std::floor(centre - kNear * side / 2), 0.0, limit - 1.0));
  };
  const auto end = [](double centre, double side, int limit) {
    return static_cast<int>(
        std::clamp(std::ceil(centre + kNear * side / 2), 1.0, static_cast<double>(limit)));
  };
  const double x = box.x + box.width / 2, y = box.y + box.height / 2;
  const cv::Rect window(cv::Point(begin(x, box.width, size.width), begin(y, box.height, size.height)),
                        cv::Point(end(x, box.width, size.width), end(y, box.height, size.height)));
  const cv::Mat pixels = (frame.bgr().empty() ? frame.gray() : frame.bgr())(window);
  for (int channel = 0; channel < pixels.channels(); ++channel) {
    cv::Mat plane;
    cv::extractChannel(pixels, plane, channel);
    double least = 0, most = 0;
    cv::minMaxLoc(plane, &least, &most);
    if (most - least > kOneLevel) return false;
  }
  return true;
}

using Blanks = decltype(FollowedFrame::blanks);

Blanks blanks_about(const cv::Rect2d& box, const Frame& frame) {
  Blanks blanks;
  const cv::Rect2d window = box_around(centre_of(box), kNear * Size2(box.width, box.height));
  visit_cells<FollowedFrame::kCells>(
      frame.gray(), window, [&](std::size_t cell, int, int range) { blanks[cell] = range <= kOneLevel; });
  return blanks;
}

}  // namespace

bool shows_scene(const Frame& frame) {
  const cv::Mat& gray = frame.gray();
  double least = 0, most = 0;
  cv::minMaxLoc(gray, &least, &most);
  if (most - least <= kOneLevel) return false;
  if (gray.cols < 2) return true;
  // Correlation of pixels that are side by side.
  const cv::Mat left = gray.colRange(0, gray.cols - 1), right = gray.colRange(1, gray.cols);
  cv::Scalar mean_left, mean_right, deviation_left, deviation_right;
  cv::meanStdDev(left, mean_left, deviation_left);
  cv::meanStdDev(right, mean_right, deviation_right);
  cv::Mat products;
  cv::multiply(left, right, products, 1, CV_32F);
  const double covariance = cv::mean(products)[0] - mean_left[0] * mean_right[0],
               scale = deviation_left[0] * deviation_right[0];
  return scale == 0 || covariance >= kLeastNeighbourCorrelation * scale;
}

SceneView::SceneView(const Frame& frame) {
  const cv::Size size = frame.size();
  visit_cells<kCells>(
      frame.gray(), cv::Rect2d(0, 0, size.width, size.height), [&](std::size_t cell, int sum, int) {
        levels[cell] = static_cast<std::uint8_t>((sum + kSamples * kSamples / 2) / (kSamples * kSamples));
      });
}

bool SceneView::is_blank() const {
  double sum = 0, squares = 0;
  for (const std::uint8_t level : levels) sum += level, squares += level * level;
  const auto n = static_cast<double>(levels.size());
  return (squares - sum * sum / n) / n < kLeastVariance;
}

double SceneView::correlation(const SceneView& other) const {
  const auto n = static_cast<double>(levels.size());
  double sum_a = 0, sum_b = 0, aa = 0, bb = 0, ab = 0;
  for (std::size_t i = 0; i < levels.size(); ++i) {
    const double x = levels[i], y = other.levels[i];
    sum_a += x, sum_b += y, aa += x * x, bb += y * y, ab += x * y;
  }
  const double scale = (aa - sum_a * sum_a / n) * (bb - sum_b * sum_b / n);
  return scale > 0 ? (ab - sum_a * sum_b / n) / std::sqrt(scale) : 0;
}

FollowedFrame::FollowedFrame(const Frame& frame, const cv::Rect2d& start) {
  check_start(frame, start);
  if (is_blank_around(frame, start))
    throw std::invalid_argument(
        "the start box and its surroundings have one gray level or color: there is nothing to follow");
  TrackResult result;
  result.box = start;
  learn(frame, SceneView(frame), result);
}

void FollowedFrame::learn(const Frame& frame, const SceneView& frame_view, const TrackResult& result) {
  const double sum = result.box.x + result.box.y + result.box.width + result.box.height;
  if (std::isfinite(sum) && !result.box.empty()) box = result.box;
  confidence = result.confidence;
  weak = result.is_weak();
  view = frame_view;
  blanks = blanks_about(box, frame);
}

Sight FollowedFrame::compare(const Frame& frame, const SceneView& frame_view) const {
  const Blanks now = blanks_about(box, frame);
  int shown = 0, hidden = 0;  // cells that were not blank, and those of them that now are
  for (std::size_t i = 0; i < now.size(); ++i) {
    shown += blanks[i] == 0;
    hidden += blanks[i] == 0 && now[i] != 0;
  }
  const bool had_view = !view.is_blank(), has_view = !frame_view.is_blank();
  const bool all_blank = std::find(now.begin(), now.end(), 0) == now.end();
  if (!has_view && all_blank && (had_view || shown > 0)) return Sight::Blank;
  if (had_view && !(has_view && view.correlation(frame_view) >= kSameScene)) return Sight::OtherScene;
  return kHidden * hidden > shown ? Sight::Hidden : Sight::Scene;
}

bool FollowedFrame::is_found(const TrackResult& result) const {
  return !result.is_weak() && result.confidence >= kLeastConfidence * confidence;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
