#include "run.hpp"

#include <algorithm>
#include <asterism/solver/base/counted.hpp>
#include <asterism/trackers/around/interruption.hpp>
#include <asterism/trackers/around/smooth_track.hpp>
#include <asterism/trackers/dpt/dpt.hpp>
#include <asterism/trackers/tracker/multi_tracker.hpp>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

#include "figures.hpp"
#include "ground_truth.hpp"
#include "image_source.hpp"
#include "output_path.hpp"
#include "outputs.hpp"
#include "overlay.hpp"
#include "progress.hpp"
#include "system_recorder.hpp"
#include "tool_main.hpp"
#include "window.hpp"

namespace asterism::tools {

volatile std::sig_atomic_t g_stop_signal = 0;

namespace {

cv::Rect2d parse_box(const std::string& text) {
  if (const std::vector<double> box = parse_numbers(text); box.size() == 4 && (box[2] < 1 || box[3] < 1)) {
    throw std::runtime_error("--box \"" + text + "\" is " + cv::format("%g x %g", box[2], box[3]) +
                             " px, but width and height must be at least 1");
  }
  const std::optional<Region> region = parse_region(text);
  if (!region || region->box().width < 1 || region->box().height < 1) {
    throw std::runtime_error("--box \"" + text +
                             "\" is neither x,y,width,height nor the corners x1,y1,x2,y2,.. of a polygon, of "
                             "width and height at least 1");
  }
  return region->equal_area_box();
}

// The files to be written, with their options.
std::vector<std::pair<std::string, std::string>> files_of(const Options& options) {
  std::vector<std::pair<std::string, std::string>> files{{"--save", options.save},
                                                         {"--record-systems", options.systems},
                                                         {"--sheet", options.sheet},
                                                         {"--timeline", options.timeline},
                                                         {"--constellation", options.constellation}};
  if (options.out != "-") files.emplace(files.begin(), "--out", options.out);
  std::erase_if(files, [](const auto& file) { return file.second.empty(); });
  return files;
}

// Throws if a file would be both read and written, or written twice.
void check_kept(const Options& options, const ImageSource& source) {
  const auto files = files_of(options);
  for (std::size_t i = 0; i < files.size(); ++i) {
    const std::string given = files[i].first + " " + files[i].second;
    if (source.reads(files[i].second)) throw std::runtime_error(given + " would change the input");
    if (!options.config.empty() && same_file(files[i].second, options.config))
      throw std::runtime_error(given + " is the file of --config");
    for (std::size_t j = 0; j < i; ++j)
      if (same_file(files[i].second, files[j].second))
        throw std::runtime_error(given + " is the file of " + files[j].first);
  }
}

// Checks that need no frame.
void check(const Options& options) {
  const AnyTracker tracker = make_tracker(options.tracker);  // throws if the name is unknown
  for (const std::string& box : options.boxes) parse_box(box);
  if (std::isnan(options.source.fps)) throw std::runtime_error("--fps: not a number");  // passes CLI's check
  if (options.boxes.size() > 1) {
    for (const auto& [option, path] : {std::pair("--sheet", options.sheet),
                                       {"--record-systems", options.systems},
                                       {"--timeline", options.timeline},
                                       {"--constellation", options.constellation}})
      if (!path.empty()) throw std::runtime_error(std::string(option) + " is for one object: give one --box");
  }
  for (const auto& [option, path] : files_of(options)) check_output(option, path);
  const auto needs_dpt = [&](const std::string& option) {
    if (SolveWatch::can_observe(tracker)) return;
    throw std::runtime_error(option + ": tracker \"" + options.tracker +
                             "\" solves no spring systems (dpt does)");
  };
  if (!options.systems.empty()) {
    SystemRecorder::check_built();
    needs_dpt("--record-systems");
  }
  if (!options.constellation.empty()) needs_dpt("--constellation");
  const auto check_picture = [&](const std::string& option, const std::string& path) {
    if (path.empty()) return;
    if (!cv::haveImageWriter(path))
      throw std::runtime_error(option + " " + path + ": its extension is not that of a known image format");
  };
  check_picture("--sheet", options.sheet);
  check_picture("--timeline", options.timeline);
  check_picture("--constellation", options.constellation);
  if (!options.compare.empty() && options.sheet.empty())
    throw std::runtime_error(
        "--compare draws the box of another tracker on the sheet: give --sheet FILE.png too");
  for (const std::string& other : options.compare) make_tracker(other);
}

// Reads on until `image`, of the source's last frame, shows a scene.
void wait_for_scene(ImageSource& source, cv::Mat& image) {
  const int first = source.position();
  while (!shows_scene(Frame(image)))
    if (!source.next(image))
      throw std::runtime_error("--wait: no frame from " + std::to_string(first) + " on shows a scene");
  if (source.position() > first)
    std::fprintf(stderr, "asterism-track: note: starts in frame %d, the first that shows a scene\n",
                 source.position());
}

// start: number of the frame, from 1.
std::vector<cv::Rect2d> first_boxes(const Options& options, const std::vector<std::optional<Region>>& truth,
                                    int start, Window* window, const cv::Mat& image) {
  if (!options.boxes.empty()) {
    std::vector<cv::Rect2d> boxes;
    for (const std::string& box : options.boxes) boxes.push_back(parse_box(box));
    return boxes;
  }
  const auto index = static_cast<size_t>(start - 1);
  if (index < truth.size() && truth[index]) return {truth[index]->equal_area_box()};
  if (window != nullptr) {
    const cv::Rect2d box = window->select(image);
    if (box.empty()) throw std::runtime_error("no box was selected");
    return {box};
  }
  if (!truth.empty()) {
    throw std::runtime_error("the ground truth has no box in frame " + std::to_string(start) +
                             ": give one by --box x,y,width,height");
  }
  throw std::runtime_error(
      "where is the object? Give its first box by --box x,y,width,height, select it with the mouse by "
      "--show, or "
      "use a folder with groundtruth.txt");
}

// The name of the recorded systems: the last part of the input's path.
std::string name_of(const std::string& input) {
  const std::filesystem::path path = std::filesystem::absolute(input).lexically_normal();
  return (path.has_filename() ? path : path.parent_path()).filename().string();
}

// All outputs of a run.
class Outputs {
 public:
  /// `watch` must observe the tracker's solves if a picture of them is requested.
  Outputs(const Options& options, Window* window, const SolveWatch& watch, double fps)
      : options_(options), window_(window), watch_(watch), sheet_(names(options)) {
    if (!options.out.empty()) csv_.emplace(options.out, options.boxes.size() > 1);
    if (!options.save.empty()) video_.emplace(options.save, fps);
  }

