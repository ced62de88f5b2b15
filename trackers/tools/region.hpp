#pragma once

#include <asterism/trackers/tracker/region.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace asterism::tools {

using asterism::Region;
using asterism::to_region;

/// The region that a text describes, as `parse_numbers` and `to_region` read it; empty if it is not one.
std::optional<Region> parse_region(std::string_view text);

/// Reads `text` as numbers in the notation of the C locale, separated by commas, semicolons or blanks; empty
/// if anything in it is not a number.
std::vector<double> parse_numbers(std::string_view text);

}  // namespace asterism::tools
