#pragma once

#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "region.hpp"

namespace asterism::bench {

using tools::Region;

/// How the overlap of two regions is computed; every report of an overlap names it.
enum class OverlapRule {
  Exact,       ///< areas of the polygons themselves
  VotPython,   ///< pixels as today's VOT toolkit counts them (Python, since VOT2020)
  Trax,        ///< pixels as libtrax counts them (in the MATLAB toolkit of VOT2016 to VOT2019)
  TraxLegacy,  ///< pixels as libtrax counts them with its legacy flag (VOT2013 to VOT2015, there unbounded)
};

/// "exact", "vot-python", "trax", "trax-legacy".
std::string_view to_string(OverlapRule rule);
/// The rule of that name; std::invalid_argument, which lists the names, for any other.
OverlapRule parse_overlap_rule(const std::string& name);

/// Intersection over union in [0, 1]; if `image` [px] is given, only what lies within it counts. Polygons
/// must be simple, in either orientation. A region that is not finite overlaps nothing. Two regions of no
/// size have overlap 1 by VotPython, 0 by the others. The pixel rules use single precision for coordinates,
/// as the toolkits do, and limit them to a million pixels. The cost is bounded: of regions far larger than
/// any image only a sample of the rows is counted.
double overlap(const Region& a, const Region& b, OverlapRule rule, std::optional<cv::Size> image = {});

}  // namespace asterism::bench
