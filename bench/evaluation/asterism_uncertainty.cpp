// asterism-uncertainty: whether the trackers' stated uncertainty is right, in one pass over annotated
// sequences: how well the confidence predicts that a frame is tracked, and how often the truth lies within
// the region of the covariance.

#include <CLI/CLI.hpp>
#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <asterism/trackers/around/gated.hpp>
#include <asterism/trackers/dpt/dpt.hpp>
#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <numeric>
#include <opencv2/core/utility.hpp>
#include <optional>
#include <string>
#include <vector>

#include "dataset.hpp"
#include "overlap.hpp"
#include "peers.hpp"
#include "run_tool.hpp"
#include "statistics.hpp"

namespace {

using namespace asterism;
using bench::Region;
using bench::Sequence;

// The 95 % quantiles, and the medians, of chi-squared variables with 1, 2 and 3 degrees of freedom.
constexpr double kInside1 = 3.841, kInside2 = 5.991, kInside3 = 7.815;
constexpr double kMedian1 = 0.4549, kMedian2 = 1.3863, kMedian3 = 2.3660;

constexpr char kConfidence[] = "root (confidence)";

/// A tracker's result in a frame.
struct Answer {
  std::optional<Region> region;  // empty: that of the frame before
  std::map<std::string, double> signals;
  std::optional<Eigen::Matrix3d> covariance;
};
using Track = std::function<Answer(const bench::Image&)>;
using Begin = std::function<Track(const bench::Image&, const Region&)>;

/// A frame's result against the ground truth.
struct Outcome {
  double overlap = 0;
  std::map<std::string, double> signals;
  struct Distances {
    double centre, size, all;  // squared Mahalanobis distances
  };
  std::optional<Distances> distances;
};

Begin ours(const std::string& name) {
  return [name](const bench::Image& image, const Region& object) -> Track {
    auto tracker = std::make_shared<AnyTracker>(make_tracker(name));
    tracker->init(image.pixels, object);
    return [tracker](const bench::Image& next) {
      const TrackResult result = tracker->update(next.pixels);
      return Answer{
          Region::rectangle(result.box), {{"confidence", result.confidence}}, std::move(result.covariance)};
    };
  };
}

Begin peer(const std::string& name) {
  return [start = bench::evaluated_tracker(name).start](const bench::Image& image,
                                                        const Region& object) -> Track {
    return [step = start(image, object)](const bench::Image& next) {
      const bench::Report report = step(next);
      if (std::isnan(report.confidence))
        return Answer{report.region, {{"found (boolean)", report.region ? 1.0 : 0.0}}, {}};
      return Answer{report.region, {{"confidence", report.confidence}}, {}};
    };
  };
}

/// Peak-to-sidelobe ratio: the height of a response's peak above the mean of the cells outside the 11 x 11
/// around it, in their standard deviations (Bolme et al., CVPR 2010, Sec. 3.5).
double peak_to_sidelobe(const ResponseMap& response) {
  constexpr Eigen::Index kReach = 5;
  Eigen::Index row = 0, col = 0;
  const auto& values = response.values;
  const double peak = values.maxCoeff(&row, &col);
  const auto apart = [](Eigen::Index a, Eigen::Index b, Eigen::Index n) {
    return std::min(std::abs(a - b), n - std::abs(a - b));
  };
  double count = 0, sum = 0, squares = 0;
  for (Eigen::Index r = 0; r < values.rows(); ++r)
    for (Eigen::Index c = 0; c < values.cols(); ++c) {
      if (apart(r, row, values.rows()) <= kReach && apart(c, col, values.cols()) <= kReach) continue;
      const double value = values(r, c);
      count += 1, sum += value, squares += value * value;
    }
  if (count < 2) return 0;
  const double variance = squares / count - sum * sum / (count * count);
  return variance > 0 ? (peak - sum / count) / std::sqrt(variance) : 0;
}

/// Average peak-to-correlation energy of a response (Wang, Liu and Huang, CVPR 2017).
double peak_to_correlation_energy(const ResponseMap& response) {
  const float peak = response.values.maxCoeff(), least = response.values.minCoeff();
  const double energy = (response.values - least).square().mean();
  return energy > 0 ? (peak - least) * (peak - least) / energy : 0;
}

/// A root part that records the measures of its last response map.
class WatchedRoot {
 public:
  struct Seen {
    double psr = 0, apce = 0;
  };
  explicit WatchedRoot(std::shared_ptr<Seen> seen) : seen_(std::move(seen)) {}

