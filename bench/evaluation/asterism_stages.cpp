// asterism-stages: how long the stages of our trackers take per frame, and how good their lost flag is, in
// one pass over annotated sequences on one thread.

#include <CLI/CLI.hpp>
#include <asterism/trackers/tracker/tracker.hpp>
#include <cstdio>
#include <map>
#include <memory>
#include <opencv2/core/utility.hpp>
#include <string>
#include <vector>

#include "protocols.hpp"
#include "run_tool.hpp"

namespace {

using namespace asterism::bench;

/// A tracker's diagnostics over all frames.
struct Diagnostics {
  std::map<std::string, double> stage_milliseconds;
  std::vector<bool> lost;  // one per frame
  double parts = 0;        // summed over all frames
};

Start told(const std::string& name, Diagnostics& diagnostics) {
  return [name, &diagnostics](const Image& image, const Region& object) -> Step {
    auto tracker = std::make_shared<asterism::AnyTracker>(asterism::make_tracker(name));
    tracker->init(image.pixels, object);
    return [tracker, &diagnostics](const Image& frame) {
      const asterism::TrackResult result = tracker->update(frame.pixels);
      for (const asterism::StageTime& time : result.times)
        diagnostics.stage_milliseconds[std::string(time.stage)] += time.milliseconds;
      diagnostics.lost.push_back(result.lost);
      diagnostics.parts += static_cast<double>(result.parts.size());
      return Report{Region::rectangle(result.box)};
    };
  };
}

void report(const std::string& name, const std::vector<Sequence>& sequences) {
  ProtocolOptions options;
  options.boxes = true;
  Diagnostics diagnostics;
  const Start start = told(name, diagnostics);
  std::vector<bool> off;  // one per frame: no overlap with the ground truth
  for (const Sequence& sequence : sequences) {
    SequenceImages images(sequence);
    for (const Run& run : runs_of(sequence, Protocol::Otb, options)) {
      const auto result = execute(start, images, run, options, [] { return true; });
      if (!result->errors.empty()) throw std::runtime_error(sequence.name + ", " + result->errors.front());
      for (std::size_t t = run.first + 1; t < sequence.length(); ++t) {
        const auto truth = truth_of(sequence, t, options);
        const auto& region = result->trajectory.frames[t].region;
        off.push_back(truth && overlap(*region, *truth, OverlapRule::Exact) <= 0);
      }
    }
  }
  std::printf("%s, ms a frame:", name.c_str());
  for (const auto& [stage, milliseconds] : diagnostics.stage_milliseconds)
    std::printf(" %s %.3f", stage.c_str(), milliseconds / static_cast<double>(off.size()));
  std::printf(", %.1f parts", diagnostics.parts / static_cast<double>(off.size()));
  int flagged = 0, missed = 0, both = 0;
  for (std::size_t i = 0; i < off.size(); ++i) {
    flagged += diagnostics.lost[i];
    missed += off[i];
    both += diagnostics.lost[i] && off[i];
  }
  std::printf("\n%s, lost: %d of %zu frames; of these %d have no overlap, as have %d in all\n", name.c_str(),
              flagged, off.size(), both, missed);
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  std::string dataset;
  std::vector<std::string> names = asterism::tracker_names(), only;
  CLI::App app(
      "Prints the times of our trackers' stages and how reliable their lost flag is, in one pass over "
      "sequences.",
      "asterism-stages");
  app.add_option("DATASET", dataset, "a sequence, or a folder of sequences")->required();
  app.add_option("--trackers", names, "trackers of asterism, separated by commas")
      ->delimiter(',')
      ->capture_default_str();
  app.add_option("--sequences", only, "only these, separated by commas")->delimiter(',');
  return asterism::tools::run_tool(app, argc, argv, [&] {
    cv::setNumThreads(1);
    for (const std::string& name : names)
      asterism::make_tracker(name);  // unknown ones fail before the first run
    const Dataset data = open_dataset(dataset, Layout::Auto, only);
    print_notes(data);
    const std::vector<Sequence>& sequences = data.sequences;
    for (const std::string& name : names) report(name, sequences);
  });
}
