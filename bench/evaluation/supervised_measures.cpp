#include "supervised_measures.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>
#include <stdexcept>

#include "statistics.hpp"

namespace asterism::bench {

namespace {

constexpr std::size_t kFewestComparable = 25;  // frames for a test of accuracy

using Sequences = std::span<const SupervisedSequence>;
using Frames = std::vector<std::size_t>;

void check(Sequences sequences) {
  if (sequences.empty()) throw std::invalid_argument("no sequences");
  for (const SupervisedSequence& sequence : sequences) {
    if (sequence.runs.empty() || sequence.length() == 0)
      throw std::invalid_argument("a sequence without runs or frames");
    const auto fits = [&](const auto& values) { return values.size() == sequence.length(); };
    for (const SupervisedRun& run : sequence.runs)
      if (!fits(run.outcomes) || !fits(run.overlaps))
        throw std::invalid_argument("runs of different lengths on one sequence");
    for (const auto& [name, frames] : sequence.tags)
      if (!fits(frames)) throw std::invalid_argument("not as many tags '" + name + "' as frames");
    if (!sequence.practical_difference.empty() && !fits(sequence.practical_difference))
      throw std::invalid_argument("not as many practical differences as frames");
  }
}

void check_tag(Toolkit toolkit, std::string_view tag) {
  if (toolkit == Toolkit::Python && tag != kAllFrames)
    throw std::invalid_argument("the Python toolkit defines no measure of a tag");
}

double overlap(const SupervisedRun& run, std::size_t frame) {
  const double value = run.overlaps[frame];
  return run.outcomes[frame] != Outcome::Tracked || std::isnan(value) ? 0 : value;
}

bool has_tag(const SupervisedSequence& sequence, std::string_view tag, std::size_t frame) {
  if (tag == kAllFrames) return true;
  if (tag == kUntagged)
    return std::ranges::none_of(sequence.tags, [&](const auto& entry) { return entry.second[frame]; });
  const auto found = sequence.tags.find(tag);
  return found != sequence.tags.end() && found->second[frame];
}

Frames frames_with(const SupervisedSequence& sequence, std::string_view tag) {
  Frames frames;
  for (std::size_t t = 0; t < sequence.length(); ++t)
    if (has_tag(sequence, tag, t)) frames.push_back(t);
  return frames;
}

/// Whether each of the frames counts for accuracy. The burn-in counts these frames only, from a start among
/// them: a start on a frame without the tag has no burn-in.
std::vector<bool> counted(const SupervisedRun& run, const Frames& frames) {
  std::vector<bool> result(frames.size());
  std::size_t burnt_in = kBurnIn;
  for (std::size_t i = 0; i < frames.size(); ++i, ++burnt_in) {
    const Outcome outcome = run.outcomes[frames[i]];
    if (outcome == Outcome::Started) burnt_in = 0;
    result[i] = burnt_in >= kBurnIn && outcome == Outcome::Tracked;
  }
  return result;
}

std::size_t failures(const SupervisedRun& run, const Frames& frames) {
  return static_cast<std::size_t>(
      std::ranges::count(frames, Outcome::Failed, [&](std::size_t t) { return run.outcomes[t]; }));
}

/// The overlap in each of the frames, as the mean over the runs in which it counts; NaN if it counts in none.
std::vector<double> frame_accuracies(const SupervisedSequence& sequence, const Frames& frames) {
  std::vector<double> total(frames.size()), runs(frames.size());
  for (const SupervisedRun& run : sequence.runs) {
    const std::vector<bool> counts = counted(run, frames);
    for (std::size_t i = 0; i < frames.size(); ++i) {
      if (!counts[i]) continue;
      total[i] += overlap(run, frames[i]);
      ++runs[i];
    }
  }
  std::ranges::transform(total, runs, total.begin(), std::divides());  // 0 / 0 is NaN
  return total;
}

AccuracyRobustness python_accuracy_robustness(Sequences sequences) {
  AccuracyRobustness result;
  double frames = 0;
  for (const SupervisedSequence& sequence : sequences) {
    const Frames all = frames_with(sequence, kAllFrames);
    double accuracy = 0, failed = 0;
    for (const SupervisedRun& run : sequence.runs) {
      const std::vector<bool> counts = counted(run, all);
      double total = 0;
      for (const std::size_t t : all) total += counts[t] ? overlap(run, t) : 0;
      const auto count = static_cast<double>(std::ranges::count(counts, true));
      accuracy += count > 0 ? total / count : 0;
      failed += static_cast<double>(failures(run, all));
    }
    const auto runs = static_cast<double>(sequence.runs.size());
    const auto length = static_cast<double>(sequence.length());
    result.accuracy += accuracy / runs * length;
    result.failures += failed / runs * length;
    frames += length;
  }
  result.accuracy /= frames;
  result.failures /= frames;
  result.failure_rate = result.failures / (frames / static_cast<double>(sequences.size()));
  return result;
}

/// On the frames that have the tag: the pooled overlaps, NaN for a frame that counts in no run, and the
/// failures of one run.
struct Pooled {
  std::vector<double> overlaps;
  double failures = 0;

