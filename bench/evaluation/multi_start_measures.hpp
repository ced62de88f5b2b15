#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "supervised_measures.hpp"

namespace asterism::bench {

// Measures of VOT2020 and later, where a tracker starts on anchor frames and runs to one end of the sequence,
// as in vot-toolkit's multistart.py. Definitions: docs/evaluation-measures.md. All throw
// std::invalid_argument for no sequences, a sequence without runs, and runs without frames or with different
// numbers of overlaps and flags.

/// A frame to start on, and the direction to run in.
struct Anchor {
  std::size_t frame = 0;  ///< from 0
  bool forward = true;

  bool operator==(const Anchor&) const = default;
};
/// From the data set's value of each frame: forward from positive ones, then backward from negative ones.
std::vector<Anchor> anchors(std::span<const int> values);
/// For data sets without anchors: frames `spacing` apart from the first on, and the last, each run towards
/// the farther end. VOT2020's anchors were made by this rule and then moved by hand to frames in which the
/// target is clearly visible.
std::vector<Anchor> regular_anchors(std::size_t length, std::size_t spacing = 50);

/// Frames in the order of the run, the anchor first.
struct AnchorRun {
  std::vector<double> overlaps;  ///< that of the anchor counts as 0, whatever it is
  std::vector<bool> visible;     ///< as many: whether the ground truth is not empty
};
struct MultiStartSequence {
  std::size_t length = 0;  ///< of the sequence
  std::vector<AnchorRun> runs;
};

/// The number of frames before the failure, which is the first ten consecutive frames with an overlap of at
/// most 0.1 and the target visible.
std::size_t frames_tracked(const AnchorRun& run);

struct MultiStartScore {
  double accuracy = 0;    ///< mean overlap of the frames before failures
  double robustness = 0;  ///< share of frames before failures
};
MultiStartScore multi_start_score(std::span<const MultiStartSequence> sequences);

/// Expected average overlap of i + 1 frames, as element i < `longest`; 0 if no run is so long.
std::vector<double> multi_start_eao_curve(std::span<const MultiStartSequence> sequences, std::size_t longest);

inline constexpr LengthInterval kVot2020Lengths = {115, 755};
/// Mean of the curve; as the toolkit does, over elements low to high - 1.
double multi_start_eao(std::span<const MultiStartSequence> sequences,
                       const LengthInterval& interval = kVot2020Lengths);

}  // namespace asterism::bench
