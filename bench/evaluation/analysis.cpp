#include "analysis.hpp"

#include <algorithm>
#include <cmath>
#include <exception>
#include <future>
#include <numeric>
#include <random>
#include <set>
#include <stdexcept>
#include <tuple>

#include "scoring.hpp"
#include "text.hpp"

namespace asterism::bench {
namespace {

namespace fs = std::filesystem;

/// accuracy_robustness, with NaN for the accuracy if every sequence ends within the burn-in.
AccuracyRobustness score_of(std::span<const SupervisedSequence> sequences, Toolkit toolkit) {
  AccuracyRobustness score = accuracy_robustness(sequences, toolkit);
  const auto is_short = [](const SupervisedSequence& sequence) { return sequence.length() <= kBurnIn; };
  if (std::ranges::all_of(sequences, is_short)) score.accuracy = kNone;
  return score;
}

/// A tracker's scores and measured runs. Each protocol has the sequences with runs of it, in the campaign's
/// order.
struct TrackerRuns {
  TrackerScores scores;
  std::vector<SupervisedSequence> supervised;
  std::map<Protocol, std::vector<OnePassSequence>> one_pass;
  std::vector<MultiStartSequence> multi_start;
  Timing timing;
};

/// The command that makes the missing runs of a tracker.
std::string command_for(const Campaign& campaign, const std::string& tracker, Protocol protocol) {
  const ProtocolOptions& options = campaign.options;
  const ProtocolOptions usual;
  const std::string& known = campaign.trackers.at(tracker);
  std::string command = "asterism-eval run " + shell_quoted(campaign.dataset.string());
  if (campaign.layout != Layout::Auto) command += " --layout " + std::string(to_string(campaign.layout));
  if (known.starts_with("trax:")) {
    command += " --external " + shell_quoted(tracker + "=" + known.substr(5));
  } else if (known == tracker) {
    command += " --trackers " + tracker;
  } else {
    command += " --tracker " + shell_quoted(tracker + "=" + known);
  }
  command += " --protocol " + std::string(to_string(protocol));
  command += " --sequences ";
  for (std::size_t s = 0; s < campaign.sequences.size(); ++s)
    command += (s > 0 ? "," : "") + campaign.sequences[s].name;
  const auto add = [&](const std::string& option, auto value, auto otherwise) {
    if (value != otherwise) command += " --" + option + " " + Json(value).dump();
  };
  add("starts", options.starts, usual.starts);
  add("jitter", options.jitter, usual.jitter);
  add("seed", options.seed, usual.seed);
  if (options.overlap != usual.overlap) command += " --overlap " + std::string(to_string(options.overlap));
  add("jpeg", options.jpeg, usual.jpeg);
  if (options.bounded) command += " --bounded";
  if (options.boxes) command += " --boxes";
  return command + " --out " + shell_quoted(campaign.folder.string());
}

/// The runs to read: for a tracker that this campaign did not run, as many as there are files.
std::vector<Run> expected_runs(const Campaign& campaign, const TrackerScores& tracker,
                               const Sequence& sequence, Protocol protocol) {
  ProtocolOptions options = campaign.options;
  if (tracker.foreign && (protocol == Protocol::Vot || protocol == Protocol::Otb)) {
    options.starts = 1;  // reported as missing if there is no file
    const auto next = [&] { return Run{.protocol = protocol, .number = options.starts + 1, .offset = {}}; };
    while (trajectory_exists(campaign.file(tracker.name, sequence, next()))) ++options.starts;
  }
  return runs_of(sequence, protocol, options);
}

/// Where the supervised run did worst: its first failure, or without one the frame of least overlap.
Loss worst(const Trajectory& trajectory, const SupervisedRun& run) {
  Loss loss;
  std::optional<Region> last;
  for (std::size_t t = 0; t < run.outcomes.size(); ++t) {
    if (run.outcomes[t] == Outcome::Failed) {
      const auto cost = static_cast<double>(run.outcomes.size() - t);
      return {.frame = t, .region = last, .failure = true, .cost = cost};
    }
    last = trajectory.frames[t].region;
    if (run.outcomes[t] == Outcome::Tracked && 1 - run.overlaps[t] > loss.cost)
      loss = {.frame = t, .region = last, .overlap = run.overlaps[t], .cost = 1 - run.overlaps[t]};
  }
  return loss;
}

/// The same for a run without corrections, the first of whose frames is frame `skipped` of the trajectory.
Loss worst(const Trajectory& trajectory, const OnePassRun& run, std::size_t skipped) {
  Loss loss;
  for (std::size_t t = 0; t < run.overlaps.size(); ++t) {
    if (run.overlaps[t] < 0 || 1 - run.overlaps[t] <= loss.cost) continue;
    loss = {.frame = skipped + t,
            .region = trajectory.frames[skipped + t].region,
            .overlap = run.overlaps[t],
            .cost = 1 - run.overlaps[t]};
  }
  return loss;
}

/// Whether anything can be measured: a region after the first, which is the start.
bool is_measured(const Sequence& sequence) {
  return std::ranges::count_if(sequence.truth, [](const auto& truth) { return truth.has_value(); }) > 1;
}

/// A note about the sequences on which nothing can be measured; empty if there are none.
std::string unmeasured_text(const Campaign& campaign) {
  constexpr std::size_t kNamed = 5;
  std::vector<std::string> names;
  for (const Sequence& sequence : campaign.sequences)
    if (!is_measured(sequence)) names.push_back(sequence.name);
  if (names.empty()) return {};
  std::string text;
  for (std::size_t i = 0; i < std::min(names.size(), kNamed); ++i) text += (i > 0 ? ", " : "") + names[i];
  if (names.size() > kNamed) text += " and " + std::to_string(names.size() - kNamed) + " others";
  return text + ": no ground truth after the first box, so that nothing is measured";
}

/// Reads the results of one tracker, each once.
class Reader {
 public:
  /// `images`: the size of each sequence's images, if overlaps are bounded.
  Reader(const Campaign& campaign, const std::vector<std::optional<cv::Size>>& images)
      : campaign_(campaign), images_(images) {}

