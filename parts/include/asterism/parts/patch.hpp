#pragma once

#include <asterism/parts/frame.hpp>

namespace asterism::inline ASTERISM_ABI {

/// Samples a window of the image on a regular grid of pixels.
///
/// gray: CV_8UC1, not empty. centre [px] and size [px, > 0] of the window in the image, both sub-pixel; its
/// parts outside the image are replicated borders. The window becomes `patch`, a CV_8UC1 of exactly `grid`
/// pixels, bilinear, after a box filter where it shrinks (so that no aliasing reaches the features). `patch`
/// is reused where it has the right size already.
void sample_patch(const cv::Mat& gray, const Point2& centre, const Size2& size, const cv::Size& grid,
                  cv::Mat& patch);

}  // namespace asterism::inline ASTERISM_ABI
