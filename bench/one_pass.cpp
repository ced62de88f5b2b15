// One-pass evaluation on a folder of annotated sequences: average overlap and speed of our trackers and of
// OpenCV's, from the first frame's box, on one thread, in one run.

#include <CLI/CLI.hpp>
#include <asterism/trackers/tracker.hpp>
#include <cstdio>
#include <fstream>
#include <map>
#include <opencv2/core/utility.hpp>
#include <opencv2/tracking.hpp>

#include "evaluation.hpp"

namespace {

using namespace asterism::bench;

/// What our trackers tell beside the box, over all runs.
struct Diagnostics {
  std::map<std::string, double> stage_milliseconds;
  std::vector<bool> lost;  // one a frame
};

Start our_tracker(const std::string& name, Diagnostics& diagnostics) {
  return [name, &diagnostics](const cv::Mat& image, const cv::Rect2d& box) -> Step {
    auto tracker = std::make_shared<asterism::AnyTracker>(asterism::make_tracker(name));
    tracker->init(image, box);
    return [tracker, &diagnostics](const cv::Mat& frame) {
      const asterism::TrackResult result = tracker->update(frame);
      for (const asterism::StageTime& t : result.times)
        diagnostics.stage_milliseconds[std::string(t.stage)] += t.milliseconds;
      diagnostics.lost.push_back(result.lost);
      return result.box;
    };
  };
}

template <class OpenCvTracker>
Start peer() {
  return [](const cv::Mat& image, const cv::Rect2d& start) -> Step {
    auto tracker = OpenCvTracker::create();
    const cv::Rect box(cvRound(start.x), cvRound(start.y), cvRound(start.width), cvRound(start.height));
    tracker->init(image, box);
    auto last = std::make_shared<cv::Rect>(box);
    return [tracker, last](const cv::Mat& frame) {
      cv::Rect found;
      if (tracker->update(frame, found)) *last = found;  // a refusal keeps the last box
      return cv::Rect2d(*last);
    };
  };
}

struct Total {
  double overlap = 0, seconds = 0;  // overlap: sum of the sequences' averages
  std::vector<double> overlaps;     // of all frames
};

}  // namespace

int main(int argc, char** argv) try {
  std::string folder, out;
  std::vector<std::string> names = {"dpt", "coarse", "kcf", "csrt", "cvkcf"}, only;
  int starts = 1;
  CLI::App app("One-pass evaluation: average overlap and frames per second on annotated sequences");
  app.add_option("folder", folder, "folder of sequences in the VOT layout")
      ->required()
      ->check(CLI::ExistingDirectory);
  app.add_option("--trackers", names, "dpt, coarse, kcf (ours), csrt, cvkcf (OpenCV's)")->delimiter(',');
  app.add_option("--sequences", only, "only these sequences")->delimiter(',');
  app.add_option("--starts", starts, "runs a sequence; all but the first move the start box by up to a pixel")
      ->check(CLI::Range(1, 1000));
  app.add_option("--out", out, "also write the figures as CSV");
  CLI11_PARSE(app, argc, argv);

  cv::setNumThreads(1);
  std::map<std::string, Diagnostics> diagnostics;
  std::map<std::string, Start> trackers;
  for (const std::string& name : names) {
    if (name == "csrt") {
      trackers[name] = peer<cv::TrackerCSRT>();
    } else if (name == "cvkcf") {
      trackers[name] = peer<cv::TrackerKCF>();
    } else {
      asterism::make_tracker(name);  // an unknown name fails before the first run
      trackers[name] = our_tracker(name, diagnostics[name]);
    }
  }
  const auto sequences = find_sequences(folder, only);
  const auto offsets = start_offsets(starts);

  std::ofstream csv;
  if (!out.empty()) {
    csv.open(out);
    if (!csv) throw std::runtime_error("cannot write " + out);
    csv << "sequence,frames,tracker,average_overlap,frames_per_second\n";
  }

  std::printf("%-12s %7s", "sequence", "frames");
  for (const std::string& name : names) std::printf(" %8s", name.c_str());
  std::printf("\n");
  std::map<std::string, Total> totals;
  for (const auto& path : sequences) {
    const LoadedSequence sequence = load_sequence(path);
    std::printf("%-12s %7zu", sequence.name.c_str(), sequence.images.size());
    for (const std::string& name : names) {
      Total& total = totals[name];
      double overlap = 0, seconds = 0;
      for (const cv::Point2d& offset : offsets) {
        const OnePass run = run_one_pass(trackers[name], sequence, offset);
        overlap += run.average_overlap() / starts;
        seconds += run.seconds;
        total.overlaps.insert(total.overlaps.end(), run.overlaps.begin(), run.overlaps.end());
      }
      total.overlap += overlap;
      total.seconds += seconds;
      std::printf(" %8.3f", overlap);
      std::fflush(stdout);
      if (csv.is_open()) {
        const double frames = static_cast<double>(sequence.images.size() - 1) * starts;
        csv << sequence.name << ',' << sequence.images.size() << ',' << name << ',' << overlap << ','
            << frames / seconds << std::endl;
        if (!csv) throw std::runtime_error("cannot write " + out);
      }
    }
    std::printf("\n");
  }

  std::printf("%-20s", "mean");
  for (const std::string& name : names)
    std::printf(" %8.3f", totals[name].overlap / static_cast<double>(sequences.size()));
  std::printf("\n%-20s", "frames per second");
  for (const std::string& name : names)
    std::printf(" %8.1f", static_cast<double>(totals[name].overlaps.size()) / totals[name].seconds);
  std::printf("\n\n");
  for (const std::string& name : names) {
    const Diagnostics& told = diagnostics[name];
    if (told.lost.empty()) continue;
    const std::vector<double>& overlaps = totals[name].overlaps;
    std::printf("%s, ms a frame:", name.c_str());
    for (const auto& [stage, ms] : told.stage_milliseconds)
      std::printf(" %s %.3f", stage.c_str(), ms / static_cast<double>(overlaps.size()));
    int flagged = 0, off = 0, both = 0;
    for (std::size_t i = 0; i < overlaps.size(); ++i) {
      flagged += told.lost[i];
      off += overlaps[i] <= 0;
      both += told.lost[i] && overlaps[i] <= 0;
    }
    std::printf("\n%s, lost: %d of %zu frames; of these %d have no overlap, as have %d in all\n",
                name.c_str(), flagged, overlaps.size(), both, off);
  }
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "asterism-one-pass: %s\n", error.what());
  return 1;
}
