#include "protocols.hpp"

#include <algorithm>
#include <asterism/solver/base/edit_distance.hpp>
#include <chrono>
#include <cmath>
#include <exception>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "multi_start_measures.hpp"
#include "one_pass_measures.hpp"
#include "statistics.hpp"

namespace asterism::bench {
namespace {

constexpr std::size_t kRestartGap = 5;  // frames from a failure to the next start (VOT's stacks)
// Frames that OTB needs from the first temporal start on; shorter sequences have no such runs.
constexpr std::size_t kFewestTemporal = 20;

struct Names {
  std::string_view name, experiment;
};
Names names(Protocol protocol) {
  switch (protocol) {
    case Protocol::Vot:
      return {"vot", "baseline"};
    case Protocol::Otb:
      return {"otb", "unsupervised"};
    case Protocol::Tre:
      return {"tre", "tre"};
    case Protocol::Sre:
      return {"sre", "sre"};
    case Protocol::MultiStart:
      return {"multistart", "multistart"};
  }
  return {};
}

Region moved(const Region& region, const cv::Point2d& offset) {
  if (region.is_rectangle()) {
    const cv::Rect2d& box = region.box();
    return Region::rectangle({box.x + offset.x, box.y + offset.y, box.width, box.height});
  }
  std::vector<cv::Point2d> points = region.points();
  for (cv::Point2d& point : points) point += offset;
  return Region::polygon(std::move(points));
}

std::optional<std::size_t> first_with_truth(const Sequence& sequence, std::size_t from) {
  for (std::size_t t = from; t < sequence.length(); ++t)
    if (sequence.truth[t]) return t;
  return {};
}

// A tracker at work on a sequence: its answers, times and errors go to a run's result.
class Execution {
 public:
  Execution(const Start& start, SequenceImages& images, std::size_t frames,
            const std::function<bool()>& each_frame)
      : start_(start), images_(images), each_frame_(each_frame) {
    result.trajectory.frames.resize(frames);
    result.trajectory.values["time"].assign(frames, kNone);
  }

  RunResult result;
  bool stopped = false;  // by each_frame

  /// Starts the tracker on frame t of the sequence; the result goes to `slot`. False if it throws.
  bool start(std::size_t t, const Region& region, std::size_t slot) {
    const bool started = attempt(t, slot, [&](const Image& image) { step_ = start_(image, region); });
    frame(slot) = {{}, started ? TrajectoryFrame::kStarted : TrajectoryFrame::kFailed};
    return started;
  }

  /// Tracks in frame t; the result goes to `slot`. False if the tracker throws: it has failed there.
  bool step(std::size_t t, std::size_t slot) {
    Report report;
    if (!attempt(t, slot, [&](const Image& image) { report = step_(image); })) {
      frame(slot) = {{}, TrajectoryFrame::kFailed};
      return false;
    }
    frame(slot).region = std::move(report.region);
    if (!std::isnan(report.confidence)) {
      auto& confidence = result.trajectory.values["confidence"];
      confidence.resize(result.trajectory.frames.size(), kNone);
      confidence[slot] = report.confidence;
    }
    return true;
  }

  TrajectoryFrame& frame(std::size_t slot) { return result.trajectory.frames[slot]; }

 private:
  template <class Call>
  bool attempt(std::size_t t, std::size_t slot, Call&& call) {
    const Image image = images_(t);
    const auto before = std::chrono::steady_clock::now();
    bool done = false;
    try {
      call(image);
      done = true;
      result.trajectory.values["time"][slot] =
          std::chrono::duration<double>(std::chrono::steady_clock::now() - before).count();
    } catch (const UnusableTracker&) {
      throw;
    } catch (const std::exception& error) {
      result.errors.push_back("frame " + std::to_string(t + 1) + ": " + error.what());
    }
    stopped = !each_frame_();
    return done;
  }

