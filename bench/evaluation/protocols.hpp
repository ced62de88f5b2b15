#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "dataset.hpp"
#include "overlap.hpp"
#include "peers.hpp"
#include "trajectory.hpp"

namespace asterism::bench {

/// How a benchmark runs a tracker on a sequence.
enum class Protocol {
  Vot,        ///< supervised, VOT2013 to VOT2019: restarted five frames after a failure
  Otb,        ///< one pass from the first box, never corrected
  Tre,        ///< OTB's temporal robustness: one pass from each of 20 frames
  Sre,        ///< OTB's spatial robustness: one pass from each of 12 wrong boxes
  MultiStart  ///< VOT2020 and later: from anchors, 50 frames apart, to the farther end
};
inline constexpr Protocol kProtocols[] = {Protocol::Vot, Protocol::Otb, Protocol::Tre, Protocol::Sre,
                                          Protocol::MultiStart};

/// "vot", "otb", "tre", "sre", "multistart".
std::string_view to_string(Protocol protocol);
/// The protocol of that name; std::invalid_argument, which lists the names, for any other.
Protocol parse_protocol(const std::string& name);
/// The name of its folder in a VOT workspace: "baseline", "unsupervised", "tre", "sre", "multistart".
std::string experiment_name(Protocol protocol);

inline constexpr int kMostStarts = 999;      ///< of a sequence: files have numbers of three digits
inline constexpr double kMostJitter = 1000;  ///< [px]

/// Settings on which the results of an evaluation depend, besides tracker, sequence and protocol.
struct ProtocolOptions {
  OverlapRule overlap = OverlapRule::VotPython;  ///< by which failures are detected
  bool bounded = false;                          ///< only the parts within the image overlap
  bool boxes = false;      ///< polygons of the ground truth are replaced by their axis-aligned bounding boxes
  int starts = 1;          ///< runs of Vot and Otb, all but the first with a moved start box
  double jitter = 1;       ///< the most that the box is moved on each axis [px]
  std::uint32_t seed = 1;  ///< of the moves
  std::optional<PixelRange> range = {};  ///< of the images' pixels; none: as Frame assumes
  int jpeg = 0;  ///< quality at which the images are compressed again; 0: they stay as they are

  bool operator==(const ProtocolOptions&) const = default;
};

/// Has the sequences' images read as the options say.
void read_as(std::vector<Sequence>& sequences, const ProtocolOptions& options);

/// The ground truth of a frame, as its bounding box if the options say so.
std::optional<Region> truth_of(const Sequence& sequence, std::size_t frame, const ProtocolOptions& options);

/// Moves of the start box: the first is zero, the others are uniform in [-jitter, jitter]^2 [px]. They are
/// the same on every platform, and a larger count only appends.
std::vector<cv::Point2d> start_offsets(const ProtocolOptions& options);

/// The images of a sequence, for several runs at once: decoded ones are kept while the memory lasts.
class SequenceImages {
 public:
  /// Keeps up to `kept_bytes` of pixels. `sequence` must outlive it.
  explicit SequenceImages(const Sequence& sequence, std::size_t kept_bytes = std::size_t{1} << 30);

  /// Frame t, from 0, not to be written to. Throws as FrameReader.
  Image operator()(std::size_t t);
  const Sequence& sequence() const { return sequence_; }

 private:
  const Sequence& sequence_;
  std::mutex mutex_;
  FrameReader reader_;
  std::map<std::size_t, cv::Mat> kept_;
  std::size_t free_bytes_;
};

/// One run of a tracker on a sequence.
struct Run {
  Protocol protocol = Protocol::Otb;
  int number = 1;          ///< from 1, in the experiment and on the sequence
  std::size_t first = 0;   ///< the frame that it starts on, from 0
  bool forward = true;     ///< to the last frame, else to the first
  cv::Point2d offset;      ///< of the start box, for Vot at every restart too [px]
  std::size_t frames = 0;  ///< how many it goes through

  /// The name of its result's file in results_folder.
  std::string file(const Sequence& sequence) const;
};

/// The runs of a protocol on a sequence; none if no frame has ground truth to start on.
std::vector<Run> runs_of(const Sequence& sequence, Protocol protocol, const ProtocolOptions& options);

/// Why a protocol has no run on a sequence, as a line for the user; empty if it has runs.
std::string reason_for_no_run(const Sequence& sequence, Protocol protocol, const ProtocolOptions& options);

/// The region that the tracker is given at the start of a run of Otb, Tre or MultiStart, or the first of Vot.
Region start_region(const Sequence& sequence, const Run& run, const ProtocolOptions& options);

/// The result of a run: frames of the sequence, for MultiStart from the anchor on in the order of the run;
/// the time of each call of the tracker [s] as "time".
struct RunResult {
  Trajectory trajectory;
  std::vector<std::string> errors;  ///< what the tracker threw, "frame N: reason"
};
/// An exception of the tracker is a failure in that frame; in a supervised run it is restarted five frames
/// later, in others the following frames have no region. `each_frame` is called after each frame; if it
/// returns false, the run ends and the result is empty. Throws UnreadableSequence and UnusableTracker.
std::optional<RunResult> execute(const Start& start, SequenceImages& images, const Run& run,
                                 const ProtocolOptions& options, const std::function<bool()>& each_frame);

}  // namespace asterism::bench
