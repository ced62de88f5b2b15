#pragma once

#include <asterism/parts/concept/frame.hpp>
#include <cstdint>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Samples a window of the image on a regular grid of pixels.
///
/// image: 8 bits a channel, not empty. centre [px] and size [px, > 0] of the window in the image, both
/// sub-pixel; its parts outside the image are replicated borders. The window becomes `patch`, of the image's
/// type and exactly `grid` pixels, bilinear, after a box filter where it shrinks (so that no aliasing reaches
/// the features). `patch` is reused where it has the right size already. Throws std::invalid_argument for a
/// centre or size that is not finite.
ASTERISM_API void sample_patch(const cv::Mat& image, const Point2& centre, const Size2& size,
                               const cv::Size& grid, cv::Mat& patch);

/// Pixels that a part overwrites in each frame. A copy has none, where that of a cv::Mat would share them:
/// copies of a part may be used in several threads.
struct Scratch {
  cv::Mat mat;  ///< the pixels
  /// A copy has no pixels.
  Scratch() = default;
  Scratch(const Scratch&) {}
  Scratch& operator=(const Scratch&) { return *this; }
};

/// Samples patches as `sample_patch` does, of images with one channel and several times as fast. It has a
/// workspace of its own, and allocates only for a new grid or width of image. One object is for one thread
/// at a time; copies share nothing.
class ASTERISM_API PatchSampler {
 public:
  /// image: CV_8UC1; otherwise `sample_patch`'s conditions and, except for rounding in windows that shrink,
  /// its result.
  void sample(const cv::Mat& image, const Point2& centre, const Size2& size, const cv::Size& grid,
              cv::Mat& patch);

 private:
  struct Axis {
    std::vector<std::int32_t> pixel, fraction;  // left pixel and 32nds of its right neighbour
    void place(double first, double step, int count, int limit, bool apart);
  };
  void box_filter_row(const cv::Mat& image, int y, const cv::Size& filter, int first, int last,
                      std::vector<std::uint8_t>& out);

  Axis x_, y_;
  std::vector<std::int32_t> work_, sums_, boxes_;
  std::vector<std::uint8_t> above_, below_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
