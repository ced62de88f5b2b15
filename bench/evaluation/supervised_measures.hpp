#pragma once

#include <cstddef>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace asterism::bench {

// Measures of VOT2013 to VOT2019, where a tracker is restarted after a failure. Every definition with its
// source: docs/evaluation-measures.md. All throw std::invalid_argument for no sequences, a sequence without
// runs, and lengths that do not match.

/// The outcome of a frame of a run; the VOT toolkit's code in brackets.
enum class Outcome : unsigned char {
  Tracked,  ///< a region, which overlaps the ground truth
  Started,  ///< from the ground truth [1]
  Failed,   ///< without overlap [2]
  Skipped   ///< after a failure, before the next start [0]
};

struct SupervisedRun {
  std::vector<Outcome> outcomes;  ///< of each frame
  std::vector<double>
      overlaps;  ///< as many, in [0, 1]; only those of tracked frames count, there NaN counts as 0
};

/// One tracker's runs on one sequence of n frames, and what the data set says of the frames.
struct SupervisedSequence {
  std::vector<SupervisedRun> runs;
  std::map<std::string, std::vector<bool>, std::less<>> tags;  ///< n each: which frames have the attribute
  std::vector<double> practical_difference;  ///< n overlaps below which a difference means nothing, or none

  std::size_t length() const { return runs.front().outcomes.size(); }
};

/// Whose definitions: those of today's Python toolkit (0.7 and later) or of the MATLAB toolkit that made the
/// tables of VOT2013 to VOT2018 and of the DPT paper.
enum class Toolkit { Python, Legacy };

/// Tags that every sequence has: all frames, and frames without a tag.
inline constexpr std::string_view kAllFrames = "all", kUntagged = "empty";

/// The attributes of the sequences in alphabetical order; "empty" is one of them if sequences have tags and a
/// frame has none.
std::vector<std::string> tags(std::span<const SupervisedSequence> sequences);

struct AccuracyRobustness {
  double accuracy = 0;      ///< mean overlap while the tracker tracks
  double failures = 0;      ///< Python: per sequence, weighted by length. Legacy: in one run of all sequences
  double failure_rate = 0;  ///< failures per frame
  /// Abscissa of the AR plot: the probability of still tracking after `frames` frames.
  double reliability(double frames = 30) const;
};

/// Accuracy and robustness; the first ten frames from a start on do not count for accuracy. Legacy: on the
/// frames with `tag`, 0 if no frame has it. Python has no tags and throws std::invalid_argument for one.
AccuracyRobustness accuracy_robustness(std::span<const SupervisedSequence> sequences, Toolkit toolkit,
                                       std::string_view tag = kAllFrames);

/// Frames from a start on that do not count for accuracy.
inline constexpr std::size_t kBurnIn = 10;

/// The number of frames with `tag` that count for the legacy accuracy; without any, its value of 0 says
/// nothing.
std::size_t accuracy_frames(std::span<const SupervisedSequence> sequences, std::string_view tag = kAllFrames);

/// Mean over all tags of the legacy toolkit's values, each weighted by the number of frames that have it, as
/// its report prints (report_ar.m). Throws std::invalid_argument for sequences without tags.
AccuracyRobustness mean_over_tags(std::span<const SupervisedSequence> sequences);

/// Expected average overlap of a run of i + 1 frames without restarts, as element i. Element 0 has no
/// meaning. Legacy: as long as the longest sequence, NaN where no run with `tag` is so long. Python: as long
/// as the longest run until a failure, without tags.
std::vector<double> eao_curve(std::span<const SupervisedSequence> sequences, Toolkit toolkit,
                              std::string_view tag = kAllFrames);

/// Lengths in frames, both ends included.
struct LengthInterval {
  std::size_t low = 0, high = 0;
};

/// Mean of the curve over an interval, or the part of it that the curve covers; NaN if it covers none. The
/// Python toolkit's interval lies one frame later than stated.
double eao(std::span<const double> curve, const LengthInterval& interval, Toolkit toolkit);
double eao(std::span<const SupervisedSequence> sequences, const LengthInterval& interval, Toolkit toolkit,
           std::string_view tag = kAllFrames);

struct TypicalLengths {
  LengthInterval interval;
  std::size_t mode = 0;  ///< the most typical length
};
/// The legacy toolkit's interval: grown from the mode of the density of the sequences' lengths until it holds
/// half of the mass (analyze_average_expected_overlap.m). Throws std::invalid_argument unless two lengths
/// differ.
TypicalLengths typical_lengths(std::span<const std::size_t> lengths);

struct RankOptions {
  double significance = 0.05;
  std::size_t repetitions =
      15;                 ///< that the toolkit expects; sequences with fewer are filled up with their mean
  bool practical = true;  ///< accuracy must differ by more than the practical difference too, where known
};
/// Of each tracker, 1 is best; trackers that do not differ significantly share the mean of their ranks.
struct ArRanks {
  std::vector<double> accuracy, robustness;
};
/// Ranks as in VOT2014 (analyze_accuracy_robustness.m), by the frames with `tag`: accuracy by the signed-rank
/// test of the frames' mean overlaps, robustness by the rank-sum test of the failures of each sequence and
/// repetition. All trackers have run on the same sequences; tags and practical differences are those of the
/// first.
ArRanks ar_ranks(std::span<const std::vector<SupervisedSequence>> trackers, std::string_view tag = kAllFrames,
                 const RankOptions& options = {});
/// Mean of the ranks over all tags with equal weights: the VOT2014 ranking.
ArRanks mean_ar_ranks(std::span<const std::vector<SupervisedSequence>> trackers,
                      const RankOptions& options = {});

}  // namespace asterism::bench
