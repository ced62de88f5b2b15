#pragma once

#include <asterism/solver/detail/config.hpp>
#include <opencv2/core.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Basic color terms (Berlin and Kay 1969): black, blue, brown, gray, green, orange, pink, purple, red,
/// white, yellow.
inline constexpr int kColorTerms = 11;

/// How much of each cell of an image has each of the colors: the mean over its pixels of the share of each
/// term, shares adding to 1. A pixel's share of a term falls with the distance in CIELAB from the term's
/// typical color as a Gaussian.
///
/// bgr: CV_8UC3, rows x cols cells of `cell` x `cell` pixels -> planes: kColorTerms x rows x cols, in [0,
/// 1]. Does not allocate, but for a table at the first call.
void color_term_cells(const cv::Mat& bgr, int cell, float* planes);

}  // namespace ASTERISM_ABI
}  // namespace asterism
