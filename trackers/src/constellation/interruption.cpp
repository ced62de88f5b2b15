#include <algorithm>
#include <asterism/trackers/constellation/interruption.hpp>
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

// Variance of the gray levels in a view.
double variance(const InterruptionGate::View& view) {
  double sum = 0, squares = 0;
  for (const std::uint8_t level : view) sum += level, squares += level * level;
  const auto n = static_cast<double>(view.size());
  return (squares - sum * sum / n) / n;
}

// Correlation of two views; 0 if either is constant.
double correlation(const InterruptionGate::View& a, const InterruptionGate::View& b) {
  const auto n = static_cast<double>(a.size());
  double sum_a = 0, sum_b = 0, aa = 0, bb = 0, ab = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double x = a[i], y = b[i];
    sum_a += x, sum_b += y, aa += x * x, bb += y * y, ab += x * y;
  }
  const double scale = (aa - sum_a * sum_a / n) * (bb - sum_b * sum_b / n);
  return scale > 0 ? (ab - sum_a * sum_b / n) / std::sqrt(scale) : 0;
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

InterruptionGate::View InterruptionGate::view_of(const Frame& frame) {
  View view;
  const cv::Size size = frame.size();
  visit_cells<kViewCells>(
      frame.gray(), cv::Rect2d(0, 0, size.width, size.height), [&](std::size_t cell, int sum, int) {
        view[cell] = static_cast<std::uint8_t>((sum + kSamples * kSamples / 2) / (kSamples * kSamples));
      });
  return view;
}

InterruptionGate::Blanks InterruptionGate::blanks_of(const Seen& seen, const Frame& frame) {
  Blanks blanks;
  visit_cells<kNearCells>(frame.gray(), box_around(seen.centre, kNear * seen.size),
                          [&](std::size_t cell, int, int range) { blanks[cell] = range <= kOneLevel; });
  return blanks;
}

void InterruptionGate::require_contrast(const Frame& frame, const cv::Rect2d& box) {
  if (is_blank_around(frame, box))
    throw std::invalid_argument(
        "the start box and its surroundings have one gray level or color: there is nothing to follow");
}

void InterruptionGate::learn(const Frame& frame, const View& view, const TrackResult& result) {
  seen_.centre = centre_of(result.box);
  seen_.size = {result.box.width, result.box.height};
  seen_.confidence = result.confidence;
  seen_.lost = result.lost;
  seen_.view = view;
  seen_.blanks = blanks_of(seen_, frame);
}

bool InterruptionGate::finds(const TrackResult& result) const {
  return !result.lost && result.confidence >= kLeastConfidence * before_.seen.confidence;
}

InterruptionGate::Sight InterruptionGate::compare(const Seen& seen, const Frame& frame, const View& view) {
  const Blanks blanks = blanks_of(seen, frame);
  int shown = 0, hidden = 0;  // cells that were not blank, and those of them that now are
  for (std::size_t i = 0; i < blanks.size(); ++i) {
    shown += seen.blanks[i] == 0;
    hidden += seen.blanks[i] == 0 && blanks[i] != 0;
  }
  const bool had_view = variance(seen.view) >= kLeastVariance, has_view = variance(view) >= kLeastVariance;
  const bool all_blank = std::find(blanks.begin(), blanks.end(), 0) == blanks.end();
  if (!has_view && all_blank && (had_view || shown > 0)) return Sight::Blank;
  if (had_view && !(has_view && correlation(seen.view, view) >= kSameScene)) return Sight::OtherScene;
  return kHidden * hidden > shown ? Sight::Hidden : Sight::Scene;
}

InterruptionGate::Sight InterruptionGate::judge(const Frame& frame, const View& view) const {
  // Successive frames of faint noise are no scene that continues.
  if (held_ > 0 && variance(before_.seen.view) >= kLeastVariance && variance(view) < kLeastVariance)
    return compare(before_.seen, frame, view);
  const Sight sight = compare(seen_, frame, view);
  if (sight == Sight::Blank || before_.tracker == nullptr) return sight;
  // A scene that went on may come to resemble the one before the break, while the camera turns back, say.
  const auto nearer = [&] {
    return held_ > 0 || before_.hidden ||
           correlation(before_.seen.view, view) > correlation(seen_.view, view);
  };
  return compare(before_.seen, frame, view) == Sight::Scene && nearer() ? Sight::Back : sight;
}

void InterruptionGate::visit_seen(StateArchive& archive, Seen& seen) {
  archive.position(seen.centre);
  archive.size(seen.size);
  archive(seen.confidence);
  archive.require(seen.confidence >= 0 && seen.confidence <= 1);
  archive(seen.lost);
  const auto visit = [&archive](auto& cells, int side) {
    cv::Mat image(side, side, CV_8UC1, cells.data());
    archive.pixels(image, image.size(), 1);
    if (archive.loading()) std::copy(image.begin<std::uint8_t>(), image.end<std::uint8_t>(), cells.begin());
  };
  visit(seen.view, kViewCells);
  visit(seen.blanks, kNearCells);
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