  const Start& start_;
  SequenceImages& images_;
  const std::function<bool()>& each_frame_;
  Step step_;
};

void supervised(Execution& execution, const Sequence& sequence, const Run& run, SequenceImages& images,
                const ProtocolOptions& options) {
  std::optional<cv::Size> bounds;
  if (options.bounded) bounds = images(0).pixels.size();
  for (auto first = first_with_truth(sequence, 0); first && !execution.stopped;) {
    std::size_t t = *first;
    bool failed = !execution.start(t, moved(*truth_of(sequence, t, options), run.offset), t);
    while (!failed && ++t < sequence.length() && !execution.stopped) {
      failed = !execution.step(t, t);
      const auto truth = truth_of(sequence, t, options);
      const auto& region = execution.frame(t).region;
      if (truth && !failed) failed = !region || overlap(*region, *truth, options.overlap, bounds) <= 0;
    }
    if (failed) execution.frame(t) = {{}, TrajectoryFrame::kFailed};
    first = first_with_truth(sequence, t + kRestartGap);
  }
}

// Runs from frame run.first on without correction; the first frame goes to `slot` of the result.
void unsupervised(Execution& execution, const Sequence& sequence, const Run& run, const Region& region,
                  std::size_t slot) {
  if (!execution.start(run.first, region, slot)) return;
  std::size_t t = run.first;
  while (!execution.stopped && (run.forward ? t + 1 < sequence.length() : t > 0)) {
    t = run.forward ? t + 1 : t - 1;
    if (!execution.step(t, ++slot)) return;
  }
}

Region spatial_start(const Region& truth, std::size_t variant, const cv::Size& image) {
  const cv::Rect2d box = truth.box();
  const auto starts = spatial_starts({box.x, box.y, box.width, box.height}, image.width, image.height);
  const OtbBox& start = starts.at(variant);
  return Region::rectangle({start.left, start.top, start.width, start.height});
}

}  // namespace

std::string_view to_string(Protocol protocol) { return names(protocol).name; }

Protocol parse_protocol(const std::string& name) {
  std::vector<std::string> known;
  for (const Protocol protocol : kProtocols) {
    if (to_string(protocol) == name) return protocol;
    known.emplace_back(to_string(protocol));
  }
  // What the VOT toolkit and OTB call them.
  std::string hint = detail::near_name(name, known);
  for (const auto& [theirs, ours] :
       {std::pair("supervised", "vot"), std::pair("baseline", "vot"), std::pair("vot201", "vot"),
        std::pair("vot202", "multistart"), std::pair("unsupervised", "otb"), std::pair("ope", "otb")})
    if (name.starts_with(theirs)) hint = std::string(": use '") + ours + "'";
  throw std::invalid_argument("unknown protocol '" + name + "'" + hint + detail::known_names(known));
}

std::string experiment_name(Protocol protocol) { return std::string(names(protocol).experiment); }

void read_as(std::vector<Sequence>& sequences, const ProtocolOptions& options) {
  for (Sequence& sequence : sequences) sequence.range = options.range, sequence.jpeg = options.jpeg;
}

std::optional<Region> truth_of(const Sequence& sequence, std::size_t frame, const ProtocolOptions& options) {
  const std::optional<Region>& truth = sequence.truth[frame];
  if (truth && options.boxes && !truth->is_rectangle()) return Region::rectangle(truth->box());
  return truth;
}

std::vector<cv::Point2d> start_offsets(const ProtocolOptions& options) {
  std::mt19937 random(options.seed);
  const auto uniform = [&] { return options.jitter * (static_cast<double>(random()) / 2147483648.0 - 1); };
  std::vector<cv::Point2d> offsets(1);
  while (static_cast<int>(offsets.size()) < options.starts) {
    const double x = uniform(), y = uniform();
    offsets.emplace_back(x, y);
  }
  return offsets;
}

SequenceImages::SequenceImages(const Sequence& sequence, std::size_t kept_bytes)
    : sequence_(sequence), reader_(sequence), free_bytes_(kept_bytes) {}

Image SequenceImages::operator()(std::size_t t) {
  const auto image = [&](cv::Mat pixels) {
    return Image(std::move(pixels), sequence_.images.empty() || sequence_.jpeg > 0 ? std::filesystem::path()
                                                                                   : sequence_.images[t]);
  };
  const std::lock_guard lock(mutex_);
  if (const auto found = kept_.find(t); found != kept_.end()) return image(found->second);
  cv::Mat pixels = reader_(t);
  const std::size_t bytes = pixels.total() * pixels.elemSize();
  if (bytes <= free_bytes_) {
    free_bytes_ -= bytes;
    kept_[t] = pixels;
  }
  return image(std::move(pixels));
}

std::string Run::file(const Sequence& sequence) const {
  return protocol == Protocol::MultiStart ? anchor_file(sequence.name, first)
                                          : run_file(sequence.name, number);
}

std::vector<Run> runs_of(const Sequence& sequence, Protocol protocol, const ProtocolOptions& options) {
  const std::size_t length = sequence.length();
  const auto first = first_with_truth(sequence, 0);
  if (!first) return {};
  std::vector<Run> runs;
  const auto add = [&](std::size_t start, bool forward, const cv::Point2d& offset) {
    runs.push_back({protocol, static_cast<int>(runs.size()) + 1, start, forward, offset,
                    forward ? length - start : start + 1});
  };
  switch (protocol) {
    case Protocol::Vot:
    case Protocol::Otb:
      for (const cv::Point2d& offset : start_offsets(options)) add(*first, true, offset);
      break;
    case Protocol::Tre: {
      std::vector<bool> usable;
      for (const auto& truth : sequence.truth) {
        const cv::Rect2d box = truth ? truth->box() : cv::Rect2d();
        usable.push_back(is_valid({box.x, box.y, box.width, box.height}, sequence.from_one));
      }
      const auto last =
          usable.size() < kFewestTemporal ? usable.begin() : usable.end() - (kFewestTemporal - 1);
      if (std::find(usable.begin(), last, true) == last) break;
      for (const std::size_t start : temporal_starts(usable)) add(start, true, {});
      break;
    }
    case Protocol::Sre:
      for (int variant = 0; variant < 12; ++variant) add(*first, true, {});
      break;
    case Protocol::MultiStart:
      for (const Anchor& anchor : regular_anchors(length))
        if (sequence.truth[anchor.frame]) add(anchor.frame, anchor.forward, {});
      break;
  }
  return runs;
}

std::string reason_for_no_run(const Sequence& sequence, Protocol protocol, const ProtocolOptions& options) {
  if (!runs_of(sequence, protocol, options).empty()) return {};
  return sequence.name + ": no run of protocol " + std::string(to_string(protocol)) + ", " +
         (!first_with_truth(sequence, 0) ? "as no frame has ground truth"
          : protocol == Protocol::Tre
              ? "which needs " + std::to_string(kFewestTemporal) + " frames from the first usable box on"
              : "as no anchor has ground truth");
}

Region start_region(const Sequence& sequence, const Run& run, const ProtocolOptions& options) {
  return moved(*truth_of(sequence, run.first, options), run.offset);
}

std::optional<RunResult> execute(const Start& start, SequenceImages& images, const Run& run,
                                 const ProtocolOptions& options, const std::function<bool()>& each_frame) {
  const Sequence& sequence = images.sequence();
  const bool from_anchor = run.protocol == Protocol::MultiStart;
  Execution execution(start, images, from_anchor ? run.frames : sequence.length(), each_frame);
  if (run.protocol == Protocol::Vot) {
    supervised(execution, sequence, run, images, options);
  } else {
    Region region = start_region(sequence, run, options);
    if (run.protocol == Protocol::Sre)
      region =
          spatial_start(region, static_cast<std::size_t>(run.number - 1), images(run.first).pixels.size());
    unsupervised(execution, sequence, run, region, from_anchor ? 0 : run.first);
  }
  if (execution.stopped) return {};
  return std::move(execution.result);
}

}  // namespace asterism::bench