  TrackerRuns read(const std::string& name, std::vector<std::string>& left_out) {
    TrackerRuns tracker;
    tracker.scores.name = name;
    tracker.scores.foreign = !campaign_.trackers.contains(name);
    tracker.scores.sequences.assign(campaign_.sequences.size(), {kNone, kNone, kNone, {}, {}, {}});
    for (const Protocol protocol : kProtocols) {
      if (has_any(tracker.scores, protocol))
        read(tracker, protocol);
      else if (std::ranges::count(campaign_.protocols, protocol) > 0)
        left_out.push_back(name + " has no results of " + std::string(to_string(protocol)));
    }
    tracker.scores.frames_per_second = tracker.timing.frames_per_second();
    std::ranges::stable_sort(tracker.scores.losses, std::greater(), &Loss::cost);
    return tracker;
  }

 private:
  bool has_any(const TrackerScores& tracker, Protocol protocol) const {
    if (!fs::exists(campaign_.folder / "results" / tracker.name / experiment_name(protocol))) return false;
    return std::ranges::any_of(campaign_.sequences, [&](const Sequence& sequence) {
      return is_measured(sequence) &&
             std::ranges::any_of(expected_runs(campaign_, tracker, sequence, protocol), [&](const Run& run) {
               return trajectory_exists(campaign_.file(tracker.name, sequence, run));
             });
    });
  }

  void read(TrackerRuns& tracker, Protocol protocol) {
    for (std::size_t s = 0; s < campaign_.sequences.size(); ++s) {
      const Sequence& sequence = campaign_.sequences[s];
      if (!is_measured(sequence)) continue;
      const std::vector<Run> runs = expected_runs(campaign_, tracker.scores, sequence, protocol);
      if (runs.empty()) continue;
      if (protocol == Protocol::Vot)
        read_supervised(tracker, s, runs);
      else if (protocol == Protocol::MultiStart)
        read_multi_start(tracker, s, runs);
      else
        read_one_pass(tracker, s, runs);
      if (protocol == Protocol::Vot || protocol == Protocol::Otb)
        tracker.scores.most_starts = std::max(tracker.scores.most_starts, runs.size());
    }
  }

