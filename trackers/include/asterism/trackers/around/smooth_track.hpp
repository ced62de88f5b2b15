#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/export.hpp>
#include <asterism/trackers/tracker/tracker.hpp>
#include <span>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The results of a tracker in consecutive frames, from that of the first box on, with boxes that are
/// smoothed after the fact: the box of a frame is estimated from the frames before and after it. `box` and
/// `covariance` are replaced; each box keeps its proportion of width to height.
///
/// Centre and logarithm of the size are two chains, each with the energy
///
///     sum_t 1/2 (x_t - y_t)^T (a C_t)^-1 (x_t - y_t) + sum_t 1/2 |x_{t-1} - 2 x_t + x_{t+1}|^2 / q
///
/// y_t is the tracker's box and C_t its covariance; the correlation of centre and size is left out. The
/// scales a and q are where the probability of the track (the evidence) is largest, which tells independent
/// errors of the boxes from motion. q is between 1e-8 and 1e4 times the median variance of a box. The
/// covariance of a smoothed box is that of the posterior; like C_t, it does not know of a tracker that
/// drifts.
///
/// - The first box is exact.
/// - A frame without covariance counts as one of the median variances; if no frame has variances above 0,
///   every standard deviation of a centre is proportional to the mean side of the box, and those of the sizes
///   are equal.
/// - The box of an interrupted frame is no evidence: it follows from its neighbours. After the last frame
/// with
///   evidence, the box stays where it is.
/// - image: the size of the frames [px], in which centres are kept; if it is empty, they are not limited.
///
/// The results are returned as they are if fewer than two frames after the first have evidence. Time is
/// linear in the number of frames. Throws std::invalid_argument for a box that is not finite or has no size,
/// for a covariance that is not finite or not positive semi-definite, and for numbers too large or too small
/// to compute with; it names the frame.
ASTERISM_API std::vector<TrackResult> smooth_track(std::span<const TrackResult> track, cv::Size image = {});

}  // namespace ASTERISM_ABI
}  // namespace asterism