  void init(const Frame& frame, const Point2& centre, const Size2& size) { root_.init(frame, centre, size); }
  Evidence localize(const Frame& frame, const Point2& around) {
    const Evidence evidence = root_.localize(frame, around);
    *seen_ = {peak_to_sidelobe(root_.response()), peak_to_correlation_energy(root_.response())};
    return evidence;
  }
  double similarity_at(const Point2& position) const { return root_.similarity_at(position); }
  void adapt(const Frame& frame, const Point2& at) { root_.adapt(frame, at); }
  void resize(const Size2& size) { root_.resize(size); }
  const ResponseMap& response() const { return root_.response(); }

 private:
  Kcf root_;
  std::shared_ptr<Seen> seen_;
};

/// dpt with signals that might tell whether it tracks; the first, its confidence, is the root's response.
Track candidates(const bench::Image& image, const Region& object) {
  struct Run {
    std::shared_ptr<WatchedRoot::Seen> seen = std::make_shared<WatchedRoot::Seen>();
    std::optional<GatedTracker<Dpt>> tracker;
    Kcf first;  // the root as learned in the first frame, never adapted
    double mean = 0, frames = 0;
  };
  auto run = std::make_shared<Run>();
  DptOptions options;
  options.coarse.root = WatchedRoot(run->seen);
  options.certify = true;
  run->tracker.emplace(Dpt(options));
  run->tracker->init(image.pixels, object);
  const cv::Rect2d box = object.equal_area_box();
  run->first.init(Frame(image.pixels), centre_of(box), {box.width, box.height});
  return [run](const bench::Image& next) {
    TrackResult result = run->tracker->update(next.pixels);
    double parts = 0, weakest = 1, stretch = 0;
    for (const PartState& part : result.parts) {
      parts += part.weight / static_cast<double>(result.parts.size());
      weakest = std::min(weakest, part.weight);
      stretch += (part.position - part.visual_best).squaredNorm() / part.size.prod();
    }
    run->first.resize({result.box.width, result.box.height});
    run->first.localize(Frame(next.pixels), centre_of(result.box));
    const double first = run->first.similarity_at(centre_of(result.box));
    const double root = result.confidence, color = run->tracker->tracker().coarse().evidence().peak;
    const double energy = run->tracker->tracker().summary().final_energy;
    run->mean = (run->mean * run->frames + root) / (run->frames + 1);
    run->frames += 1;
    Answer answer{Region::rectangle(result.box), {}, std::move(result.covariance)};
    answer.signals = {{kConfidence, root},
                      {"root x color", color},
                      {"root's PSR", run->seen->psr},
                      {"root's APCE", run->seen->apce},
                      {"root / its mean", root / run->mean},
                      {"parts' mean", parts},
                      {"weakest part", weakest},
                      {"- spring energy", -energy},
                      {"- stretch of anchors", -stretch},
                      {"root x parts", root * parts},
                      {"root x parts x exp(-energy)", root * parts * std::exp(-energy)},
                      {"root x color x parts", color * parts},
                      {"root x PSR", root * run->seen->psr},
                      {"first frame's root", first},
                      {"root x first", root * first},
                      {"root x first x parts", root * first * parts},
                      {"certified", result.certified.value_or(false) ? 1.0 : 0.0}};
    if (answer.covariance)
      answer.signals["- ln det covariance"] = -std::log(answer.covariance->determinant());
    return answer;
  };
}

std::vector<Outcome> outcomes(const Begin& begin, const Sequence& sequence) {
  std::vector<Outcome> result;
  bench::FrameReader reader(sequence);
  if (!sequence.truth.at(0))
    throw std::runtime_error(sequence.name + ": its first frame has no ground truth");
  Region last = *sequence.truth[0];
  const Track track = begin(bench::Image(reader(0)), last);
  for (std::size_t t = 1; t < sequence.length(); ++t) {
    Answer answer = track(bench::Image(reader(t)));
    if (answer.region) last = *answer.region;
    if (!sequence.truth[t]) continue;
    const cv::Rect2d truth = sequence.truth[t]->equal_area_box(), box = last.box();
    Outcome& outcome = result.emplace_back();
    outcome.overlap = overlap(Region::rectangle(box), Region::rectangle(truth), bench::OverlapRule::Exact);
    outcome.signals = std::move(answer.signals);
    if (!answer.covariance) continue;
    Eigen::Vector3d error;
    error << centre_of(truth) - centre_of(box), std::log(truth.area() / box.area()) / 2;
    const Eigen::Matrix3d& covariance = *answer.covariance;
    outcome.distances = {error.head<2>().dot(covariance.topLeftCorner<2, 2>().ldlt().solve(error.head<2>())),
                         error.z() * error.z() / covariance(2, 2), error.dot(covariance.ldlt().solve(error))};
  }
  return result;
}

using Run = std::vector<std::vector<Outcome>>;  // by sequence and frame

void print_areas(const std::string& name, const Run& run, double threshold) {
  std::vector<std::string> signals;
  const auto any = std::ranges::find_if(run, [](const auto& outcomes) { return !outcomes.empty(); });
  if (any == run.end()) return;
  for (const auto& [signal, value] : any->front().signals) signals.push_back(signal);
  // The baseline of the comparisons comes first.
  std::stable_partition(signals.begin(), signals.end(),
                        [](const std::string& s) { return s == kConfidence; });
  bench::Bootstrapped baseline;
  const std::vector<std::size_t> starts(run.size(), 1);
  for (const std::string& signal : signals) {
    std::vector<std::vector<std::pair<double, bool>>> values(run.size());
    double within = 0, counted = 0;
    for (std::size_t s = 0; s < run.size(); ++s) {
      for (const Outcome& outcome : run[s]) {
        // A frame without the signal ranks as the least certain.
        const auto found = outcome.signals.find(signal);
        values[s].emplace_back(
            found == outcome.signals.end() ? -std::numeric_limits<double>::infinity() : found->second,
            outcome.overlap > threshold);
      }
      const double area = bench::area_under_roc(values[s]);
      if (!std::isnan(area)) within += area, counted += 1;
    }
    const auto pooled = [&](std::span<const bench::Draw> draws) {
      std::vector<std::pair<double, bool>> all;
      for (const bench::Draw& draw : draws)
        all.insert(all.end(), values[draw.sequence].begin(), values[draw.sequence].end());
      return bench::area_under_roc(std::move(all));
    };
    const bench::Bootstrapped areas = bench::bootstrap(starts, pooled, {.resamples = 500});
    if (std::isnan(areas.value)) {
      std::printf("%-14s %-28s -  (no two frames to tell apart)\n", name.c_str(), signal.c_str());
      continue;
    }
    if (signal == signals.front()) baseline = areas;
    const bench::Estimate area = estimate(areas), gain = estimate(difference(areas, baseline));
    std::printf("%-14s %-28s %.3f (%.3f to %.3f)  ", name.c_str(), signal.c_str(), area.value, area.low,
                area.high);
    if (counted > 0) {
      std::printf("%.3f", within / counted);
    } else {
      std::printf("-    ");
    }
    if (signal != signals.front()) std::printf("  %+.3f (%+.3f to %+.3f)", gain.value, gain.low, gain.high);
    std::printf("\n");
  }
}

/// Of squared Mahalanobis distances: the share within the bound, and the factor by which the standard
/// deviations are too small.
std::string coverage(std::vector<double> distances, double bound, double median) {
  if (distances.empty()) return "      -       -";
  const auto inside = std::count_if(distances.begin(), distances.end(), [&](double d) { return d <= bound; });
  const auto middle = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2);
  std::nth_element(distances.begin(), middle, distances.end());
  char text[32];
  std::snprintf(text, sizeof text, "%5.1f %% %7.3f",
                100 * static_cast<double>(inside) / static_cast<double>(distances.size()),
                std::sqrt(*middle / median));
  return text;
}

