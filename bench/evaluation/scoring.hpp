#pragma once

#include <opencv2/core.hpp>
#include <optional>

#include "multi_start_measures.hpp"
#include "one_pass_measures.hpp"
#include "protocols.hpp"
#include "supervised_measures.hpp"

namespace asterism::bench {

// The input of the measures: a run's regions against the ground truth of truth_of. Overlaps are by the
// options' rule, within `image` [px] if the options bound them. All throw std::runtime_error if the run has
// another number of frames than the sequence.

/// Of a run of Protocol::Vot. Frames without ground truth or without region count as skipped.
SupervisedRun supervised_run(const Trajectory& trajectory, const Sequence& sequence,
                             const ProtocolOptions& options, std::optional<cv::Size> image = {});

/// Of a run of Protocol::Otb, Tre or Sre, from its start frame on: the exact overlap of boxes, with polygons
/// replaced by their equal_area_box.
OnePassRun one_pass_run(const Trajectory& trajectory, const Sequence& sequence,
                        const ProtocolOptions& options);

/// Of a run of Protocol::MultiStart from an anchor.
AnchorRun anchor_run(const Trajectory& trajectory, const Sequence& sequence, const Run& run,
                     const ProtocolOptions& options, std::optional<cv::Size> image = {});

/// The runs on a sequence with its tags and practical differences.
SupervisedSequence supervised_sequence(const Sequence& sequence, std::vector<SupervisedRun> runs);

/// How long the tracker took, without the calls that start it.
struct Timing {
  double frames = 0, seconds = 0;

  Timing& operator+=(const Timing& other) {
    frames += other.frames;
    seconds += other.seconds;
    return *this;
  }
  double frames_per_second() const;  ///< NaN without times
};
Timing timing(const Trajectory& trajectory);

}  // namespace asterism::bench