  void read_supervised(TrackerRuns& tracker, std::size_t s, const std::vector<Run>& runs) {
    const Sequence& sequence = campaign_.sequences[s];
    SequenceScores& scores = tracker.scores.sequences[s];
    std::vector<SupervisedRun> read;
    for (const Run& run : runs)
      with(tracker, sequence, run, [&](const Trajectory& trajectory) {
        read.push_back(supervised_run(trajectory, sequence, campaign_.options, images_[s]));
        tracker.timing += timing(trajectory);
        if (read.size() > 1) return;
        add(tracker.scores.losses, worst(trajectory, read.front()), s);
        scores.overlaps = read.front().overlaps;
        for (std::size_t t = 0; t < sequence.length(); ++t)
          if (read.front().outcomes[t] == Outcome::Failed) scores.failed.push_back(t);
      });
    tracker.supervised.push_back(supervised_sequence(sequence, std::move(read)));
    const std::span one(&tracker.supervised.back(), 1);
    const auto score = accuracy_robustness(one, Toolkit::Legacy);
    if (accuracy_frames(one) > 0) scores.accuracy = score.accuracy;
    scores.failures = score.failures;
    for (const SupervisedRun& run : one.front().runs)
      scores.start_failures.push_back(static_cast<double>(std::ranges::count(run.outcomes, Outcome::Failed)));
  }

  void read_one_pass(TrackerRuns& tracker, std::size_t s, const std::vector<Run>& runs) {
    const Sequence& sequence = campaign_.sequences[s];
    const Protocol protocol = runs.front().protocol;
    SequenceScores& scores = tracker.scores.sequences[s];
    OnePassSequence read;
    for (const Run& run : runs)
      with(tracker, sequence, run, [&](const Trajectory& trajectory) {
        read.runs.push_back(one_pass_run(trajectory, sequence, campaign_.options));
        if (protocol != Protocol::Otb) return;
        tracker.timing += timing(trajectory);
        if (!scores.overlaps.empty()) return;
        const std::size_t skipped = sequence.length() - read.runs.front().overlaps.size();
        add(tracker.scores.losses, worst(trajectory, read.runs.front(), skipped), s);
        scores.overlaps.assign(skipped, kNone);
        for (const double overlap : read.runs.front().overlaps)
          scores.overlaps.push_back(overlap < 0 ? kNone : overlap);
      });
    const double average_overlap = one_pass_score(std::span(&read, 1)).average_overlap;
    if (std::isnan(average_overlap)) return;  // no box that is valid to OTB
    if (protocol == Protocol::Otb) scores.average_overlap = average_overlap;
    tracker.one_pass[protocol].push_back(std::move(read));
  }

  void read_multi_start(TrackerRuns& tracker, std::size_t s, const std::vector<Run>& runs) {
    const Sequence& sequence = campaign_.sequences[s];
    MultiStartSequence read{.length = sequence.length(), .runs = {}};
    for (const Run& run : runs)
      with(tracker, sequence, run, [&](const Trajectory& trajectory) {
        read.runs.push_back(anchor_run(trajectory, sequence, run, campaign_.options, images_[s]));
      });
    tracker.multi_start.push_back(std::move(read));
  }

  static void add(std::vector<Loss>& losses, Loss loss, std::size_t sequence) {
    loss.sequence = sequence;
    if (loss.cost > 0) losses.push_back(std::move(loss));
  }

