// What each choice in DPT is worth: variants of one option each, on a folder of annotated sequences, one pass
// and supervised, with start boxes moved by up to a pixel. One line a variant:
//   AO  mean over sequences of the one-pass average overlap      A  supervised accuracy, over all frames
//   F   failures in all sequences, mean over the starts          +- spread of the starts' AO (standard
//   deviation)

#include <CLI/CLI.hpp>
#include <asterism/trackers/coarse.hpp>
#include <asterism/trackers/dpt.hpp>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <mutex>
#include <numeric>
#include <opencv2/core/utility.hpp>
#include <thread>

#include "evaluation.hpp"

namespace {

using namespace asterism;
using namespace asterism::bench;

struct Variant {
  std::string name;
  Start start;
};

template <class T, class Options>
Start starter(const Options& options) {
  return [options](const cv::Mat& image, const cv::Rect2d& box) -> Step {
    auto tracker = std::make_shared<T>(options);
    tracker->init(image, box);
    return [tracker](const cv::Mat& frame) { return tracker->update(frame).box; };
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
    o.root.proportional_window = true;
  });
  dpt("local links", [](DptOptions& o) { o.constellation = Constellation::Local; });
  dpt("star of links", [](DptOptions& o) { o.constellation = Constellation::Star; });
  dpt("no colour", [](DptOptions& o) { o.coarse.use_colour = false; });
  dpt("no MRF", [](DptOptions& o) { o.coarse.colour.mrf.enabled = false; });
  dpt("foreground prior 3/8", [](DptOptions& o) { o.coarse.colour.foreground_prior = 0.375; });
  dpt("no response gate", [](DptOptions& o) { o.response_gate = 0; });
  dpt("no mask gate", [](DptOptions& o) { o.mask_gate = 0; });
  dpt("Euclidean transform", [](DptOptions& o) { o.transform = TransformModel::Euclidean; });
  dpt("proportional windows",
      [](DptOptions& o) { o.coarse.root.proportional_window = o.part.proportional_window = true; });
  dpt("A updated as a whole",
      [](DptOptions& o) { o.coarse.root.separate_update = o.part.separate_update = false; });
  dpt("no sub-pixel peak", [](DptOptions& o) { o.coarse.root.sub_pixel = o.part.sub_pixel = false; });
  dpt("linear kernel",
      [](DptOptions& o) { o.coarse.root.kernel.type = o.part.kernel.type = Kernel::Type::Linear; });
  dpt("smaller templates", [](DptOptions& o) {
    o.coarse.root.min_template_side = 32;
    o.coarse.root.max_template_side = 64;
    o.part.min_template_side = 25;
    o.part.max_template_side = 40;
  });
  dpt("5 iterations of IDA", [](DptOptions& o) { o.solver.max_iterations = 5; });
  dpt("3 x 3 parts", [](DptOptions& o) { o.grid_rows = o.grid_cols = 3; });
  return list;
}

struct Figures {
  std::vector<double> overlap_by_start;  // AO
  double accuracy_sum = 0, accuracy_frames = 0, failures = 0;
};

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
  const auto sequences = find_sequences(folder);
  const auto offsets = start_offsets(starts);
  const auto count = static_cast<double>(sequences.size());
  std::printf("%-24s %6s %6s %6s %6s\n", "variant", "AO", "+-", "A", "F");
  for (const Variant& variant : variants()) {
    if (!only.empty() && std::ranges::count(only, variant.name) == 0) continue;
    Figures figures{.overlap_by_start = std::vector<double>(offsets.size())};
    std::vector<Figures> by_sequence(sequences.size(), figures);
    std::atomic<std::size_t> next = 0;
    std::exception_ptr failure;
    std::mutex failure_mutex;
    const auto work = [&] {
      try {
        for (std::size_t s; (s = next++) < sequences.size();) {
          const LoadedSequence sequence = load_sequence(sequences[s]);
          for (std::size_t k = 0; k < offsets.size(); ++k) {
            by_sequence[s].overlap_by_start[k] =
                run_one_pass(variant.start, sequence, offsets[k]).average_overlap();
            const Supervised supervised = run_supervised(variant.start, sequence, offsets[k]);
            by_sequence[s].accuracy_sum +=
                std::accumulate(supervised.overlaps.begin(), supervised.overlaps.end(), 0.0);
            by_sequence[s].accuracy_frames += static_cast<double>(supervised.overlaps.size());
            by_sequence[s].failures += supervised.failures;
          }
        }
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
    // In the order of the sequences, whichever thread was first.
    for (const Figures& one : by_sequence) {
      for (std::size_t k = 0; k < offsets.size(); ++k)
        figures.overlap_by_start[k] += one.overlap_by_start[k] / count;
      figures.accuracy_sum += one.accuracy_sum;
      figures.accuracy_frames += one.accuracy_frames;
      figures.failures += one.failures;
    }
    double mean = 0, variance = 0;
    for (const double ao : figures.overlap_by_start) mean += ao / starts;
    for (const double ao : figures.overlap_by_start)
      variance += (ao - mean) * (ao - mean) / std::max(1, starts - 1);
    std::printf("%-24s %6.3f %6.3f %6.3f %6.1f\n", variant.name.c_str(), mean, std::sqrt(variance),
                figures.accuracy_sum / figures.accuracy_frames, figures.failures / starts);
    std::fflush(stdout);
  }
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "asterism-ablation: %s\n", error.what());
  return 1;
}
