// What each choice in DPT is worth: variants of one option each, on annotated sequences, one pass
// and supervised, with start boxes moved by up to a pixel. One line a variant:
//   AO  mean over sequences of the one-pass average overlap      A  supervised accuracy, over all frames
//   F   failures in all sequences, mean over the starts          +- spread of the starts' AO (standard
//   deviation)

#include <CLI/CLI.hpp>
#include <algorithm>
#include <asterism/trackers/coarse.hpp>
#include <asterism/trackers/dpt.hpp>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <mutex>
#include <opencv2/core/utility.hpp>
#include <thread>

#include "scoring.hpp"

namespace {

using namespace asterism;
using namespace asterism::bench;

struct Variant {
  std::string name;
  Start start;
};

// A Kcf of changed options.
template <class Change>
AnyPart filter(Change change) {
  KcfOptions options;
  change(options);
  return Kcf(options);
}

template <class T, class Options>
Start starter(const Options& options) {
  return [options](const Image& image, const Region& object) -> Step {
    auto tracker = std::make_shared<T>(options);
    tracker->init(image.pixels, object.box());
    return [tracker](const Image& frame) {
      return Report{Region::rectangle(tracker->update(frame.pixels).box)};
    };
  };
}

std::vector<Variant> variants() {
  std::vector<Variant> list;
  const auto dpt = [&](const char* name, auto change) {
    DptOptions options;
    change(options);
    list.push_back({name, starter<Dpt>(options)});
  };
  const auto coarse = [&](const char* name, auto change) {
    CoarseOptions options;
    change(options);
    list.push_back({name, starter<CoarseTracker>(options)});
  };
  dpt("dpt", [](DptOptions&) {});
  coarse("coarse layer alone", [](CoarseOptions&) {});
  coarse("coarse, prior 3/8", [](CoarseOptions& o) { o.colour.foreground_prior = 0.375; });
  coarse("root filter alone", [](CoarseOptions& o) {
    o.use_colour = false;
    o.root = filter([](KcfOptions& f) { f.proportional_window = true; });
  });
  dpt("local links", [](DptOptions& o) { o.constellation = Constellation::Local; });
  dpt("star of links", [](DptOptions& o) { o.constellation = Constellation::Star; });
  dpt("no colour", [](DptOptions& o) { o.coarse.use_colour = false; });
  dpt("no MRF", [](DptOptions& o) { o.coarse.colour.mrf.enabled = false; });
  dpt("foreground prior 3/8", [](DptOptions& o) { o.coarse.colour.foreground_prior = 0.375; });
  dpt("no response gate", [](DptOptions& o) { o.response_gate = 0; });
  dpt("no mask gate", [](DptOptions& o) { o.mask_gate = 0; });
  dpt("Euclidean transform", [](DptOptions& o) { o.transform = TransformModel::Euclidean; });
  const auto filters = [&](const char* name, auto change) {
    dpt(name, [&](DptOptions& o) { o.coarse.root = o.part = filter(change); });
  };
  filters("proportional windows", [](KcfOptions& f) { f.proportional_window = true; });
  filters("A updated as a whole", [](KcfOptions& f) { f.separate_update = false; });
  dpt("no sub-pixel peak", [](DptOptions& o) {
    o.coarse.root = o.part = filter([](KcfOptions& f) { f.sub_pixel = false; });
    o.coarse.sub_pixel = false;
  });
  filters("linear kernel", [](KcfOptions& f) { f.kernel.type = Kernel::Type::Linear; });
  dpt("smaller templates", [](DptOptions& o) {
    o.coarse.root = filter([](KcfOptions& f) {
      f.min_template_side = 32;
      f.max_template_side = 64;
    });
    o.part = filter([](KcfOptions& f) {
      f.min_template_side = 25;
      f.max_template_side = 40;
    });
  });
  dpt("5 iterations of IDA", [](DptOptions& o) { o.solver.max_iterations = 5; });
  dpt("3 x 3 parts", [](DptOptions& o) { o.grid_rows = o.grid_cols = 3; });
  return list;
}

/// A variant on one sequence.
struct Figures {
  std::vector<double> overlap_by_start;  // average, one pass
  SupervisedSequence supervised;
};

Figures measure(const Start& start, const Sequence& sequence, const ProtocolOptions& options) {
  SequenceImages images(sequence);
  const auto result = [&](const Run& run) {
    return execute(start, images, run, options, [] { return true; })->trajectory;
  };
  Figures figures;
  for (const Run& run : runs_of(sequence, Protocol::Otb, options))
    figures.overlap_by_start.push_back(
        one_pass_score(std::vector<OnePassSequence>{{{one_pass_run(result(run), sequence)}}})
            .average_overlap);
  for (const Run& run : runs_of(sequence, Protocol::Vot, options))
    figures.supervised.runs.push_back(supervised_run(result(run), sequence, options));
  return figures;
}

}  // namespace

