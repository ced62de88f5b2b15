#include "run.hpp"

#include <algorithm>
#include <asterism/trackers/dpt.hpp>
#include <asterism/trackers/multi_tracker.hpp>
#include <chrono>
#include <cstdio>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <stdexcept>
#include <vector>

#include "ground_truth.hpp"
#include "image_source.hpp"
#include "outputs.hpp"
#include "overlay.hpp"
#include "progress.hpp"
#include "system_recorder.hpp"
#include "window.hpp"

namespace asterism::tools {

volatile std::sig_atomic_t g_stop_signal = 0;

namespace {

cv::Rect2d parse_box(const std::string& text) {
  const std::optional<Region> region = parse_region(text);
  if (!region || !region->is_rectangle() || region->box().width < 1 || region->box().height < 1) {
    throw std::runtime_error("--box \"" + text +
                             "\" is not x,y,width,height: four numbers, width and height at least 1");
  }
  return region->box();
}

// What can be seen to be wrong before the first frame is read.
void check(const Options& options) {
  make_tracker(options.tracker);  // throws for a name that it does not know
  for (const std::string& box : options.boxes) parse_box(box);
  if (options.boxes.size() > 1) {
    for (const auto& [option, path] :
         {std::pair("--sheet", options.sheet), {"--record-systems", options.systems}})
      if (!path.empty()) throw std::runtime_error(std::string(option) + " is for one object: give one --box");
  }
  if (!options.out.empty() && options.out != "-") check_output("--out", options.out, options.input);
  if (!options.save.empty()) check_output("--save", options.save, options.input);
  if (!options.systems.empty()) {
    SystemRecorder::check_built();
    if (options.tracker != "dpt") {
      throw std::runtime_error("--record-systems: tracker \"" + options.tracker +
                               "\" solves no spring systems (dpt does)");
    }
    check_output("--record-systems", options.systems, options.input);
  }
  if (!options.sheet.empty()) {
    check_output("--sheet", options.sheet, options.input);
    if (!cv::haveImageWriter(options.sheet)) {
      throw std::runtime_error("--sheet " + options.sheet + ": its ending is of no known image format");
    }
  }
}

std::vector<cv::Rect2d> first_boxes(const Options& options, const std::vector<std::optional<Region>>& truth,
                                    Window* window, const cv::Mat& image) {
  if (!options.boxes.empty()) {
    std::vector<cv::Rect2d> boxes;
    for (const std::string& box : options.boxes) boxes.push_back(parse_box(box));
    return boxes;
  }
  const auto index = static_cast<size_t>(options.start - 1);
  if (index < truth.size() && truth[index]) return {truth[index]->box()};
  if (window != nullptr) {
    const cv::Rect2d box = window->select(image);
    if (box.empty()) throw std::runtime_error("no box was selected");
    return {box};
  }
  if (!truth.empty()) {
    throw std::runtime_error("the ground truth has no box in frame " + std::to_string(options.start) +
                             ": give one by --box x,y,width,height");
  }
  throw std::runtime_error(
      "where is the object? Give its first box by --box x,y,width,height, select it with the mouse by "
      "--show, or "
      "use a folder with groundtruth.txt");
}

// What the recorded systems are called after: the last part of the input's path.
std::string name_of(const std::string& input) {
  const std::filesystem::path path = std::filesystem::absolute(input).lexically_normal();
  return (path.has_filename() ? path : path.parent_path()).filename().string();
}

// Everything that a run leaves behind.
class Outputs {
 public:
  Outputs(const Options& options, Window* window, double fps) : options_(options), window_(window) {
    if (!options.out.empty()) csv_.emplace(options.out, options.boxes.size() > 1);
    if (!options.save.empty()) video_.emplace(options.save, fps);
  }

  /// False where the user closes the window.
  bool add(const cv::Mat& image, std::span<const TrackResult> objects, int frame, double milliseconds) {
    if (csv_) csv_->add(frame, objects, milliseconds);
    if (!options_.sheet.empty()) sheet_.add(image, objects.front(), frame);
    // Of about the last ten frames; the first one is `init`.
    if (frames_++ > 0) recent_ = frames_ == 2 ? milliseconds : 0.9 * recent_ + 0.1 * milliseconds;
    if (!video_ && window_ == nullptr) return true;
    const cv::Mat overlay = draw_overlay(image, objects, frame, recent_ > 0 ? 1000 / recent_ : 0);
    if (video_) video_->add(overlay);
    return window_ == nullptr || show(overlay);
  }

  void finish() {
    if (video_) video_->close();
    if (const cv::Mat sheet = sheet_.draw(); !sheet.empty()) write_image(options_.sheet, sheet);
  }

