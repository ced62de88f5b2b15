#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "region.hpp"

namespace asterism::tools {

/// The lines of a text file from any system: they end in LF, CR LF or CR, and a byte order mark before the
/// first is skipped. Throws std::runtime_error "file: reason" if the file cannot be read.
std::vector<std::string> read_lines(const std::filesystem::path& path);

/// The annotations of a data set, one entry per frame [px, as published: nothing is shifted]: lines of four
/// numbers x, y, width, height or of six, eight, .. numbers x1, y1, x2, y2, .., separated by commas,
/// semicolons or blanks. An entry is empty if there is no object in its frame: NaN, a region without width or
/// height, or a single whole number, as the VOT toolkit writes it. Throws std::runtime_error "file:line:
/// reason" for anything else, including lines of MOTChallenge and masks.
std::vector<std::optional<Region>> read_ground_truth(const std::filesystem::path& path);

/// Whether the numbers of a file's lines are those of MOTChallenge: frame, id, x, y, width, height and up to
/// four more, rather than the corners of polygons. The frames are whole and begin with 0 or 1, the ids are
/// whole, and each id's frames increase. Empty lines are skipped.
bool are_mot_lines(std::span<const std::vector<double>> lines);
/// The advice for a user whose file has such lines.
inline constexpr const char* kMotAdvice =
    "lines of MOTChallenge (frame, id, x, y, width, height, ..): keep x,y,width,height of one object, a line "
    "a frame";

/// Intersection over union of the areas, in [0, 1]; 0 if a box is empty or not finite.
double overlap(const cv::Rect2d& a, const cv::Rect2d& b);

}  // namespace asterism::tools
