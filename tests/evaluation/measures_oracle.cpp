// Reads cases as numbers from standard input and prints their measures, one per line with its name: the
// library's side of measures_oracle.py, which writes the cases.

#include <iomanip>
#include <iostream>
#include <stdexcept>
#include <string>

#include "multi_start_measures.hpp"
#include "one_pass_measures.hpp"
#include "statistics.hpp"
#include "supervised_measures.hpp"

namespace {

using namespace asterism::bench;

template <class T>
T read() {
  std::string word;  // read as a word, as streams do not parse nan
  if (!(std::cin >> word)) throw std::runtime_error("the input ends early");
  if constexpr (std::is_same_v<T, std::string>)
    return word;
  else
    return static_cast<T>(std::stod(word));
}

template <class T>
std::vector<T> read(std::size_t count) {
  std::vector<T> values;
  for (std::size_t i = 0; i < count; ++i) values.push_back(read<T>());
  return values;
}

/// A count, followed by as many values.
template <class T>
std::vector<T> read_list() {
  const auto count = read<std::size_t>();
  return read<T>(count);
}

template <class Values>
void print_all(const std::string& name, const Values& values) {
  std::cout << name;
  for (const auto& value : values) std::cout << ' ' << static_cast<double>(value);
  std::cout << '\n';
}
void print(const std::string& name, std::initializer_list<double> values) { print_all(name, values); }

void print(const std::string& name, const AccuracyRobustness& measures) {
  print(name, {measures.accuracy, measures.failures, measures.failure_rate, measures.reliability()});
}

/// The sequences of each tracker.
std::vector<std::vector<SupervisedSequence>> read_supervised() {
  const auto trackers = read<std::size_t>(), sequences = read<std::size_t>();
  std::vector<std::vector<SupervisedSequence>> result(trackers);
  for (std::size_t s = 0; s < sequences; ++s) {
    SupervisedSequence sequence;
    const auto n = read<std::size_t>(), tag_count = read<std::size_t>();
    for (std::size_t i = 0; i < tag_count; ++i) {
      const auto name = read<std::string>();
      sequence.tags[name] = read<bool>(n);
    }
    sequence.practical_difference = read<double>(n);
    for (auto& tracker : result) {
      sequence.runs.assign(read<std::size_t>(), {});
      for (SupervisedRun& run : sequence.runs) {
        for (const int code : read<int>(n))
          run.outcomes.push_back(code == 0   ? Outcome::Skipped
                                 : code == 1 ? Outcome::Started
                                 : code == 2 ? Outcome::Failed
                                             : Outcome::Tracked);
        run.overlaps = read<double>(n);
      }
      tracker.push_back(sequence);
    }
  }
  return result;
}

void supervised() {
  const auto trackers = read_supervised();
  const LengthInterval interval = {read<std::size_t>(), read<std::size_t>()};
  std::vector<std::string> every_tag = tags(trackers[0]);
  every_tag.emplace_back(kAllFrames);
  for (std::size_t i = 0; i < trackers.size(); ++i) {
    const std::string prefix = "tracker" + std::to_string(i) + ".";
    print(prefix + "python.ar", accuracy_robustness(trackers[i], Toolkit::Python));
    print(prefix + "legacy.mean_over_tags", mean_over_tags(trackers[i]));
    print_all(prefix + "python.curve", eao_curve(trackers[i], Toolkit::Python));
    print(prefix + "python.eao", {eao(trackers[i], interval, Toolkit::Python)});
    for (const std::string& tag : every_tag) {
      print(prefix + "legacy.ar." + tag, accuracy_robustness(trackers[i], Toolkit::Legacy, tag));
      print_all(prefix + "legacy.curve." + tag, eao_curve(trackers[i], Toolkit::Legacy, tag));
      print(prefix + "legacy.eao." + tag, {eao(trackers[i], interval, Toolkit::Legacy, tag)});
    }
  }
  for (const bool practical : {false, true}) {
    const std::string prefix = practical ? "ranks.practical." : "ranks.";
    const auto print_ranks = [&](const std::string& name, const ArRanks& ranks) {
      print_all(prefix + "accuracy." + name, ranks.accuracy);
      print_all(prefix + "robustness." + name, ranks.robustness);
    };
    for (const std::string& tag : every_tag)
      print_ranks(tag, ar_ranks(trackers, tag, {.practical = practical}));
    print_ranks("mean", mean_ar_ranks(trackers, {.practical = practical}));
  }
}

std::vector<OtbBox> read_boxes(std::size_t count) {
  std::vector<OtbBox> boxes(count);
  for (OtbBox& box : boxes) {
    box.left = read<double>();
    box.top = read<double>();
    box.width = read<double>();
    box.height = read<double>();
  }
  return boxes;
}

void one_pass() {
  std::vector<OnePassSequence> sequences(read<std::size_t>());
  for (OnePassSequence& sequence : sequences) {
    sequence.runs.resize(read<std::size_t>());
    for (OnePassRun& run : sequence.runs) {
      const auto n = read<std::size_t>();
      const std::vector<OtbBox> truth = read_boxes(n), result = read_boxes(n);
      run = compare(result, truth);
    }
  }
  const OnePassScore score = one_pass_score(sequences);
  print_all("success", score.success);
  print_all("precision", score.precision);
  print_all("normalised_precision", score.normalised_precision);
  print("scores",
        {score.auc(), score.average_overlap, score.precision_at_20(), score.normalised_precision_at_20()});
}

void temporal() { print_all("starts", temporal_starts(read_list<bool>())); }

void spatial() {
  const OtbBox box = read_boxes(1).front();
  const auto width = read<double>(), height = read<double>();
  for (const OtbBox& start : spatial_starts(box, width, height))
    print("start", {start.left, start.top, start.width, start.height});
}

void multi_start() {
  std::vector<MultiStartSequence> sequences(read<std::size_t>());
  for (MultiStartSequence& sequence : sequences) {
    sequence.length = read<std::size_t>();
    sequence.runs.resize(read<std::size_t>());
    for (AnchorRun& run : sequence.runs) {
      const auto n = read<std::size_t>();
      run.overlaps = read<double>(n);
      run.visible = read<bool>(n);
    }
  }
  const MultiStartScore score = multi_start_score(sequences);
  print("score", {score.accuracy, score.robustness, multi_start_eao(sequences)});
  print_all("curve", multi_start_eao_curve(sequences, kVot2020Lengths.high));
}

void lengths() {
  const TypicalLengths typical = typical_lengths(read_list<std::size_t>());
  std::cout << "lengths " << typical.interval.low << ' ' << typical.interval.high << ' ' << typical.mode
            << '\n';
}

void kde() {
  const std::vector<double> values = read_list<double>(), points = read_list<double>();
  const double bandwidth = kde_bandwidth(values);
  print("bandwidth", {bandwidth});
  for (const double x : points) print("density", {kde_density(values, bandwidth, x)});
}

void percentiles() {
  const std::vector<double> values = read_list<double>();
  const Estimate interval = estimate({0, values}, 0.9);
  print("percentiles", {interval.low, interval.high});
}

}  // namespace

int main() {
  std::cout << std::setprecision(17);
  for (std::string kind; std::cin >> kind;) {
    if (kind == "supervised") supervised();
    if (kind == "one_pass") one_pass();
    if (kind == "temporal") temporal();
    if (kind == "spatial") spatial();
    if (kind == "multi_start") multi_start();
    if (kind == "lengths") lengths();
    if (kind == "kde") kde();
    if (kind == "percentiles") percentiles();
    if (kind == "signed_rank") print("p", {signed_rank_p(read_list<double>())});
    if (kind == "rank_sum") {
      const std::vector<double> a = read_list<double>(), b = read_list<double>();
      print("p", {rank_sum_p(a, b)});
    }
  }
}
