#pragma once

#include <asterism/parts/concept/frame.hpp>
#include <asterism/parts/concept/template_window.hpp>
#include <asterism/parts/features/patch.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

/// An object with its surroundings, resampled to a size that does not depend on the object's.
class ASTERISM_API ObjectWindow {
 public:
  ObjectWindow() = default;
  /// The window of an object of `size` [px] at `centre` [px]. However thin the object is, a window has at
  /// most 1024 and at least 16 pixels on each axis.
  ObjectWindow(const Point2& centre, const Size2& size, const TemplateWindow& window);

  /// The frame's gray values in it.
  cv::Mat sample(const Frame& frame) const;
  /// From image to window pixels and back.
  cv::Point2f to_window(const Point2& x) const;
  Point2 to_image(const cv::Point2f& p) const;
  /// Image pixels a window pixel.
  double spacing() const { return spacing_; }
  /// Size of the window [window pixels].
  const cv::Size& grid() const { return grid_; }

 private:
  Point2 centre_ = Point2::Zero();
  double spacing_ = 1;
  cv::Size grid_{1, 1};
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
