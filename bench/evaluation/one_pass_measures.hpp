#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

namespace asterism::bench {

// Measures of OTB, where a tracker is never restarted. Every definition with its source:
// docs/evaluation-measures.md.

/// A box as in OTB's files: left and top are those of its first pixel, 1 for the first of the image [px].
struct OtbBox {
  double left = 0, top = 0, width = 0, height = 0;

  bool operator==(const OtbBox&) const = default;
};

/// Whether a box of the ground truth counts. Where pixels are counted from 1, all four numbers must be
/// positive: OTB compares no other box, nor starts a tracker on one. Where they are counted from 0, the box
/// must have a size: it may begin at the image's border, or outside.
bool is_valid(const OtbBox& box, bool from_one);

/// Frames of a run against the ground truth, -1 in frames without a valid one.
struct OnePassRun {
  std::vector<double> overlaps;           ///< intersection over union
  std::vector<double> centre_errors;      ///< distance of the centres [px]; infinite without a box
  std::vector<double> normalised_errors;  ///< of x in widths and of y in heights of the ground truth
};
/// Frame 1 counts as the ground truth; a result that is not a box repeats the one before
/// (calcSeqErrRobust.m). A result with fewer boxes than the ground truth ends with an error of the tracker:
/// all later frames are misses. from_one: whether the boxes count pixels from 1, as OTB's do. Throws
/// std::invalid_argument for no ground truth and for more boxes than it has.
OnePassRun compare(std::span<const OtbBox> result, std::span<const OtbBox> truth, bool from_one = true);

/// The runs on one sequence: one, or those of the starts of TRE, SRE or another set of starts.
struct OnePassSequence {
  std::vector<OnePassRun> runs;
};

struct OnePassScore {
  std::array<double, 21> success{};               ///< share of frames with overlap > i / 20
  std::array<double, 51> precision{};             ///< share of frames with centre error <= i px
  std::array<double, 51> normalised_precision{};  ///< share of frames with normalised error <= i / 100
  double average_overlap = 0;  ///< of the frames after the first, only those with valid ground truth

  double auc() const;                                       ///< mean of the success curve
  double precision_at_20() const { return precision[20]; }  ///< px
  double normalised_precision_at_20() const { return normalised_precision[20]; }  ///< hundredths
};
/// Mean over the sequences of their scores, each over the pooled frames of its runs (genPerfMat.m). Frames
/// without ground truth miss every overlap threshold and, as in that code, meet every precision threshold.
/// Sequences whose runs have no valid ground truth after their first frames are left out; if no other is
/// left, everything is NaN. Throws std::invalid_argument for no sequences and those without runs or frames.
OnePassScore one_pass_score(std::span<const OnePassSequence> sequences);

/// Temporal robustness: the frames, from 0, that OTB starts on, `segments` of them from the first usable one
/// to the last with 20 frames left (splitSeqTRE.m). `usable`: of each frame, whether the ground truth is a
/// box and the target is visible. The runs go on to the end. Throws std::invalid_argument if no frame fits.
std::vector<std::size_t> temporal_starts(const std::vector<bool>& usable, std::size_t segments = 20);

/// Spatial robustness: the start boxes of OTB, clipped to the image: moved by a tenth of the size to the
/// left, right, up and down; each corner moved out by a tenth; and 0.8, 0.9, 1.1 and 1.2 times the size
/// (shiftInitBB.m).
std::array<OtbBox, 12> spatial_starts(const OtbBox& box, double image_width, double image_height);

}  // namespace asterism::bench
