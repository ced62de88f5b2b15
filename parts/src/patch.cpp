#include <algorithm>
#include <asterism/parts/patch.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace asterism::inline ASTERISM_ABI {

namespace {

// Width of the box filter for one axis: the odd number nearest to the shrink factor, so that it moves
// nothing. From twice the image's `pixels` on it sees all of them anyway.
int box_filter_width(double shrink, int pixels) {
  shrink = std::min(shrink, 2.0 * pixels);
  return 2 * static_cast<int>(std::lround((shrink - 1) / 2)) + 1;
}

// [first, last] of the pixels that bilinear sampling of [low, high] reads, with a margin, inside [0, n).
cv::Range source_range(double low, double high, int margin, int n) {
  const double last = n - 1;
  const int from = static_cast<int>(std::clamp(std::floor(low) - margin, 0.0, last));
  const int to = static_cast<int>(std::clamp(std::ceil(high) + margin, 0.0, last));
  return {from, to + 1};
}

}  // namespace

void sample_patch(const cv::Mat& image, const Point2& centre, const Size2& size, const cv::Size& grid,
                  cv::Mat& patch) {
  if (!centre.allFinite() || !size.allFinite())
    throw std::invalid_argument("sample_patch: the window must be finite");
  const Size2 step = size.cwiseQuotient(Size2(grid.width, grid.height));  // image pixels a patch pixel
  // Image position of the centre of patch pixel (0, 0).
  const Point2 first = centre - step.cwiseProduct(Size2(grid.width - 1, grid.height - 1)) / 2;
  const Point2 last = centre + step.cwiseProduct(Size2(grid.width - 1, grid.height - 1)) / 2;

  const cv::Size filter(box_filter_width(step.x(), image.cols), box_filter_width(step.y(), image.rows));
  const cv::Range cols = source_range(first.x(), last.x(), filter.width / 2 + 1, image.cols);
  const cv::Range rows = source_range(first.y(), last.y(), filter.height / 2 + 1, image.rows);
  cv::Mat source = image(rows, cols);
  if (filter.area() > 1) {
    cv::Mat smooth;
    cv::blur(source, smooth, filter, {-1, -1}, cv::BORDER_REPLICATE | cv::BORDER_ISOLATED);
    source = smooth;
  }
  const cv::Matx23d to_source(step.x(), 0, first.x() - cols.start, 0, step.y(), first.y() - rows.start);
  cv::warpAffine(source, patch, to_source, grid, cv::INTER_LINEAR | cv::WARP_INVERSE_MAP,
                 cv::BORDER_REPLICATE);
}

}  // namespace asterism::inline ASTERISM_ABI