void print_coverage(const std::string& what, const std::vector<const Outcome*>& frames) {
  std::vector<double> centre, size, all;
  double overlaps = 0;
  for (const Outcome* outcome : frames) {
    overlaps += outcome->overlap / static_cast<double>(frames.size());
    if (!outcome->distances) continue;
    centre.push_back(outcome->distances->centre);
    size.push_back(outcome->distances->size);
    all.push_back(outcome->distances->all);
  }
  std::printf("%-28s %6zu %7.3f | %s | %s | %s\n", what.c_str(), frames.size(), overlaps,
              coverage(centre, kInside2, kMedian2).c_str(), coverage(size, kInside1, kMedian1).c_str(),
              coverage(all, kInside3, kMedian3).c_str());
}

void print_calibration(const std::string& name, const Run& run, const std::vector<Sequence>& sequences,
                       double threshold) {
  std::vector<const Outcome*> all, tracked;
  for (const auto& outcomes : run)
    for (const Outcome& outcome : outcomes) {
      all.push_back(&outcome);
      if (outcome.overlap > threshold) tracked.push_back(&outcome);
    }
  if (std::none_of(all.begin(), all.end(), [](const Outcome* o) { return o->distances.has_value(); })) return;
  std::printf("\n%-28s %6s %7s | %15s | %15s | %15s\n", name.c_str(), "frames", "overlap", "centre", "size",
              "both");
  print_coverage("all frames", all);
  print_coverage("tracked frames", tracked);
  for (std::size_t s = 0; s < run.size(); ++s) {
    std::vector<const Outcome*> frames;
    for (const Outcome& outcome : run[s])
      if (outcome.overlap > threshold) frames.push_back(&outcome);
    print_coverage("  " + sequences[s].name, frames);
  }
}

}  // namespace