  double accuracy() const {
    double total = 0, count = 0;
    for (const double value : overlaps) {
      if (std::isnan(value)) continue;
      total += value;
      ++count;
    }
    return count > 0 ? total / count : 0;
  }
};

/// `tagged`: the same sequences, whose tags are used.
Pooled pool(Sequences sequences, Sequences tagged, std::string_view tag) {
  Pooled result;
  for (std::size_t s = 0; s < sequences.size(); ++s) {
    const SupervisedSequence& sequence = sequences[s];
    const Frames frames = frames_with(tagged[s], tag);
    const std::vector<double> overlaps = frame_accuracies(sequence, frames);
    result.overlaps.insert(result.overlaps.end(), overlaps.begin(), overlaps.end());
    double failed = 0;
    for (const SupervisedRun& run : sequence.runs) failed += static_cast<double>(failures(run, frames));
    result.failures += failed / static_cast<double>(sequence.runs.size());
  }
  return result;
}

/// A part of a run from a start on.
struct Fragment {
  std::size_t begin = 0, end = 0;
  bool failed = false;  // the overlap after `end` counts as zero
};

/// Where the next start is, or the end of the run.
std::size_t next_start(const SupervisedRun& run, std::size_t frame) {
  const auto from = run.outcomes.begin() + static_cast<std::ptrdiff_t>(frame);
  return static_cast<std::size_t>(std::find(from, run.outcomes.end(), Outcome::Started) -
                                  run.outcomes.begin());
}

/// Fragments end with the next start, which they include. The last one counts as not failed, even if it
/// failed too late for a restart (estimate_expected_overlap.m).
std::vector<Fragment> legacy_fragments(const SupervisedRun& run) {
  const std::size_t n = run.outcomes.size();
  std::vector<Fragment> result;
  std::size_t begin = 0;
  for (std::size_t next = next_start(run, 1); next < n; next = next_start(run, next + 1)) {
    result.push_back({begin, next + 1, true});
    begin = next;
  }
  result.push_back({begin, n, false});
  return result;
}

/// Fragments end before the failure (supervised.py).
std::vector<Fragment> python_fragments(const SupervisedRun& run) {
  const std::size_t n = run.outcomes.size();
  std::vector<Fragment> result;
  std::size_t begin = 0;
  for (std::size_t t = 0; t < n; ++t) {
    if (run.outcomes[t] != Outcome::Failed) continue;
    result.push_back({std::min(begin, t), t, true});  // empty if the start itself failed
    begin = next_start(run, t);
  }
  if (begin < n) result.push_back({begin, n, false});
  return result;
}

/// The share of a fragment's frames that have the tag. For the tag of untagged frames the toolkit counts
/// those of the whole sequence (query_label.m).
double tagged_share(const SupervisedSequence& sequence, const Fragment& fragment, std::string_view tag) {
  if (tag == kAllFrames) return 1;
  const std::size_t begin = tag == kUntagged ? 0 : fragment.begin;
  const std::size_t end = tag == kUntagged ? sequence.length() : fragment.end;
  double tagged = 0;
  for (std::size_t t = begin; t < end; ++t) tagged += has_tag(sequence, tag, t);
  return tagged / static_cast<double>(fragment.end - fragment.begin);
}

/// Sums over fragments by length, element i for i + 1 frames.
struct Curve {
  std::vector<double> total, weight;