  /// Scores a result; errors name its file.
  template <class Score>
  void with(TrackerRuns& tracker, const Sequence& sequence, const Run& run, const Score& score) const {
    const std::string& name = tracker.scores.name;
    const fs::path file = campaign_.file(name, sequence, run);
    if (!trajectory_exists(file)) {
      const std::string remedy = tracker.scores.foreign ? "results of others need one of every sequence"
                                                        : "the results are not whole; they are by " +
                                                              command_for(campaign_, name, run.protocol);
      throw std::runtime_error("no " + file.string() + ": " + remedy);
    }
    if (fs::exists(campaign_.errors_file(name, sequence, run))) ++tracker.scores.errors;
    const Trajectory trajectory = read_trajectory(file);  // its errors name file and line
    try {
      score(trajectory);
    } catch (const std::exception& error) {
      throw std::runtime_error(file.string() + ": " + error.what());
    }
  }

  const Campaign& campaign_;
  const std::vector<std::optional<cv::Size>>& images_;
};

/// The trackers of the campaign and the other folders in its results, in alphabetical order.
std::set<std::string> names_of_trackers(const Campaign& campaign, std::vector<std::string>& left_out) {
  std::set<std::string> names;
  for (const auto& [name, tracker] : campaign.trackers) names.insert(name);
  const fs::path results = campaign.folder / "results";
  if (!fs::exists(results)) return names;
  for (const auto& entry : fs::directory_iterator(results)) {
    const std::string name = entry.path().filename().string();
    if (!entry.is_directory()) continue;
    if (is_utf8(name))
      names.insert(name);
    else
      left_out.push_back(printable(entry.path().string()) + ": the name is not UTF-8: rename it");
  }
  return names;
}

StatedInterval typical_interval(const Campaign& campaign) {
  std::vector<std::size_t> lengths;
  for (const Sequence& sequence : campaign.sequences)
    if (is_measured(sequence)) lengths.push_back(sequence.length());
  const auto [shortest, longest] = std::ranges::minmax(lengths);
  if (shortest == longest) return {{longest, longest}, "the length of all sequences"};
  return {typical_lengths(lengths).interval, "by the density of the lengths of these sequences"};
}

/// VOT2020's interval if a sequence is that long. The toolkit's lower number is one less than the length.
StatedInterval multi_start_interval(const Campaign& campaign, const StatedInterval& typical) {
  std::size_t longest = 0;
  for (const Sequence& sequence : campaign.sequences)
    if (is_measured(sequence)) longest = std::max(longest, sequence.length());
  if (longest < kVot2020Lengths.high) return typical;
  return {{kVot2020Lengths.low + 1, kVot2020Lengths.high}, "VOT2020's, 115:755 as its toolkit counts"};
}

/// Drops attributes that no frame has.
void drop_unused_tags(std::vector<TrackerRuns>& trackers) {
  std::set<std::string, std::less<>> used;
  for (const TrackerRuns& tracker : trackers)
    for (const SupervisedSequence& sequence : tracker.supervised)
      for (const auto& [tag, frames] : sequence.tags)
        if (std::ranges::count(frames, true) > 0) used.insert(tag);
  for (TrackerRuns& tracker : trackers)
    for (SupervisedSequence& sequence : tracker.supervised)
      std::erase_if(sequence.tags, [&](const auto& entry) { return !used.contains(entry.first); });
}

/// The scores with one run on each sequence.
void score_starts(const std::vector<SupervisedSequence>& sequences, const LengthInterval& interval,
                  SupervisedScores& scores) {
  constexpr std::size_t kMixed = 200;
  std::size_t starts = sequences.front().runs.size();
  for (const SupervisedSequence& sequence : sequences) starts = std::min(starts, sequence.runs.size());
  const auto score = [&](const auto& start_of) {
    std::vector<Draw> draws;
    for (std::size_t s = 0; s < sequences.size(); ++s) draws.push_back({s, {start_of(s)}});
    const auto drawn = resampled(sequences, draws);
    return LegacyScores{score_of(drawn, Toolkit::Legacy), eao(drawn, interval, Toolkit::Legacy)};
  };
  for (std::size_t start = 0; start < starts; ++start)
    scores.starts.push_back(score([&](std::size_t) { return start; }));
  std::mt19937 random;
  for (std::size_t i = 0; starts > 1 && i < kMixed; ++i)
    scores.mixed_starts.push_back(score([&](std::size_t) { return random() % starts; }));
}

void score_supervised(std::vector<TrackerRuns>& trackers, Analysis& analysis) {
  std::vector<std::vector<SupervisedSequence>> all;
  std::vector<std::size_t> numbers;
  for (std::size_t i = 0; i < trackers.size(); ++i) {
    if (trackers[i].supervised.empty()) continue;
    all.push_back(trackers[i].supervised);
    numbers.push_back(i);
  }
  if (all.empty()) return;
  analysis.tags = tags(all.front());
  analysis.practical = std::ranges::none_of(
      all.front(), [](const auto& sequence) { return sequence.practical_difference.empty(); });
  const ArRanks ranks = ar_ranks(all);
  const std::vector<double> none(all.size(), kNone);
  const ArRanks mean_ranks = analysis.tags.empty() ? ArRanks{none, none} : mean_ar_ranks(all);
  const LengthInterval& interval = analysis.supervised.lengths;
  for (std::size_t i = 0; i < all.size(); ++i) {
    SupervisedScores scores;
    scores.legacy = score_of(all[i], Toolkit::Legacy);
    scores.python = score_of(all[i], Toolkit::Python);
    scores.mean_over_tags =
        analysis.tags.empty() ? AccuracyRobustness{kNone, kNone, kNone} : mean_over_tags(all[i]);
    scores.legacy_curve = eao_curve(all[i], Toolkit::Legacy);
    scores.python_curve = eao_curve(all[i], Toolkit::Python);
    scores.legacy_eao = eao(scores.legacy_curve, interval, Toolkit::Legacy);
    scores.python_eao = eao(scores.python_curve, interval, Toolkit::Python);
    scores.accuracy_rank = ranks.accuracy[i];
    scores.robustness_rank = ranks.robustness[i];
    scores.mean_accuracy_rank = mean_ranks.accuracy[i];
    scores.mean_robustness_rank = mean_ranks.robustness[i];
    for (const std::string& tag : analysis.tags) {
      LegacyScores& attribute = scores.attributes[tag];
      attribute = {accuracy_robustness(all[i], Toolkit::Legacy, tag),
                   eao(all[i], interval, Toolkit::Legacy, tag)};
      if (accuracy_frames(all[i], tag) == 0) attribute.score.accuracy = kNone;
    }
    score_starts(all[i], interval, scores);
    trackers[numbers[i]].scores.supervised = std::move(scores);
  }
}

void score_the_rest(TrackerRuns& tracker, const LengthInterval& multi_start) {
  for (const auto& [protocol, sequences] : tracker.one_pass)
    tracker.scores.one_pass[protocol] = one_pass_score(sequences);
  if (tracker.multi_start.empty()) return;
  tracker.scores.multi_start = {multi_start_score(tracker.multi_start),
                                multi_start_eao(tracker.multi_start, {multi_start.low - 1, multi_start.high}),
                                multi_start_eao_curve(tracker.multi_start, multi_start.high)};
}

/// Repeats the runs on each sequence, in their order, up to the given numbers, so that all trackers can share
/// the same bootstrap draws.
template <class Sequence>
std::vector<Sequence> filled_up(std::vector<Sequence> sequences, const std::vector<std::size_t>& starts) {
  for (std::size_t s = 0; s < sequences.size(); ++s) {
    auto& runs = sequences[s].runs;
    const std::size_t had = runs.size();
    for (std::size_t r = had; r < starts[s]; ++r) runs.push_back(runs[r % had]);
  }
  return sequences;
}

/// The most runs that any tracker has on each sequence; empty if no tracker has runs.
template <class SequencesOf>
std::vector<std::size_t> most_runs(const std::vector<TrackerRuns>& trackers,
                                   const SequencesOf& sequences_of) {
  std::vector<std::size_t> most;
  for (const TrackerRuns& tracker : trackers) {
    const auto& sequences = sequences_of(tracker);
    most.resize(std::max(most.size(), sequences.size()));
    for (std::size_t s = 0; s < sequences.size(); ++s) most[s] = std::max(most[s], sequences[s].runs.size());
  }
  return most;
}

using Resampled = std::map<Measure, Bootstrapped>;

/// The measures of a tracker on the same resamples as all others; none for a single sequence, of which every
/// resample would be the same.
Resampled resample(const TrackerRuns& tracker, const std::vector<std::size_t>& supervised_starts,
                   const std::vector<std::size_t>& one_pass_starts, const LengthInterval& interval,
                   const BootstrapOptions& options) {
  Resampled result;
  if (tracker.supervised.size() > 1) {
    auto sequences = filled_up(tracker.supervised, supervised_starts);
    for (SupervisedSequence& sequence : sequences) {  // these would be copied with every draw
      sequence.tags.clear();
      sequence.practical_difference.clear();
    }
    Bootstrapped accuracies, failures;
    const auto all_three = [&](std::span<const Draw> draws) {
      const auto drawn = resampled(sequences, draws);
      const auto [accuracy, failed, rate] = accuracy_robustness(drawn, Toolkit::Legacy);
      accuracies.resamples.push_back(accuracy);
      failures.resamples.push_back(failed);
      return eao(drawn, interval, Toolkit::Legacy);
    };
    result[Measure::Eao] = bootstrap(supervised_starts, all_three, options);
    // The first draw is the data themselves.
    for (Bootstrapped* measure : {&accuracies, &failures}) {
      measure->value = measure->resamples.front();
      measure->resamples.erase(measure->resamples.begin());
    }
    if (!std::isnan(score_of(sequences, Toolkit::Legacy).accuracy))
      result[Measure::Accuracy] = std::move(accuracies);
    result[Measure::Failures] = std::move(failures);
  }
  if (const auto passes = tracker.one_pass.find(Protocol::Otb);
      passes != tracker.one_pass.end() && passes->second.size() > 1) {
    std::vector<std::vector<double>> overlaps;
    for (const OnePassSequence& sequence : filled_up(passes->second, one_pass_starts)) {
      std::vector<double>& of_sequence = overlaps.emplace_back();
      for (const OnePassRun& run : sequence.runs) {
        const OnePassSequence single{{run}};
        of_sequence.push_back(one_pass_score(std::span(&single, 1)).average_overlap);
      }
    }
    const auto overlap = [&](std::span<const Draw> draws) { return mean(overlaps, draws); };
    result[Measure::Overlap] = bootstrap(one_pass_starts, overlap, options);
  }
  // NaN: the data do not reach the interval of lengths.
  std::erase_if(result, [](const auto& entry) { return std::isnan(entry.second.value); });
  return result;
}

void compare(std::vector<TrackerRuns>& trackers, Analysis& analysis, const BootstrapOptions& options) {
  const auto supervised_starts = most_runs(
      trackers, [](const TrackerRuns& tracker) -> const auto& { return tracker.supervised; });
  const std::vector<OnePassSequence> none;
  const auto one_pass_starts = most_runs(
      trackers, [&](const TrackerRuns& tracker) -> const auto& {
        const auto found = tracker.one_pass.find(Protocol::Otb);
        return found == tracker.one_pass.end() ? none : found->second;
      });
  std::vector<std::future<Resampled>> at_work;
  for (const TrackerRuns& tracker : trackers)
    at_work.push_back(std::async(std::launch::async, [&] {
      return resample(tracker, supervised_starts, one_pass_starts, analysis.supervised.lengths, options);
    }));
  std::vector<Resampled> resamples;
  for (std::size_t i = 0; i < trackers.size(); ++i) {
    resamples.push_back(at_work[i].get());
    for (const auto& [measure, values] : resamples.back())
      trackers[i].scores.estimates[measure] = estimate(values);
  }
  for (const Measure measure : kMeasures) {
    const std::size_t sequences =
        measure == Measure::Overlap ? one_pass_starts.size() : supervised_starts.size();
    for (std::size_t a = 0; a < trackers.size(); ++a)
      for (std::size_t b = a + 1; b < trackers.size(); ++b) {
        if (!resamples[a].contains(measure) || !resamples[b].contains(measure)) continue;
        const Estimate by = estimate(difference(resamples[a][measure], resamples[b][measure]));
        analysis.differences.push_back(
            {measure, a, b, by, sequences >= kFewestSequences && by.excludes_zero()});
      }
  }
}

/// The sort key of trackers: those with an EAO come first.
std::tuple<double, double> merit(const TrackerRuns& tracker) {
  const TrackerScores& scores = tracker.scores;
  const auto known = [](double value) { return std::isnan(value) ? -1 : value; };
  const auto pass = scores.one_pass.find(Protocol::Otb);
  return {scores.supervised ? known(scores.supervised->legacy_eao) : -1,
          pass != scores.one_pass.end() ? known(pass->second.average_overlap) : -1};
}

}  // namespace

std::string_view to_string(Measure measure) {
  switch (measure) {
    case Measure::Eao:
      return "EAO";
    case Measure::Accuracy:
      return "A";
    case Measure::Failures:
      return "F";
    case Measure::Overlap:
      return "AO";
  }
  return {};
}

Analysis analyse(const Campaign& campaign, const AnalysisOptions& options) {
  Analysis analysis;
  analysis.left_out = unreadable_lines(campaign.unreadable);
  analysis.measured = static_cast<std::size_t>(std::ranges::count_if(campaign.sequences, is_measured));
  if (const std::string text = unmeasured_text(campaign); !text.empty()) analysis.left_out.push_back(text);
  for (const Sequence& sequence : campaign.sequences)
    for (const Protocol protocol : campaign.protocols)
      if (const std::string line = reason_for_no_run(sequence, protocol, campaign.options);
          is_measured(sequence) && !line.empty())
        analysis.left_out.push_back(line);
  if (analysis.measured == 0)
    throw std::runtime_error(campaign.dataset.string() + ": " +
                             (analysis.left_out.empty() ? "no sequences" : analysis.left_out.front()) +
                             "; the server of GOT-10k measures what asterism-eval export-got10k writes");
  std::vector<std::optional<cv::Size>> images(campaign.sequences.size());
  if (campaign.options.bounded)
    for (std::size_t s = 0; s < images.size(); ++s) images[s] = FrameReader(campaign.sequences[s])(0).size();

  std::vector<TrackerRuns> trackers;
  Reader reader(campaign, images);
  for (const std::string& name : names_of_trackers(campaign, analysis.left_out)) {
    std::vector<std::string> left_out;
    TrackerRuns tracker = reader.read(name, left_out);
    const bool any = !tracker.supervised.empty() || !tracker.one_pass.empty() || !tracker.multi_start.empty();
    if (!any && tracker.scores.foreign) continue;  // the folder is not a tracker's
    analysis.left_out.insert(analysis.left_out.end(), left_out.begin(), left_out.end());
    if (any) trackers.push_back(std::move(tracker));
  }
  if (trackers.empty()) throw std::runtime_error("no results in " + (campaign.folder / "results").string());

  const StatedInterval typical = typical_interval(campaign);
  analysis.supervised = options.interval ? StatedInterval{*options.interval, "as asked for"} : typical;
  analysis.multi_start = multi_start_interval(campaign, typical);
  drop_unused_tags(trackers);
  score_supervised(trackers, analysis);
  for (TrackerRuns& tracker : trackers) score_the_rest(tracker, analysis.multi_start.lengths);
  std::ranges::stable_sort(trackers, std::greater(), merit);
  compare(trackers, analysis, options.bootstrap);
  for (TrackerRuns& tracker : trackers) analysis.trackers.push_back(std::move(tracker.scores));
  return analysis;
}

}  // namespace asterism::bench