 private:
  bool show(const cv::Mat& overlay) {
    window_->show(overlay);
    Window::Key key = window_->key(1);
    if (key == Window::Key::kPause) {
      do key = window_->key(30);
      while (key == Window::Key::kNone && g_stop_signal == 0);
    }
    return key != Window::Key::kQuit;
  }

  const Options& options_;
  Window* window_;
  std::optional<CsvFile> csv_;
  std::optional<VideoFile> video_;
  ContactSheet sheet_;
  int frames_ = 0;
  double recent_ = 0;  // milliseconds a frame
};

struct Score {
  int updates = 0, compared = 0;
  double milliseconds = 0, overlaps = 0;
};

void print_summary(const Options& options, const Score& score) {
  std::fprintf(stderr, "%s: ", options.tracker.c_str());
  if (options.boxes.size() > 1) std::fprintf(stderr, "%zu objects, ", options.boxes.size());
  std::fprintf(stderr, "%d frames", score.updates + 1);
  if (score.milliseconds > 0) std::fprintf(stderr, ", %.1f fps", 1000 * score.updates / score.milliseconds);
  if (score.compared > 0) {
    std::fprintf(stderr, ", mean overlap %.3f in %d frames", score.overlaps / score.compared, score.compared);
  }
  std::fputc('\n', stderr);
}

}  // namespace

void run(const Options& options) {
  check(options);
  ImageSource source = ImageSource::open(options.input);
  std::vector<std::optional<Region>> truth;
  if (source.ground_truth()) truth = read_ground_truth(*source.ground_truth());
  std::optional<Window> window;
  if (options.show) window.emplace();

  cv::Mat image;
  if (!source.skip(options.start - 1) || !source.next(image)) {
    throw std::runtime_error(options.input + " has no frame " + std::to_string(options.start) +
                             ": it ends after " + std::to_string(source.position()));
  }
  const int available = source.frame_count() > 0 ? source.frame_count() - options.start + 1 : options.frames;
  const int total = options.frames > 0 ? std::min(available, options.frames) : available;

  std::optional<SystemRecorder> recorder;
  if (!options.systems.empty()) recorder.emplace(options.systems, name_of(options.input));
  MultiTracker tracker(0);
  std::vector<TrackResult> results;
  for (const cv::Rect2d& box : first_boxes(options, truth, window ? &*window : nullptr, image)) {
    results.emplace_back();
    results.back().box = box;
    results.back().confidence = 1;
  }
  Outputs outputs(options, window ? &*window : nullptr, source.fps());
  Score score;
  std::string error;
  try {
    const auto timed = [&](auto&& call) {
      const auto start = std::chrono::steady_clock::now();
      try {
        call();
      } catch (const std::exception& e) {
        throw std::runtime_error(options.tracker + " in frame " + std::to_string(source.position()) + ": " +
                                 e.what());
      }
      return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
    };
    double milliseconds = timed([&] {
      const Frame frame(image);
      for (size_t i = 0; i < results.size(); ++i)
        tracker.add(static_cast<int>(i),
                    recorder ? AnyTracker(recorder->make_tracker()) : make_tracker(options.tracker), frame,
                    results[i].box);
    });
    Progress progress(total);
    bool go_on = outputs.add(image, results, source.position(), milliseconds);
    while (go_on && g_stop_signal == 0 && (options.frames == 0 || score.updates + 1 < options.frames)) {
      if (!source.next(image)) {
        if (source.position() < source.frame_count()) {
          std::fprintf(stderr, "asterism-track: note: %s ends after frame %d, %d were announced\n",
                       options.input.c_str(), source.position(), source.frame_count());
        }
        break;
      }
      milliseconds = timed([&] {
        for (MultiTracker::Object& object : tracker.update(image)) {
          if (object.error) std::rethrow_exception(object.error);
          results[static_cast<size_t>(object.id)] = std::move(object.result);
        }
      });
      score.milliseconds += milliseconds;
      ++score.updates;
      if (const auto at = static_cast<size_t>(source.position() - 1);
          at < truth.size() && truth[at] && results.size() == 1) {
        score.overlaps += overlap(results[0].box, truth[at]->box());
        ++score.compared;
      }
      if (recorder) recorder->write(source.position());
      go_on = outputs.add(image, results, source.position(), milliseconds);
      progress.report(score.updates + 1);
    }
  } catch (const std::exception& e) {
    error = e.what();
  }
  // What there is by now is kept, whatever has happened.
  try {
    outputs.finish();
  } catch (const std::exception& e) {
    if (error.empty()) error = e.what();
  }
  if (!error.empty()) throw std::runtime_error(error);
  print_summary(options, score);
}

}  // namespace asterism::tools