int main(int argc, char** argv) {
  std::string dataset;
  std::vector<std::string> names{"dpt", "kalman", "opencv-csrt", "dlib"}, only;
  double threshold = 0.1;
  bool signals = false;
  CLI::App app(
      "Measures how well trackers estimate their own errors, in one pass over sequences. First the area "
      "under "
      "the ROC curve of their confidence, as a classifier of frames with and without overlap: for all frames "
      "together, with a 95 % interval from a bootstrap over sequences; as a mean over the sequences that "
      "have "
      "both kinds of frames; and, for other signals of dpt, the difference from its confidence. Then how "
      "often "
      "the truth is in the 95 % region of their covariance, and the factor by which its deviations would "
      "have "
      "to be larger for half of the frames to be in the 50 % region.",
      "asterism-uncertainty");
  app.add_option("DATASET", dataset, "a sequence, or a folder of sequences")->required();
  app.add_option("--trackers", names, "names that asterism-eval knows, or descriptions")
      ->capture_default_str();
  app.add_option("--overlap", threshold, "a frame with a greater overlap counts as tracked")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
  app.add_flag("--signals", signals, "also print all other signals that could serve as dpt's confidence");
  app.add_option("--sequences", only, "only these, separated by commas")->delimiter(',');
  return asterism::tools::run_tool(app, argc, argv, [&] {
    cv::setNumThreads(1);
    const std::vector<std::string> own = tracker_names();
    const auto begin_of = [&](const std::string& name) {
      bench::evaluated_tracker(name);  // throws for unknown ones
      const std::string base = name.substr(0, name.find_first_of("{+"));
      return std::find(own.begin(), own.end(), base) != own.end() || base.empty() ? ours(name) : peer(name);
    };
    std::vector<std::pair<std::string, Begin>> trackers;
    for (const std::string& name : names) trackers.emplace_back(name, begin_of(name));
    if (signals) trackers.emplace_back("dpt's signals", candidates);
    const bench::Dataset data = bench::open_dataset(dataset, bench::Layout::Auto, only);
    print_notes(data);
    const std::vector<Sequence>& sequences = data.sequences;

    std::vector<Run> runs;
    for (const auto& [name, begin] : trackers) {
      Run& run = runs.emplace_back();
      for (const Sequence& sequence : sequences) run.push_back(outcomes(begin, sequence));
      print_areas(name, run, threshold);
      std::fflush(stdout);
    }
    for (std::size_t i = 0; i < runs.size(); ++i)
      print_calibration(trackers[i].first, runs[i], sequences, threshold);
  });
}