  explicit Curve(std::size_t longest) : total(longest), weight(longest) {}

  void add(const SupervisedRun& run, const Fragment& fragment, double fragment_weight) {
    const std::size_t length = fragment.end - fragment.begin;
    double sum = 0;  // over all frames but the first, in which the tracker is given the region
    for (std::size_t i = 1; i < (fragment.failed ? total.size() : length); ++i) {
      if (i < length) sum += overlap(run, fragment.begin + i);
      total[i] += fragment_weight * sum / static_cast<double>(i);
      weight[i] += fragment_weight;
    }
  }

  std::vector<double> mean() const {
    std::vector<double> result(total.size());
    std::ranges::transform(total, weight, result.begin(), std::divides());
    return result;
  }
};

std::vector<double> legacy_curve(Sequences sequences, std::string_view tag) {
  std::size_t longest = 0;
  for (const SupervisedSequence& sequence : sequences) longest = std::max(longest, sequence.length());
  Curve curve(longest);
  for (const SupervisedSequence& sequence : sequences)
    for (const SupervisedRun& run : sequence.runs)
      for (const Fragment& fragment : legacy_fragments(run)) {
        const double runs = static_cast<double>(sequence.runs.size());
        curve.add(run, fragment, tagged_share(sequence, fragment, tag) / runs);
      }
  std::vector<double> result = curve.mean();
  result[0] = 1;
  return result;
}

std::vector<double> python_curve(Sequences sequences) {
  std::size_t longest = 0;
  const auto for_each = [&](auto&& visit) {
    for (const SupervisedSequence& sequence : sequences)
      for (const SupervisedRun& run : sequence.runs)
        for (const Fragment& fragment : python_fragments(run)) visit(run, fragment);
  };
  for_each([&](const SupervisedRun&, const Fragment& fragment) {
    longest = std::max(longest, fragment.end - fragment.begin);
  });
  Curve curve(longest);
  for_each([&](const SupervisedRun& run, const Fragment& fragment) { curve.add(run, fragment, 1); });
  std::vector<double> result = curve.mean();
  if (!result.empty()) result[0] = 0;
  return result;
}

using Different = std::vector<std::vector<bool>>;  // whether two trackers differ significantly

/// Ranks by `better`, 1 for the best and ties in the given order; then each tracker gets the mean rank of
/// those that do not differ from it (adapted_ranks.m).
template <class Better>
std::vector<double> adapted_ranks(std::span<const double> values, const Different& different,
                                  const Better& better) {
  std::vector<std::size_t> order(values.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order, better, [&](std::size_t i) { return values[i]; });
  std::vector<double> ranks(values.size()), adapted(values.size());
  for (std::size_t i = 0; i < order.size(); ++i) ranks[order[i]] = static_cast<double>(i + 1);
  for (std::size_t i = 0; i < ranks.size(); ++i) {
    double total = 0, count = 0;
    for (std::size_t j = 0; j < ranks.size(); ++j) {
      if (different[i][j]) continue;
      total += ranks[j];
      ++count;
    }
    adapted[i] = total / count;
  }
  return adapted;
}

/// The practical difference of each frame with the tag, or none unless every sequence has them.
std::vector<double> practical_differences(Sequences sequences, std::string_view tag) {
  std::vector<double> result;
  for (const SupervisedSequence& sequence : sequences) {
    if (sequence.practical_difference.empty()) return {};
    for (const std::size_t t : frames_with(sequence, tag)) result.push_back(sequence.practical_difference[t]);
  }
  return result;
}

bool accuracy_differs(std::span<const double> a, std::span<const double> b, std::span<const double> practical,
                      double significance) {
  std::vector<double> differences;
  double in_practice = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (std::isnan(a[i]) || std::isnan(b[i])) continue;
    differences.push_back(a[i] - b[i]);
    if (!practical.empty()) in_practice += differences.back() / practical[i];
  }
  const std::size_t n = differences.size();
  if (!practical.empty() && std::abs(in_practice / static_cast<double>(n)) < 1) return false;
  return n < kFewestComparable || signed_rank_p(differences) <= significance;
}

/// The failures of each repetition on each sequence that has the tag.
std::vector<double> failure_sample(Sequences sequences, Sequences tagged, std::string_view tag,
                                   std::size_t repetitions) {
  std::vector<double> result;
  for (std::size_t s = 0; s < sequences.size(); ++s) {
    const Frames frames = frames_with(tagged[s], tag);
    if (frames.empty()) continue;
    double total = 0;
    for (const SupervisedRun& run : sequences[s].runs) {
      result.push_back(static_cast<double>(failures(run, frames)));
      total += result.back();
    }
    const std::size_t runs = sequences[s].runs.size();
    if (runs < repetitions)
      result.insert(result.end(), repetitions - runs, total / static_cast<double>(runs));
  }
  return result;
}

}  // namespace

