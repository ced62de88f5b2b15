#pragma once

#include <asterism/trackers/tracker/region.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace asterism::tools {

using asterism::Region;

/// Four numbers are a rectangle x, y, width, height; six, eight, .. are the corners x1, y1, x2, y2, .. of a
/// polygon of up to 10,000 corners. Empty for any other count, for numbers that are not finite and for a
/// negative width or height.
std::optional<Region> to_region(std::span<const double> numbers);

/// A region as text, as `parse_numbers` and `to_region` read it; empty where it is none.
std::optional<Region> parse_region(std::string_view text);

/// All of `text` as numbers in the notation of the C locale, separated by commas, semicolons or blanks; empty
/// where something in it is not a number.
std::vector<double> parse_numbers(std::string_view text);

}  // namespace asterism::tools
