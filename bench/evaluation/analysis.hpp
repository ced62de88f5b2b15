#pragma once

#include <array>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "campaign.hpp"
#include "multi_start_measures.hpp"
#include "one_pass_measures.hpp"
#include "statistics.hpp"
#include "supervised_measures.hpp"

namespace asterism::bench {

// All figures of a campaign's report, computed once. Definitions: docs/evaluation-measures.md.

/// The measures that have confidence intervals and by which trackers are compared.
enum class Measure {
  Eao,       ///< of Toolkit::Legacy
  Accuracy,  ///< of Toolkit::Legacy
  Failures,  ///< of Toolkit::Legacy: of one run through all sequences
  Overlap    ///< one pass: mean of the sequences' average overlap
};
inline constexpr Measure kMeasures[] = {Measure::Eao, Measure::Accuracy, Measure::Failures, Measure::Overlap};

/// "EAO", "A", "F", "AO".
std::string_view to_string(Measure measure);

/// One tracker on one sequence. Values that are not measured are NaN.
struct SequenceScores {
  double accuracy = 0, failures = 0;   ///< supervised, mean over the runs; no accuracy if no frame counts
  double average_overlap = 0;          ///< one pass, mean over the runs
  std::vector<double> overlaps;        ///< of each frame of the first supervised run, else of the first pass
  std::vector<std::size_t> failed;     ///< frames of the first supervised run, from 0
  std::vector<double> start_failures;  ///< of each supervised run
};

/// Of Toolkit::Legacy, on the frames with an attribute or in the runs from one start.
struct LegacyScores {
  AccuracyRobustness score;  ///< the accuracy is NaN if no frame counts
  double eao = 0;
};

struct SupervisedScores {
  AccuracyRobustness legacy, python;  ///< the accuracies are NaN if all sequences end within the burn-in
  AccuracyRobustness mean_over_tags;  ///< NaN without tags
  double legacy_eao = 0, python_eao = 0;
  std::vector<double> legacy_curve, python_curve;
  double accuracy_rank = 0, robustness_rank = 0;  ///< on all frames
  /// Mean over the attributes, the VOT2014 ranking; NaN without attributes.
  double mean_accuracy_rank = 0, mean_robustness_rank = 0;
  std::map<std::string, LegacyScores> attributes;
  std::vector<LegacyScores> starts;  ///< of the first run on every sequence, of the second, ...
  /// The same if each sequence has another start, drawn at random; none for a single start.
  std::vector<LegacyScores> mixed_starts;
};

struct MultiStartScores {
  MultiStartScore score;
  double eao = 0;
  std::vector<double> curve;
};

/// Where a tracker did worst on a sequence, in its first run.
struct Loss {
  std::size_t sequence = 0, frame = 0;  ///< frame from 0
  std::optional<Region> region;         ///< the last one that the tracker gave until then
  bool failure = false;                 ///< false: the frame of least overlap
  double overlap = 0;
  /// Frames that a run without restarts would have lost here; below 1 without a failure.
  double cost = 0;
};

struct TrackerScores {
  std::string name;
  bool foreign = false;  ///< not run by this campaign
  std::optional<SupervisedScores> supervised;
  std::map<Protocol, OnePassScore> one_pass;  ///< of Otb, Tre and Sre
  std::optional<MultiStartScores> multi_start;
  std::vector<SequenceScores> sequences;  ///< those of the campaign
  std::map<Measure, Estimate> estimates;  ///< none for a single sequence
  double frames_per_second = 0;  ///< of all supervised runs and one-pass runs of Otb; NaN without times
  std::size_t most_starts = 0;   ///< the most on any sequence, of Vot or Otb
  std::size_t errors = 0;        ///< runs in which it threw
  std::vector<Loss> losses;      ///< at most one per sequence, the greatest cost first
};

/// Tracker a's value minus tracker b's; a and b are indices into Analysis::trackers.
struct Difference {
  Measure measure = Measure::Eao;
  std::size_t a = 0, b = 0;
  Estimate estimate;
  bool significant = false;
};

/// The lengths over which an EAO is the mean, and where they come from.
struct StatedInterval {
  LengthInterval lengths;
  std::string origin;
};

struct Analysis {
  std::vector<TrackerScores> trackers;     ///< best EAO first, then those without one, best AO first
  std::vector<Difference> differences;     ///< of all pairs, measure by measure
  std::vector<std::string> tags;           ///< attributes that any frame has
  bool practical = false;                  ///< whether ranks use practical differences
  StatedInterval supervised, multi_start;  ///< intervals
  std::size_t measured = 0;                ///< sequences that anything can be measured on
  std::vector<std::string> left_out;       ///< what is missing from the figures, a line each
};

/// With fewer sequences no difference is called significant: even one with the same sign on all of them would
/// not pass the sign test at 95 %.
inline constexpr std::size_t kFewestSequences = 6;

struct AnalysisOptions {
  std::optional<LengthInterval> interval = {};  ///< of the supervised EAO; none: from the sequences' lengths
  BootstrapOptions bootstrap = {};
};

/// Scores all results of the campaign, and those of other trackers in its folder results/, which have as many
/// runs on a sequence as there are files. A sequence without ground truth after its first box is left out of
/// all figures and lengths; for each tracker, a protocol without any result is left out. Throws
/// std::runtime_error for a protocol with some runs missing (it says which command makes them), for results
/// that are damaged or of other sequences (it names the file), if there are no results at all, and if nothing
/// can be measured.
Analysis analyse(const Campaign& campaign, const AnalysisOptions& options = {});

}  // namespace asterism::bench
