#include "multi_start_measures.hpp"

#include <algorithm>
#include <numeric>
#include <stdexcept>

namespace asterism::bench {

namespace {

constexpr double kLowOverlap = 0.1;
constexpr std::size_t kGrace = 10;  // so many consecutive frames of low overlap are a failure

void check(std::span<const MultiStartSequence> sequences) {
  if (sequences.empty()) throw std::invalid_argument("no sequences");
  for (const MultiStartSequence& sequence : sequences) {
    if (sequence.runs.empty()) throw std::invalid_argument("a sequence without runs");
    for (const AnchorRun& run : sequence.runs)
      if (run.overlaps.empty() || run.overlaps.size() != run.visible.size())
        throw std::invalid_argument("a run without frames, or other numbers of overlaps and flags");
  }
}

double overlap(const AnchorRun& run, std::size_t frame) { return frame == 0 ? 0 : run.overlaps[frame]; }

}  // namespace

std::vector<Anchor> anchors(std::span<const int> values) {
  std::vector<Anchor> result;
  for (const bool forward : {true, false})
    for (std::size_t t = 0; t < values.size(); ++t)
      if (forward ? values[t] > 0 : values[t] < 0) result.push_back({t, forward});
  return result;
}

std::vector<Anchor> regular_anchors(std::size_t length, std::size_t spacing) {
  if (spacing == 0) throw std::invalid_argument("anchors no frame apart");
  std::vector<int> values(length);
  const auto mark = [&](std::size_t t) { values[t] = 2 * t < length ? 1 : -1; };
  for (std::size_t t = 0; t < length; t += spacing) mark(t);
  if (length > 1) mark(length - 1);
  return anchors(values);
}

std::size_t frames_tracked(const AnchorRun& run) {
  std::size_t low = 0;
  for (std::size_t t = 0; t < run.overlaps.size(); ++t) {
    low = overlap(run, t) <= kLowOverlap && run.visible[t] ? low + 1 : 0;
    if (low == kGrace) return t + 1 - kGrace;
  }
  return run.overlaps.size();
}

MultiStartScore multi_start_score(std::span<const MultiStartSequence> sequences) {
  check(sequences);
  double overlaps = 0, tracked = 0, robustness = 0, frames = 0;
  for (const MultiStartSequence& sequence : sequences) {
    double tracked_here = 0, frames_here = 0;
    for (const AnchorRun& run : sequence.runs) {
      const std::size_t end = frames_tracked(run);
      for (std::size_t t = 0; t < end; ++t) overlaps += overlap(run, t);
      tracked_here += static_cast<double>(end);
      frames_here += static_cast<double>(run.overlaps.size());
    }
    tracked += tracked_here;
    // Accuracy weighs a sequence by its tracked frames, robustness by its length.
    robustness += tracked_here / frames_here * static_cast<double>(sequence.length);
    frames += static_cast<double>(sequence.length);
  }
  return {tracked > 0 ? overlaps / tracked : 0, robustness / frames};
}

std::vector<double> multi_start_eao_curve(std::span<const MultiStartSequence> sequences,
                                          std::size_t longest) {
  check(sequences);
  std::vector<double> total(longest), runs(longest);
  for (const MultiStartSequence& sequence : sequences)
    for (const AnchorRun& run : sequence.runs) {
      const std::size_t length = run.overlaps.size(), end = frames_tracked(run);
      double sum = 0;
      for (std::size_t i = 1; i < (end < length ? longest : std::min(length, longest)); ++i) {
        if (i < end) sum += overlap(run, i);
        // Beyond the end of the run, the toolkit divides the sum by one frame fewer.
        total[i] += sum / static_cast<double>(i < length ? i : i - 1);
        ++runs[i];
      }
    }
  for (std::size_t i = 0; i < longest; ++i) total[i] = runs[i] > 0 ? total[i] / runs[i] : 0;
  return total;
}

double multi_start_eao(std::span<const MultiStartSequence> sequences, const LengthInterval& interval) {
  if (interval.low >= interval.high) throw std::invalid_argument("an empty interval of lengths");
  const std::vector<double> curve = multi_start_eao_curve(sequences, interval.high);
  const auto low = curve.begin() + static_cast<std::ptrdiff_t>(interval.low);
  return std::accumulate(low, curve.end(), 0.0) / static_cast<double>(curve.end() - low);
}

}  // namespace asterism::bench
