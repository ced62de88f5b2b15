#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

#include "campaign.hpp"

namespace asterism::bench {

/// Writes a tracker's runs of Protocol::Otb in the form that GOT-10k's server accepts (its toolkit's
/// ExperimentGOT10k): FOLDER/SEQ/SEQ_001.txt with x,y,width,height of each frame, a further file for each
/// further start, and SEQ_time.txt with the seconds of each frame, one column per start. The first box is the
/// start box, a polygon becomes its bounding box, and a frame without region repeats the box before. Returns
/// the number of such frames. Throws std::runtime_error for a run that is missing, std::invalid_argument for
/// a tracker that the campaign does not have.
std::size_t export_got10k(const Campaign& campaign, const std::string& tracker,
                          const std::filesystem::path& folder);

}  // namespace asterism::bench
