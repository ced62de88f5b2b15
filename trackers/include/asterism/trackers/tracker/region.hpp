#pragma once

#include <asterism/parts/concept/frame.hpp>
#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Where an object is in an image: an axis-aligned rectangle or a polygon [px]. All coordinates are those of
/// boxes, which count pixels' edges: the top left pixel reaches from 0 to 1 (see Point2 for positions).
class ASTERISM_API Region {
 public:
  /// A box that covers x .. x + width and y .. y + height.
  static Region rectangle(const cv::Rect2d& box);
  /// A polygon of at least three finite corners in either orientation; otherwise throws
  /// std::invalid_argument.
  static Region polygon(std::vector<cv::Point2d> points);
  /// A box turned about its centre; `angle` in degrees, as OpenCV has it.
  static Region rotated(const cv::RotatedRect& box);
  /// The pixels of an 8-bit image of one channel that are not 0, as a rectangle: that of their number and
  /// mean position, with the shape of their bounding box. std::invalid_argument for another type or if all
  /// pixels are 0.
  static Region mask(const cv::Mat& pixels);

  /// Whether it was made as a rectangle.
  bool is_rectangle() const { return rectangle_; }
  /// The corners; those of a rectangle from the left top one on, clockwise on the screen.
  const std::vector<cv::Point2d>& points() const { return points_; }
  /// The axis-aligned bounding box.
  const cv::Rect2d& box() const { return box_; }
  /// The box that a tracker of boxes starts on: axis-aligned, with the area and the centre of gravity of the
  /// corners' convex hull and the shape of the bounding box (what VOT's participants make of its polygons).
  /// The bounding box of a turned object is mostly background. Its sides are at least a pixel where those of
  /// the bounding box are, so that trackers take it. Of a rectangle, and of corners on a line, it is the
  /// bounding box.
  cv::Rect2d equal_area_box() const;

  /// Whether corners and kind (rectangle or polygon) are the same.
  friend bool operator==(const Region&, const Region&) = default;

 private:
  Region(bool rectangle, std::vector<cv::Point2d> points, const cv::Rect2d& box)
      : rectangle_(rectangle), points_(std::move(points)), box_(box) {}

  bool rectangle_;
  std::vector<cv::Point2d> points_;
  cv::Rect2d box_;
};

/// Four numbers are a rectangle x, y, width, height; six, eight, .. are the corners x1, y1, x2, y2, .. of a
/// polygon of up to 10,000 corners. Empty for any other count, for numbers that are not finite and for a
/// negative width or height.
ASTERISM_API std::optional<Region> to_region(std::span<const double> numbers);

/// x,y,width,height of a rectangle, else x1,y1,x2,y2,..: with the digits that make each number come back
/// exactly.
ASTERISM_API std::string to_string(const Region& region);

}  // namespace ASTERISM_ABI
}  // namespace asterism