std::vector<std::string> tags(Sequences sequences) {
  check(sequences);
  std::set<std::string> names;
  bool untagged = false;
  for (const SupervisedSequence& sequence : sequences) {
    for (const auto& [name, frames] : sequence.tags) names.insert(name);
    untagged = untagged || !frames_with(sequence, kUntagged).empty();
  }
  if (untagged && !names.empty()) names.emplace(kUntagged);
  return {names.begin(), names.end()};
}

double AccuracyRobustness::reliability(double frames) const { return std::exp(-frames * failure_rate); }

AccuracyRobustness accuracy_robustness(Sequences sequences, Toolkit toolkit, std::string_view tag) {
  check(sequences);
  check_tag(toolkit, tag);
  if (toolkit == Toolkit::Python) return python_accuracy_robustness(sequences);
  const Pooled pooled = pool(sequences, sequences, tag);
  const auto frames = static_cast<double>(pooled.overlaps.size());
  return {pooled.accuracy(), pooled.failures, frames > 0 ? pooled.failures / frames : 0};
}

std::size_t accuracy_frames(Sequences sequences, std::string_view tag) {
  check(sequences);
  const std::vector<double> overlaps = pool(sequences, sequences, tag).overlaps;
  return static_cast<std::size_t>(
      std::ranges::count_if(overlaps, [](double value) { return !std::isnan(value); }));
}

AccuracyRobustness mean_over_tags(Sequences sequences) {
  AccuracyRobustness result;
  double frames = 0;
  for (const std::string& tag : tags(sequences)) {
    const Pooled pooled = pool(sequences, sequences, tag);
    const auto count = static_cast<double>(pooled.overlaps.size());
    result.accuracy += count * pooled.accuracy();
    result.failures += count * pooled.failures;
    result.failure_rate += pooled.failures;
    frames += count;
  }
  if (frames == 0) throw std::invalid_argument("no tags");
  return {result.accuracy / frames, result.failures / frames, result.failure_rate / frames};
}

std::vector<double> eao_curve(Sequences sequences, Toolkit toolkit, std::string_view tag) {
  check(sequences);
  check_tag(toolkit, tag);
  return toolkit == Toolkit::Python ? python_curve(sequences) : legacy_curve(sequences, tag);
}

double eao(std::span<const double> curve, const LengthInterval& interval, Toolkit toolkit) {
  if (interval.low == 0 || interval.low > interval.high)
    throw std::invalid_argument("an interval of lengths that is empty or begins at 0");
  // Length n is element n - 1, but the Python toolkit reads element n.
  const std::size_t shift = toolkit == Toolkit::Python ? 0 : 1;
  double total = 0, count = 0;
  for (std::size_t i = interval.low - shift; i <= interval.high - shift && i < curve.size(); ++i) {
    if (std::isnan(curve[i])) continue;
    total += curve[i];
    ++count;
  }
  return total / count;
}

