#include "scoring.hpp"

#include <algorithm>
#include <asterism/solver/base/counted.hpp>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "statistics.hpp"

namespace asterism::bench {
namespace {

void check_length(const Trajectory& trajectory, std::size_t frames, const Sequence& sequence) {
  if (trajectory.frames.size() != frames)
    throw std::runtime_error("a result on " + sequence.name + " has " +
                             detail::counted(trajectory.frames.size(), "frame") + ", not " +
                             std::to_string(frames));
}

// NaN without truth, 0 without region.
double overlap_in(const TrajectoryFrame& frame, const Sequence& sequence, std::size_t t,
                  const ProtocolOptions& options, const std::optional<cv::Size>& image) {
  const auto truth = truth_of(sequence, t, options);
  if (!truth) return kNone;
  if (!frame.region) return 0;
  return overlap(*frame.region, *truth, options.overlap, options.bounded ? image : std::nullopt);
}

OtbBox otb_box(const std::optional<Region>& region) {
  if (!region) return {kNone, kNone, kNone, kNone};
  const cv::Rect2d box = region->equal_area_box();
  return {box.x, box.y, box.width, box.height};
}

}  // namespace

SupervisedRun supervised_run(const Trajectory& trajectory, const Sequence& sequence,
                             const ProtocolOptions& options, std::optional<cv::Size> image) {
  check_length(trajectory, sequence.length(), sequence);
  SupervisedRun run;
  for (std::size_t t = 0; t < trajectory.frames.size(); ++t) {
    const TrajectoryFrame& frame = trajectory.frames[t];
    run.overlaps.push_back(frame.region ? overlap_in(frame, sequence, t, options, image) : kNone);
    run.outcomes.push_back(frame.code == TrajectoryFrame::kStarted && !frame.region  ? Outcome::Started
                           : frame.code == TrajectoryFrame::kFailed && !frame.region ? Outcome::Failed
                           : std::isnan(run.overlaps.back())                         ? Outcome::Skipped
                                                                                     : Outcome::Tracked);
  }
  return run;
}

OnePassRun one_pass_run(const Trajectory& trajectory, const Sequence& sequence,
                        const ProtocolOptions& options) {
  check_length(trajectory, sequence.length(), sequence);
  // Frames before the run's start have no region and the code 0.
  const auto first =
      static_cast<std::size_t>(std::find_if(trajectory.frames.begin(), trajectory.frames.end(),
                                            [](const TrajectoryFrame& frame) {
                                              return frame.region || frame.code != TrajectoryFrame::kUnknown;
                                            }) -
                               trajectory.frames.begin());
  std::vector<OtbBox> result, truth;
  bool failed = false;
  for (std::size_t t = first; t < trajectory.frames.size(); ++t) {
    const TrajectoryFrame& frame = trajectory.frames[t];
    failed = failed || (frame.code == TrajectoryFrame::kFailed && !frame.region);
    if (!failed) result.push_back(otb_box(frame.region));
    truth.push_back(otb_box(truth_of(sequence, t, options)));
  }
  // The start frame has no region, but `compare` repeats it if the next one's is missing.
  if (!result.empty() && !trajectory.frames[first].region) result.front() = truth.front();
  return compare(result, truth, sequence.from_one);
}

AnchorRun anchor_run(const Trajectory& trajectory, const Sequence& sequence, const Run& run,
                     const ProtocolOptions& options, std::optional<cv::Size> image) {
  check_length(trajectory, run.frames, sequence);
  AnchorRun result;
  for (std::size_t i = 0; i < trajectory.frames.size(); ++i) {
    const std::size_t t = run.forward ? run.first + i : run.first - i;
    const double overlap = overlap_in(trajectory.frames[i], sequence, t, options, image);
    result.visible.push_back(!std::isnan(overlap));
    result.overlaps.push_back(std::isnan(overlap) ? 0 : overlap);
  }
  return result;
}

SupervisedSequence supervised_sequence(const Sequence& sequence, std::vector<SupervisedRun> runs) {
  SupervisedSequence result;
  result.runs = std::move(runs);
  result.tags.insert(sequence.tags.begin(), sequence.tags.end());
  result.practical_difference = sequence.practical;
  return result;
}

double Timing::frames_per_second() const { return seconds > 0 ? frames / seconds : kNone; }

Timing timing(const Trajectory& trajectory) {
  Timing result;
  const auto times = trajectory.values.find("time");
  if (times == trajectory.values.end()) return result;
  for (std::size_t t = 0; t < trajectory.frames.size(); ++t) {
    const TrajectoryFrame& frame = trajectory.frames[t];
    if (std::isnan(times->second[t]) || (!frame.region && frame.code == TrajectoryFrame::kStarted)) continue;
    ++result.frames;
    result.seconds += times->second[t];
  }
  return result;
}

}  // namespace asterism::bench
