#include "one_pass_measures.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <stdexcept>

#include "statistics.hpp"

namespace asterism::bench {

namespace {

constexpr std::size_t kFewestFrames = 20;  // of a run of TRE
constexpr double kMissing = -1;            // the error and overlap of a frame without ground truth

bool has_nan(const OtbBox& box) { return std::isnan(box.left + box.top + box.width + box.height); }

double overlap(const OtbBox& a, const OtbBox& b) {
  const double width = std::max(0.0, std::min(a.left + a.width, b.left + b.width) - std::max(a.left, b.left));
  const double height = std::max(0.0, std::min(a.top + a.height, b.top + b.height) - std::max(a.top, b.top));
  const double common = width * height;
  return common / (a.width * a.height + b.width * b.height - common);
}

/// Adds to curve[i] the number of frames whose value meets threshold i.
template <std::size_t kCount, class Meets>
void count(std::array<double, kCount>& curve, std::span<const double> values, const Meets& meets) {
  for (std::size_t i = 0; i < kCount; ++i)
    curve[i] +=
        static_cast<double>(std::ranges::count_if(values, [&](double value) { return meets(value, i); }));
}

/// The score of a sequence; empty if no frame after the first of a run has ground truth.
std::optional<OnePassScore> score_of(const OnePassSequence& sequence) {
  OnePassScore score;
  double frames = 0, overlap_sum = 0, overlap_count = 0;
  for (const OnePassRun& run : sequence.runs) {
    const std::size_t n = run.overlaps.size();
    if (n == 0 || run.centre_errors.size() != n || run.normalised_errors.size() != n)
      throw std::invalid_argument("a run without frames or with other numbers of overlaps and errors");
    frames += static_cast<double>(n);
    count(score.success, run.overlaps,
          [](double o, std::size_t i) { return o > static_cast<double>(i) / 20; });
    count(score.precision, run.centre_errors,
          [](double error, std::size_t i) { return error <= static_cast<double>(i); });
    count(score.normalised_precision, run.normalised_errors,
          [](double error, std::size_t i) { return error <= static_cast<double>(i) / 100; });
    for (std::size_t t = 1; t < n; ++t) {
      if (run.overlaps[t] == kMissing) continue;
      overlap_sum += run.overlaps[t];
      ++overlap_count;
    }
  }
  for (double& value : score.success) value /= frames;
  for (double& value : score.precision) value /= frames;
  for (double& value : score.normalised_precision) value /= frames;
  if (overlap_count == 0) return {};
  score.average_overlap = overlap_sum / overlap_count;
  return score;
}

OtbBox scaled(const OtbBox& box, double ratio) {
  const double width = ratio * box.width, height = ratio * box.height;
  return {std::round(box.left + box.width / 2 - width / 2), std::round(box.top + box.height / 2 - height / 2),
          std::round(width), std::round(height)};
}

OtbBox moved(OtbBox box, int right, int down) {
  box.left += right * std::ceil(0.1 * box.width);
  box.top += down * std::ceil(0.1 * box.height);
  return box;
}

/// One corner moved out by a tenth of the size, the others where they are; `right`, `down`: which corner.
OtbBox stretched(const OtbBox& box, bool right, bool down) {
  const double x = 0.1 * box.width, y = 0.1 * box.height;
  double left = box.left, top = box.top;
  double last_x = box.left + box.width - 1, last_y = box.top + box.height - 1;
  (right ? last_x : left) = right ? std::round(last_x + x) : std::round(left - x);
  (down ? last_y : top) = down ? std::round(last_y + y) : std::round(top - y);
  return {left, top, last_x - left + 1, last_y - top + 1};
}

/// As in shiftInitBB.m: the corner moves into the image, the size stays unless the far side lies outside too.
OtbBox clipped(OtbBox box, double image_width, double image_height) {
  box.left = std::max(box.left, 1.0);
  box.top = std::max(box.top, 1.0);
  box.width = std::min(box.width, image_width - box.left + 1);
  box.height = std::min(box.height, image_height - box.top + 1);
  return box;
}

}  // namespace

bool is_valid(const OtbBox& box, bool from_one) {
  return !has_nan(box) && box.width > 0 && box.height > 0 && (!from_one || (box.left > 0 && box.top > 0));
}

OnePassRun compare(std::span<const OtbBox> result, std::span<const OtbBox> truth, bool from_one) {
  if (truth.empty() || result.size() > truth.size())
    throw std::invalid_argument("no ground truth, or more boxes than it has");
  OnePassRun run;
  OtbBox box;
  for (std::size_t t = 0; t < truth.size(); ++t) {
    const auto add_without_box = [&](double value, double error) {
      run.overlaps.push_back(value);
      run.centre_errors.push_back(error);
      run.normalised_errors.push_back(error);
    };
    const bool ended = t >= result.size();
    if (!ended && (t == 0 || (!has_nan(result[t]) && result[t].width > 0 && result[t].height > 0)))
      box = result[t];
    const OtbBox& compared = t == 0 ? truth[0] : box;
    if (!is_valid(truth[t], from_one)) {
      add_without_box(kMissing, kMissing);
      continue;
    }
    if (ended) {
      add_without_box(0, std::numeric_limits<double>::infinity());
      continue;
    }
    const double x = compared.left + (compared.width - 1) / 2 - truth[t].left - (truth[t].width - 1) / 2;
    const double y = compared.top + (compared.height - 1) / 2 - truth[t].top - (truth[t].height - 1) / 2;
    run.overlaps.push_back(overlap(compared, truth[t]));
    run.centre_errors.push_back(std::sqrt(x * x + y * y));
    // pytracking takes (size - 1) / 2 for the centre here too, but in units of the truth's size for both
    // boxes.
    run.normalised_errors.push_back(std::hypot(x / truth[t].width, y / truth[t].height));
  }
  return run;
}

double OnePassScore::auc() const {
  return std::accumulate(success.begin(), success.end(), 0.0) / static_cast<double>(success.size());
}

OnePassScore one_pass_score(std::span<const OnePassSequence> sequences) {
  if (sequences.empty()) throw std::invalid_argument("no sequences");
  std::vector<OnePassScore> scores;
  for (const OnePassSequence& sequence : sequences) {
    if (sequence.runs.empty()) throw std::invalid_argument("a sequence without runs");
    if (const auto score = score_of(sequence)) scores.push_back(*score);
  }
  OnePassScore mean;
  if (scores.empty()) {
    mean.success.fill(kNone);
    mean.precision.fill(kNone);
    mean.normalised_precision.fill(kNone);
    mean.average_overlap = kNone;
    return mean;
  }
  const auto number = static_cast<double>(scores.size());
  const auto add = [&](auto& curve, const auto& other) {
    for (std::size_t i = 0; i < curve.size(); ++i) curve[i] += other[i] / number;
  };
  for (const OnePassScore& score : scores) {
    add(mean.success, score.success);
    add(mean.precision, score.precision);
    add(mean.normalised_precision, score.normalised_precision);
    mean.average_overlap += score.average_overlap / number;
  }
  return mean;
}

std::vector<std::size_t> temporal_starts(const std::vector<bool>& usable, std::size_t segments) {
  if (segments < 2) throw std::invalid_argument("fewer than two segments");
  std::vector<std::size_t> frames;
  for (std::size_t t = 0; t + kFewestFrames <= usable.size(); ++t)
    if (usable[t]) frames.push_back(t);
  if (frames.empty()) throw std::invalid_argument("no usable frame with 20 frames left");

  // Positions, from 1: floor(1 + k last / (segments - 1)) while that is at most last, then last once more.
  const std::size_t last = frames.size();
  std::vector<std::size_t> starts;
  for (std::size_t k = 0; k * last <= (last - 1) * (segments - 1); ++k)
    starts.push_back(frames[k * last / (segments - 1)]);
  starts.push_back(frames[last - 1]);
  return starts;
}

std::array<OtbBox, 12> spatial_starts(const OtbBox& box, double image_width, double image_height) {
  std::array starts = {moved(box, -1, 0),
                       moved(box, 1, 0),
                       moved(box, 0, -1),
                       moved(box, 0, 1),
                       stretched(box, false, false),
                       stretched(box, true, false),
                       stretched(box, false, true),
                       stretched(box, true, true),
                       scaled(box, 0.8),
                       scaled(box, 0.9),
                       scaled(box, 1.1),
                       scaled(box, 1.2)};
  for (OtbBox& start : starts) start = clipped(start, image_width, image_height);
  return starts;
}

}  // namespace asterism::bench