double eao(Sequences sequences, const LengthInterval& interval, Toolkit toolkit, std::string_view tag) {
  return eao(eao_curve(sequences, toolkit, tag), interval, toolkit);
}

TypicalLengths typical_lengths(std::span<const std::size_t> lengths) {
  const std::vector<double> values(lengths.begin(), lengths.end());
  const double bandwidth = kde_bandwidth(values);
  const std::size_t longest = std::ranges::max(lengths);
  std::vector<double> density(longest + 1);  // by length, from 1 on
  for (std::size_t n = 1; n <= longest; ++n)
    density[n] = kde_density(values, bandwidth, static_cast<double>(n));
  const double half = std::accumulate(density.begin(), density.end(), 0.0) / 2;

  const auto mode = static_cast<std::size_t>(std::ranges::max_element(density) - density.begin());
  std::size_t low = mode, high = mode;
  double mass = density[mode];
  do {
    const bool down = low > 1 && (high + 1 >= longest || density[low - 1] > density[high + 1]);
    mass += density[down ? --low : ++high];
  } while (mass < half);
  return {{low, high}, mode};
}

ArRanks ar_ranks(std::span<const std::vector<SupervisedSequence>> trackers, std::string_view tag,
                 const RankOptions& options) {
  if (trackers.empty()) throw std::invalid_argument("no trackers");
  const Sequences tagged = trackers.front();
  for (const Sequences sequences : trackers) {
    check(sequences);
    if (!std::ranges::equal(sequences, tagged, {}, &SupervisedSequence::length, &SupervisedSequence::length))
      throw std::invalid_argument("trackers on different sequences");
  }

  const std::size_t n = trackers.size();
  std::vector<std::vector<double>> overlaps(n), failed(n);
  std::vector<double> accuracy(n), robustness(n);
  for (std::size_t i = 0; i < n; ++i) {
    Pooled pooled = pool(trackers[i], tagged, tag);
    if (pooled.overlaps.empty())
      throw std::invalid_argument("no frame with the tag '" + std::string(tag) + "'");
    accuracy[i] = pooled.accuracy();
    robustness[i] = pooled.failures;
    overlaps[i] = std::move(pooled.overlaps);
    failed[i] = failure_sample(trackers[i], tagged, tag, options.repetitions);
  }

  const std::vector<double> practical =
      options.practical ? practical_differences(tagged, tag) : std::vector<double>();
  Different by_accuracy(n, std::vector<bool>(n)), by_robustness = by_accuracy;
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = i + 1; j < n; ++j) {
      by_accuracy[i][j] = by_accuracy[j][i] =
          accuracy_differs(overlaps[i], overlaps[j], practical, options.significance);
      by_robustness[i][j] = by_robustness[j][i] = rank_sum_p(failed[i], failed[j]) <= options.significance;
    }
  return {adapted_ranks(accuracy, by_accuracy, std::greater()),
          adapted_ranks(robustness, by_robustness, std::less())};
}

ArRanks mean_ar_ranks(std::span<const std::vector<SupervisedSequence>> trackers, const RankOptions& options) {
  if (trackers.empty()) throw std::invalid_argument("no trackers");
  const std::vector<std::string> names = tags(trackers.front());
  if (names.empty()) throw std::invalid_argument("no tags");
  ArRanks mean{std::vector<double>(trackers.size()), std::vector<double>(trackers.size())};
  const auto count = static_cast<double>(names.size());
  for (const std::string& tag : names) {
    const ArRanks ranks = ar_ranks(trackers, tag, options);
    for (std::size_t i = 0; i < trackers.size(); ++i) {
      mean.accuracy[i] += ranks.accuracy[i] / count;
      mean.robustness[i] += ranks.robustness[i] / count;
    }
  }
  return mean;
}

}  // namespace asterism::bench
