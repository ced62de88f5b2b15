#pragma once

#include <asterism/solver/base/config.hpp>
#include <opencv2/core.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Basic color terms (Berlin and Kay 1969): black, blue, brown, gray, green, orange, pink, purple, red,
/// white, yellow.
inline constexpr int kColorTerms = 11;

/// The share of each color term in each cell of an image: the mean over its pixels of their shares, which add
/// to 1. A pixel's share of a term falls as a Gaussian of the distance in CIELAB to the term's typical color.
///
/// bgr: CV_8UC3, rows x cols cells of `cell` x `cell` pixels -> planes: kColorTerms x rows x cols, in [0, 1].
/// Allocates only a table, at the first call.
void color_term_cells(const cv::Mat& bgr, int cell, float* planes);

}  // namespace ASTERISM_ABI
}  // namespace asterism
