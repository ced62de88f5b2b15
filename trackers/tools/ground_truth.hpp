#pragma once

#include <filesystem>
#include <opencv2/core.hpp>
#include <string_view>
#include <vector>

namespace asterism::tools {

/// What a data set says about the object in one frame [px, as published: nothing is shifted].
struct GroundTruth {
  cv::Rect2d box;                    ///< axis-aligned bounding box of `polygon`
  std::vector<cv::Point2d> polygon;  ///< its four corners
  bool visible = true;  ///< false where the line is NaN or a box of no size: no object in this frame
};

/// The annotations of a sequence, one a frame: lines of four numbers x, y, width, height or of eight numbers
/// x1, y1, .. x4, y4, separated by commas, semicolons or blanks. Throws std::runtime_error "file:line:
/// reason".
std::vector<GroundTruth> read_ground_truth(const std::filesystem::path& path);

/// All of `text` as numbers in the notation of the C locale, separated as in a ground truth file; empty where
/// something in it is not a number.
std::vector<double> parse_numbers(std::string_view text);

/// Intersection over union of the areas, in [0, 1]; 0 where a box is empty or not finite.
double overlap(const cv::Rect2d& a, const cv::Rect2d& b);

}  // namespace asterism::tools