  /// `results`: those of the objects, then those of the other trackers on the sheet. Returns false if the
  /// user closes the window.
  bool add(const cv::Mat& image, const std::vector<TrackResult>& results,
           const std::optional<cv::Rect2d>& truth, int frame, double milliseconds) {
    const std::span objects = std::span(results).first(results.size() - options_.compare.size());
    if (csv_) csv_->add(frame, objects, milliseconds);
    if (!options_.sheet.empty()) sheet_.add(image, results, truth, frame);
    if (!options_.timeline.empty()) timeline_.add(image, objects.front(), frame);
    if (!options_.constellation.empty()) last_.emplace(Last{image.clone(), objects.front(), frame});
    // Averages about the last ten frames; the first one is `init` and is left out.
    if (frames_++ > 0) recent_ = frames_ == 2 ? milliseconds : 0.9 * recent_ + 0.1 * milliseconds;
    if (!video_ && window_ == nullptr) return true;
    const cv::Mat overlay = draw_overlay(image, objects, frame, recent_ > 0 ? 1000 / recent_ : 0);
    if (video_) video_->add(overlay);
    return window_ == nullptr || show(overlay);
  }

  void finish() {
    if (video_) video_->close();
    if (const cv::Mat sheet = sheet_.draw(); !sheet.empty()) write_image(options_.sheet, sheet);
    if (const cv::Mat timeline = timeline_.draw(); !timeline.empty())
      write_image(options_.timeline, timeline);
    if (last_ && watch_.last())
      write_image(options_.constellation,
                  draw_solve(last_->image, *watch_.last(), last_->result, last_->frame));
    if (frames_ > 1) return;
    for (const auto& [option, path] :
         {std::pair("--timeline", options_.timeline), {"--constellation", options_.constellation}})
      if (!path.empty())
        throw std::runtime_error(std::string(option) + ": there is nothing to draw in the first frame alone");
  }

