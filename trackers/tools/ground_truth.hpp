#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "region.hpp"

namespace asterism::tools {

/// What a data set says about the object, one entry a frame [px, as published: nothing is shifted]: lines of
/// four numbers x, y, width, height or of six, eight, .. numbers x1, y1, x2, y2, .., separated by commas,
/// semicolons or blanks. Empty where the line is NaN or a region without width or height: no object in this
/// frame. Throws std::runtime_error "file:line: reason".
std::vector<std::optional<Region>> read_ground_truth(const std::filesystem::path& path);

/// Intersection over union of the areas, in [0, 1]; 0 where a box is empty or not finite.
double overlap(const cv::Rect2d& a, const cv::Rect2d& b);

}  // namespace asterism::tools
