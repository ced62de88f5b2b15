#pragma once

#include <asterism/parts/frame.hpp>

namespace asterism::inline ASTERISM_ABI {

/// Samples a window of the image on a regular grid of pixels.
///
/// image: 8 bits a channel, not empty. centre [px] and size [px, > 0] of the window in the image, both
/// sub-pixel; its parts outside the image are replicated borders. The window becomes `patch`, of the image's
/// type and exactly `grid` pixels, bilinear, after a box filter where it shrinks (so that no aliasing reaches
/// the features). `patch` is reused where it has the right size already. Throws std::invalid_argument for a
/// centre or size that is not finite.
void sample_patch(const cv::Mat& image, const Point2& centre, const Size2& size, const cv::Size& grid,
                  cv::Mat& patch);

/// Pixels that a part overwrites in each frame. A copy has none, where that of a cv::Mat would share them:
/// copies of a part may be used in several threads.
struct Scratch {
  cv::Mat mat;
  Scratch() = default;
  Scratch(const Scratch&) {}
  Scratch& operator=(const Scratch&) { return *this; }
};

}  // namespace asterism::inline ASTERISM_ABI