int main(int argc, char** argv) try {
  std::string folder;
  std::vector<std::string> only;
  int starts = 5, threads = static_cast<int>(std::thread::hardware_concurrency());
  CLI::App app("Ablation: what each choice in DPT is worth on annotated sequences");
  app.add_option("folder", folder, "folder of sequences in the VOT layout")
      ->required()
      ->check(CLI::ExistingDirectory);
  app.add_option("--only", only, "only the variants with these names")->delimiter(',');
  app.add_option("--starts", starts, "runs a sequence, all but the first with a moved start box")
      ->check(CLI::Range(1, 1000));
  app.add_option("--threads", threads, "sequences run at once; the figures do not depend on it")
      ->check(CLI::Range(1, 256));
  CLI11_PARSE(app, argc, argv);

  cv::setNumThreads(1);
  const auto sequences = open_dataset(folder);
  ProtocolOptions options;
  options.overlap = OverlapRule::Exact;
  options.boxes = true;
  options.starts = starts;
  std::printf("%-24s %6s %6s %6s %6s\n", "variant", "AO", "+-", "A", "F");
  for (const Variant& variant : variants()) {
    if (!only.empty() && std::ranges::count(only, variant.name) == 0) continue;
    std::vector<Figures> by_sequence(sequences.size());
    std::atomic<std::size_t> next = 0;
    std::exception_ptr failure;
    std::mutex failure_mutex;
    const auto work = [&] {
      try {
        for (std::size_t s; (s = next++) < sequences.size();)
          by_sequence[s] = measure(variant.start, sequences[s], options);
      } catch (...) {
        const std::lock_guard lock(failure_mutex);
        failure = std::current_exception();
      }
    };
    {
      std::vector<std::jthread> pool;
      for (int t = 0; t < threads; ++t) pool.emplace_back(work);
    }
    if (failure) std::rethrow_exception(failure);

    std::vector<double> overlap_by_start(static_cast<std::size_t>(starts));
    std::vector<SupervisedSequence> supervised;
    for (const Figures& figures : by_sequence) {
      for (std::size_t k = 0; k < overlap_by_start.size(); ++k)
        overlap_by_start[k] += figures.overlap_by_start[k] / static_cast<double>(sequences.size());
      supervised.push_back(figures.supervised);
    }
    double mean = 0, variance = 0;
    for (const double ao : overlap_by_start) mean += ao / starts;
    for (const double ao : overlap_by_start) variance += (ao - mean) * (ao - mean) / std::max(1, starts - 1);
    const AccuracyRobustness all = accuracy_robustness(supervised, Toolkit::Legacy);
    std::printf("%-24s %6.3f %6.3f %6.3f %6.1f\n", variant.name.c_str(), mean, std::sqrt(variance),
                all.accuracy, all.failures);
    std::fflush(stdout);
  }
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "asterism-ablation: %s\n", error.what());
  return 1;
}
