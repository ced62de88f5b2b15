// One-pass evaluation on a folder of annotated sequences: average overlap and speed of our trackers and of OpenCV's,
// from the first frame's box, in one run.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <asterism/trackers/tracker.hpp>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <opencv2/core/utility.hpp>
#include <opencv2/tracking.hpp>
#include <random>

#include "ground_truth.hpp"
#include "image_source.hpp"

namespace {

namespace fs = std::filesystem;
using asterism::AnyTracker;
using namespace asterism::tools;

// One run of one tracker: a box a frame, and what it cost.
using Step = std::function<cv::Rect2d(const cv::Mat&)>;
using Start = std::function<Step(const cv::Mat&, const cv::Rect2d&)>;

Start our_tracker(const std::string& name, std::map<std::string, double>& stages) {
  return [name, &stages](const cv::Mat& image, const cv::Rect2d& box) -> Step {
    auto tracker = std::make_shared<AnyTracker>(asterism::make_tracker(name));
    tracker->init(image, box);
    return [tracker, &stages](const cv::Mat& frame) {
      const asterism::TrackResult result = tracker->update(frame);
      for (const asterism::StageTime& t : result.times) stages[std::string(t.stage)] += t.milliseconds;
      return result.box;
    };
  };
}

template <class OpenCvTracker>
Start peer() {
  return [](const cv::Mat& image, const cv::Rect2d& start) -> Step {
    auto tracker = OpenCvTracker::create();
    cv::Rect box(cvRound(start.x), cvRound(start.y), cvRound(start.width), cvRound(start.height));
    tracker->init(image, box);
    auto last = std::make_shared<cv::Rect>(box);
    return [tracker, last](const cv::Mat& frame) {
      cv::Rect found;
      if (tracker->update(frame, found)) *last = found;  // a refusal keeps the last box
      return cv::Rect2d(*last);
    };
  };
}

struct Score {
  double overlap_sum = 0, seconds = 0;
  int frames = 0;
  double average_overlap() const { return frames > 0 ? overlap_sum / frames : 0; }
};

Score run(const Start& start, const std::vector<cv::Mat>& images, const std::vector<GroundTruth>& truth,
          const cv::Point2d& jitter) {
  Score score;
  cv::Rect2d box = truth[0].box;
  box.x += jitter.x;
  box.y += jitter.y;
  Step step = start(images[0], box);
  for (std::size_t t = 1; t < images.size(); ++t) {
    const auto before = std::chrono::steady_clock::now();
    const cv::Rect2d found = step(images[t]);
    score.seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - before).count();
    score.overlap_sum += overlap(found, truth[t].box);
    ++score.frames;
  }
  return score;
}

}  // namespace

int main(int argc, char** argv) try {
  std::string folder, out;
  std::vector<std::string> names = {"dpt", "coarse", "kcf", "csrt"}, only;
  int starts = 1;
  CLI::App app("One-pass evaluation: average overlap and frames per second on annotated sequences");
  app.add_option("folder", folder, "folder of sequences in the VOT layout")->required()->check(CLI::ExistingDirectory);
  app.add_option("--trackers", names, "dpt, coarse, kcf (ours), csrt, cvkcf (OpenCV's)")->delimiter(',');
  app.add_option("--sequences", only, "only these sequences")->delimiter(',');
  app.add_option("--starts", starts, "runs a sequence; all but the first move the start box by up to a pixel")
      ->check(CLI::Range(1, 1000));
  app.add_option("--out", out, "also write the table as CSV");
  CLI11_PARSE(app, argc, argv);

  cv::setNumThreads(1);
  std::map<std::string, std::map<std::string, double>> stages;
  std::map<std::string, Start> trackers;
  for (const std::string& name : names) {
    if (name == "csrt") trackers[name] = peer<cv::TrackerCSRT>();
    else if (name == "cvkcf") trackers[name] = peer<cv::TrackerKCF>();
    else {
      asterism::make_tracker(name);  // an unknown name fails before the first run
      trackers[name] = our_tracker(name, stages[name]);
    }
  }

  std::vector<fs::path> sequences;
  for (const auto& entry : fs::directory_iterator(folder))
    if (fs::exists(entry.path() / "groundtruth.txt") &&
        (only.empty() || std::ranges::count(only, entry.path().filename().string()) > 0))
      sequences.push_back(entry.path());
  std::ranges::sort(sequences);
  if (sequences.empty()) throw std::runtime_error("no sequence with a groundtruth.txt in " + folder);

  std::ofstream csv;
  if (!out.empty()) {
    csv.open(out);
    if (!csv) throw std::runtime_error("cannot write " + out);
    csv << "sequence,frames,tracker,average_overlap,frames_per_second\n";
  }

  std::printf("%-12s %7s", "sequence", "frames");
  for (const std::string& name : names) std::printf(" %8s", name.c_str());
  std::printf("\n");
  std::map<std::string, Score> total;
  std::map<std::string, double> mean;
  for (const fs::path& path : sequences) {
    ImageSource source = ImageSource::open(path.string());
    const std::vector<GroundTruth> truth = read_ground_truth(path / "groundtruth.txt");
    std::vector<cv::Mat> images;
    for (cv::Mat image; images.size() < truth.size() && source.next(image);) images.push_back(image.clone());
    std::printf("%-12s %7zu", path.filename().c_str(), images.size());
    for (const std::string& name : names) {
      Score score;
      // The portable engine and plain arithmetic: the same starts on every platform.
      std::mt19937 random(1);
      for (int s = 0; s < starts; ++s) {
        const double u = static_cast<double>(random()) / 4294967296.0,
                     v = static_cast<double>(random()) / 4294967296.0;
        const cv::Point2d jitter = s == 0 ? cv::Point2d() : cv::Point2d(2 * u - 1, 2 * v - 1);
        const Score one = run(trackers[name], images, truth, jitter);
        score.overlap_sum += one.overlap_sum;
        score.seconds += one.seconds;
        score.frames += one.frames;
      }
      total[name].seconds += score.seconds;
      total[name].frames += score.frames;
      mean[name] += score.average_overlap() / static_cast<double>(sequences.size());
      std::printf(" %8.3f", score.average_overlap());
      std::fflush(stdout);
      if (csv.is_open())
        csv << path.filename().string() << ',' << images.size() << ',' << name << ',' << score.average_overlap() << ','
            << score.frames / score.seconds << std::endl;
    }
    std::printf("\n");
  }
  std::printf("%-20s", "mean");
  for (const std::string& name : names) std::printf(" %8.3f", mean[name]);
  std::printf("\n%-20s", "frames per second");
  for (const std::string& name : names) std::printf(" %8.1f", total[name].frames / total[name].seconds);
  std::printf("\n");
  for (const std::string& name : names) {
    if (stages[name].empty()) continue;
    std::printf("%s, ms a frame:", name.c_str());
    for (const auto& [stage, ms] : stages[name]) std::printf(" %s %.3f", stage.c_str(), ms / total[name].frames);
    std::printf("\n");
  }
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "asterism-one-pass: %s\n", error.what());
  return 1;
}