 private:
  struct Last {
    cv::Mat image;
    TrackResult result;
    int frame = 0;
  };
  // The tracker, then the others on the sheet.
  static std::vector<std::string> names(const Options& options) {
    std::vector<std::string> all = options.compare;
    all.insert(all.begin(), options.tracker);
    for (std::string& name : all) name = one_line(name);
    return all;
  }
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
  const SolveWatch& watch_;
  std::optional<CsvFile> csv_;
  std::optional<VideoFile> video_;
  ContactSheet sheet_;
  Timeline timeline_;
  std::optional<Last> last_;
  int frames_ = 0;
  double recent_ = 0;  // milliseconds per frame
};

struct Score {
  int updates = 0, compared = 0;
  double milliseconds = 0, overlaps = 0;
};

// A frame that has been tracked.
struct Step {
  int frame = 0;
  std::vector<TrackResult> results;
  double milliseconds = 0;
};

// The boxes of the first `objects` results are smoothed over all steps; image: the frames' size.
void smooth(std::vector<Step>& steps, std::size_t objects, const cv::Size& image) {
  for (std::size_t i = 0; i < objects; ++i) {
    std::vector<TrackResult> track;
    for (const Step& step : steps) track.push_back(step.results[i]);
    track = smooth_track(track, image);
    for (std::size_t t = 0; t < steps.size(); ++t) steps[t].results[i] = std::move(track[t]);
  }
}

// Reads the input again, and calls add(image, step) for each step until it returns false.
void read_again(const Options& options, const std::vector<Step>& steps,
                const std::function<bool(const cv::Mat&, const Step&)>& add) {
  ImageSource source = ImageSource::open(options.input, options.source);
  bool more = source.skip(options.start - 1);
  cv::Mat image;
  for (const Step& step : steps) {
    while (more && source.position() < step.frame) more = source.next(image);
    if (!more)
      throw std::runtime_error("--smooth: frame " + std::to_string(step.frame) + " of " + options.input +
                               " is not there when it is read again");
    if (!add(image, step)) return;
  }
}

void print_notes(ImageSource& source) {
  for (const std::string& note : source.take_notes())
    std::fprintf(stderr, "asterism-track: note: %s\n", one_line(note).c_str());
}

void print_damaged(const ImageSource& source) {
  if (const auto missing = source.missing())
    std::fprintf(stderr,
                 "asterism-track: note: frames are missing, about %d, the first after frame %d: the video is "
                 "damaged, or its recorder dropped them\n",
                 missing->count, missing->after);
  if (source.damaged().empty()) return;
  std::fprintf(stderr, "asterism-track: note: damaged frames, treated as blank: %zu, the first is %s\n",
               source.damaged().size(), source.damaged().front().c_str());
}

// A tracker's description for a message: on one line and cut if long.
std::string shown(const std::string& description) {
  constexpr std::size_t kMost = 120;
  std::string line = one_line(description);
  if (line.size() > kMost) line.replace(kMost, std::string::npos, "...");
  return line;
}

void print_summary(const Options& options, const Score& score) {
  std::fprintf(stderr, "%s: ", shown(options.tracker).c_str());
  if (options.boxes.size() > 1) std::fprintf(stderr, "%zu objects, ", options.boxes.size());
  std::fputs(detail::counted(score.updates + 1, "frame").c_str(), stderr);
  if (score.milliseconds > 0) std::fprintf(stderr, ", %.1f fps", 1000 * score.updates / score.milliseconds);
  if (score.compared > 0) {
    std::fprintf(stderr, ", mean overlap %.3f in %s", score.overlaps / score.compared,
                 detail::counted(score.compared, "frame").c_str());
  }
  const auto is_named = [](const std::string* name) { return !name->empty(); };
  const auto files = {&options.out,     &options.save,     &options.sheet,
                      &options.systems, &options.timeline, &options.constellation};
  if (!options.show && std::ranges::none_of(files, is_named))
    std::fputs("; --out boxes.csv writes the boxes, --save overlay.mp4 a video, --show opens a window",
               stderr);
  std::fputc('\n', stderr);
}

}  // namespace

void run(const Options& options) {
  check(options);
  ImageSource source = ImageSource::open(options.input, options.source);
  check_kept(options, source);
  if (options.smooth && !source.is_repeatable())
    throw std::runtime_error("--smooth: " + options.input +
                             " cannot be read a second time; record it to a file first");
  std::vector<std::optional<Region>> truth;
  if (source.ground_truth()) truth = read_ground_truth(*source.ground_truth());
  std::optional<Window> window;
  if (options.show) window.emplace();

  cv::Mat image;
  if (!source.skip(options.start - 1) || !source.next(image)) {
    throw std::runtime_error(options.input + " has no frame " + std::to_string(options.start) +
                             ": it ends after " + std::to_string(source.position()));
  }
  if (options.wait) {
    wait_for_scene(source, image);
  } else if (!source.damaged().empty()) {
    throw std::runtime_error(source.damaged().front() +
                             " is damaged: no track can start in it, choose another by --start, or --wait");
  } else if (!shows_scene(Frame(image))) {
    std::fprintf(stderr,
                 "asterism-track: note: frame %d shows noise or one gray level; --wait starts in the first "
                 "frame that shows a scene\n",
                 source.position());
  }
  const int start = source.position();
  const int available = source.frame_count() > 0 ? source.frame_count() - start + 1 : options.frames;
  const int total = options.frames > 0 ? std::min(available, options.frames) : available;

  std::optional<SystemRecorder> recorder;
  if (!options.systems.empty()) recorder.emplace(options.systems, name_of(options.input), options.tracker);
  SolveWatch watch;
  const bool watched = recorder || !options.constellation.empty();
  // The objects, then the first of them again for each tracker that is compared. Their results start as the
  // boxes.
  const std::vector<cv::Rect2d> boxes =
      first_boxes(options, truth, start, window ? &*window : nullptr, image);
  std::vector<std::string> names(boxes.size(), options.tracker);
  names.insert(names.end(), options.compare.begin(), options.compare.end());
  std::vector<TrackResult> results(names.size());
  for (size_t i = 0; i < results.size(); ++i) {
    results[i].box = boxes[i < boxes.size() ? i : 0];
    results[i].confidence = 1;
  }
  MultiTracker tracker(0), beside(0);  // separate, so that only the tracker's own time is reported
  Outputs outputs(options, window ? &*window : nullptr, watch, options.save.empty() ? 0 : source.fps());
  print_notes(source);
  Score score;
  std::vector<Step> steps;  // with --smooth
  const auto region_of = [&](int frame) -> std::optional<Region> {
    const auto at = static_cast<size_t>(frame - 1);
    return at < truth.size() ? truth[at] : std::nullopt;
  };
  // Writes the results of a frame. False if the user closes the window.
  const auto add = [&](const cv::Mat& shown_image, const Step& step) {
    const std::optional<Region> region = region_of(step.frame);
    const auto box = region ? std::optional(region->box()) : std::nullopt;
    if (box && boxes.size() == 1 && step.frame > start) {
      score.overlaps += overlap(step.results[0].box, *box);
      ++score.compared;
    }
    return outputs.add(shown_image, step.results, box, step.frame, step.milliseconds);
  };
  const auto add_or_keep = [&](double milliseconds) {
    Step step{source.position(), results, milliseconds};
    if (!options.smooth) return add(image, step);
    steps.push_back(std::move(step));
    return true;
  };
  std::string error;
  try {
    // Milliseconds of a call, which sets the index of the tracker at work, for errors.
    const auto timed = [&](auto&& call) {
      size_t at_work = 0;
      const auto begin = std::chrono::steady_clock::now();
      try {
        call(at_work);
      } catch (const std::exception& e) {
        throw std::runtime_error(shown(names[at_work]) + " in frame " + std::to_string(source.position()) +
                                 ": " + e.what());
      }
      return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
    };
    double milliseconds = timed([&](size_t& i) {
      const Frame frame(image);
      for (; i < boxes.size(); ++i)
        tracker.add(static_cast<int>(i), watched ? *watch.make_tracker(names[i]) : make_tracker(names[i]),
                    frame, results[i].box);
    });
    timed([&](size_t& i) {
      const Frame frame(image);
      for (i = boxes.size(); i < names.size(); ++i)
        beside.add(static_cast<int>(i), make_tracker(names[i]), frame, results[i].box);
    });
    Progress progress(total);
    bool go_on = add_or_keep(milliseconds);
    while (go_on && g_stop_signal == 0 && (options.frames == 0 || score.updates + 1 < options.frames)) {
      if (!source.next(image)) {
        // A gap says more than an early end.
        if (!source.missing() && source.ended_early()) {
          std::fprintf(stderr, "asterism-track: note: %s ends after frame %d, %d were announced\n",
                       options.input.c_str(), source.position(), source.frame_count());
        }
        break;
      }
      const auto update = [&](MultiTracker& trackers) {
        return timed([&](size_t& i) {
          for (MultiTracker::Object& object : trackers.update(image)) {
            i = static_cast<size_t>(object.id);
            if (object.error) std::rethrow_exception(object.error);
            results[i] = std::move(object.result);
          }
        });
      };
      milliseconds = update(tracker);
      if (beside.size() > 0) update(beside);
      score.milliseconds += milliseconds;
      ++score.updates;
      if (recorder && watch.last() && !results[0].interrupted) {  // in an interruption nothing is solved
        const std::optional<Region> region = region_of(source.position());
        recorder->write(source.position(), *watch.last(), results[0].box,
                        region ? std::optional(region->equal_area_box()) : std::nullopt);
      }
      go_on = add_or_keep(milliseconds);
      progress.report(score.updates + 1);
    }
  } catch (const std::exception& e) {
    error = e.what();
  }
  // Keep what has been written so far, whatever has happened.
  try {
    if (options.smooth) {
      smooth(steps, boxes.size(), image.size());
      read_again(options, steps, add);
    }
    outputs.finish();
  } catch (const std::exception& e) {
    if (error.empty()) error = e.what();
  }
  print_notes(source);
  print_damaged(source);
  if (!error.empty()) throw std::runtime_error(error);
  print_summary(options, score);
}

}  // namespace asterism::tools
