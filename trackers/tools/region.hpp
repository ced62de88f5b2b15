#pragma once

#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace asterism::tools {

/// Where an object is: an axis-aligned rectangle or a polygon [px].
class Region {
 public:
  static Region rectangle(const cv::Rect2d& box);
  /// At least three corners in either orientation; std::invalid_argument for fewer.
  static Region polygon(std::vector<cv::Point2d> points);

  bool is_rectangle() const { return rectangle_; }
  /// The corners; those of a rectangle from the left top one on, clockwise on the screen.
  const std::vector<cv::Point2d>& points() const { return points_; }
  /// The axis-aligned bounding box.
  const cv::Rect2d& box() const { return box_; }

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
std::optional<Region> to_region(std::span<const double> numbers);

/// A region as text, as `parse_numbers` and `to_region` read it; empty where it is none.
std::optional<Region> parse_region(std::string_view text);

/// The text that `parse_region` reads: numbers separated by commas, with the digits that make each come back
/// exactly.
std::string to_string(const Region& region);

/// All of `text` as numbers in the notation of the C locale, separated by commas, semicolons or blanks; empty
/// where something in it is not a number.
std::vector<double> parse_numbers(std::string_view text);

}  // namespace asterism::tools
