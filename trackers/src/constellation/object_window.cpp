#include <algorithm>
#include <asterism/trackers/constellation/object_window.hpp>
#include <cmath>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Largest side of a window, however thin the object is [window pixels].
constexpr double kMaxWindow = 1024;
// Smallest side of a window [window pixels].
constexpr int kMinWindow = 16;

}  // namespace

ObjectWindow::ObjectWindow(const Point2& centre, const Size2& size, const TemplateWindow& window)
    : centre_(centre) {
  const double side = std::sqrt(size.x()) * std::sqrt(size.y());
  const Size2 whole = size + Size2::Constant(window.padding * side);
  const double scale = std::min(std::clamp(side, window.min_template_side, window.max_template_side) / side,
                                kMaxWindow / whole.maxCoeff());
  spacing_ = 1 / scale;
  grid_ = {std::max(kMinWindow, static_cast<int>(std::lround(whole.x() * scale))),
           std::max(kMinWindow, static_cast<int>(std::lround(whole.y() * scale)))};
}

cv::Mat ObjectWindow::sample(const Frame& frame) const {
  cv::Mat patch;
  sample_patch(frame.gray(), centre_, spacing_ * Size2(grid_.width, grid_.height), grid_, patch);
  return patch;
}

cv::Point2f ObjectWindow::to_window(const Point2& x) const {
  const Point2 p = (x - centre_) / spacing_ + Point2(grid_.width - 1, grid_.height - 1) / 2;
  return {static_cast<float>(p.x()), static_cast<float>(p.y())};
}

Point2 ObjectWindow::to_image(const cv::Point2f& p) const {
  const Point2 position(static_cast<double>(p.x), static_cast<double>(p.y));
  return centre_ + spacing_ * (position - Point2(grid_.width - 1, grid_.height - 1) / 2);
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
