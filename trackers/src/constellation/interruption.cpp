#include <algorithm>
#include <asterism/trackers/constellation/interruption.hpp>
#include <cmath>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Correlation below which two views show different scenes: they share less than a quarter of their variance.
constexpr double kSameScene = 0.5;
// Variance of a view [gray levels^2] below which it counts as blank.
constexpr double kLeastVariance = 1;
// A cell whose gray levels differ by at most this is blank: filler of a decoder, or saturated light.
constexpr int kOneLevel = 2;
// The view is doubtful if more than one in this many of the cells with content around the object is now
// blank.
constexpr int kHidden = 4;
// Side of the neighbourhood of the object [sides of its box].
constexpr double kNear = 2;

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

// Correlation of two views over their overlap, one of them shifted by whole cells; 0 if either is constant
// there.
double correlation(const InterruptionGate::View& a, const InterruptionGate::View& b, int right, int down) {
  constexpr int kSide = InterruptionGate::kViewCells;
  double n = 0, sum_a = 0, sum_b = 0, aa = 0, bb = 0, ab = 0;
  for (int row = std::max(0, down); row < kSide + std::min(0, down); ++row)
    for (int col = std::max(0, right); col < kSide + std::min(0, right); ++col) {
      const double x = a[static_cast<std::size_t>(row * kSide + col)],
                   y = b[static_cast<std::size_t>((row - down) * kSide + col - right)];
      ++n, sum_a += x, sum_b += y, aa += x * x, bb += y * y, ab += x * y;
    }
  const double scale = (aa - sum_a * sum_a / n) * (bb - sum_b * sum_b / n);
  return scale > 0 ? (ab - sum_a * sum_b / n) / std::sqrt(scale) : 0;
}

// Whether two views show one scene, allowing for shifts of the camera that leave at least half of it in both.
bool of_one_scene(const InterruptionGate::View& a, const InterruptionGate::View& b) {
  if (correlation(a, b, 0, 0) >= kSameScene) return true;  // nearly always
  constexpr int kSide = InterruptionGate::kViewCells;
  for (int down = -kSide / 2; down <= kSide / 2; ++down)
    for (int right = -kSide / 2; right <= kSide / 2; ++right) {
      const int common = (kSide - std::abs(down)) * (kSide - std::abs(right));
      if (2 * common >= kSide * kSide && correlation(a, b, right, down) >= kSameScene) return true;
    }
  return false;
}

}  // namespace

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

void InterruptionGate::learn(const Frame& frame, const cv::Rect2d& box, double confidence) {
  seen_.confidence = confidence;
  seen_.centre = centre_of(box);
  seen_.size = {box.width, box.height};
  seen_.view = view_of(frame);
  seen_.blanks = blanks_of(seen_, frame);
}

InterruptionGate::Sight InterruptionGate::judge(const Seen& seen, const Frame& frame) {
  const View view = view_of(frame);
  const Blanks blanks = blanks_of(seen, frame);
  int shown = 0, hidden = 0;  // cells that were not blank, and those of them that now are
  for (std::size_t i = 0; i < blanks.size(); ++i) {
    shown += seen.blanks[i] == 0;
    hidden += seen.blanks[i] == 0 && blanks[i] != 0;
  }
  const bool had_view = variance(seen.view) >= kLeastVariance, has_view = variance(view) >= kLeastVariance;
  const bool all_blank = std::find(blanks.begin(), blanks.end(), 0) == blanks.end();
  if (!has_view && all_blank && (had_view || shown > 0)) return Sight::Blank;
  const bool other_scene = had_view && !(has_view && of_one_scene(seen.view, view));
  return other_scene || kHidden * hidden > shown ? Sight::Doubtful : Sight::Scene;
}

void InterruptionGate::visit_seen(StateArchive& archive, Seen& seen) {
  archive.position(seen.centre);
  archive.size(seen.size);
  archive(seen.confidence);
  archive.require(seen.confidence >= 0 && seen.confidence <= 1);
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
