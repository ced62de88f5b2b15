#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "campaign.hpp"

namespace asterism::bench {

/// Writes the input of `calibration.py`: FILE, with a line
/// `tracker,protocol,sequence,run,frame,overlap,confidence` for every frame of the trackers' runs of
/// Protocol::Vot and Protocol::Otb, as far as the campaign has these protocols. Left out are frames in which
/// the tracker was started, frames without a confidence, and frames without ground truth. Frames and runs
/// count from 1. The overlap is that of OverlapRule::Exact, with polygons replaced by their equal_area_box;
/// it is 0 in a frame without a region. Returns the number of lines after the header. Throws
/// std::runtime_error for a run that is missing, has another number of frames, or was stored without
/// confidences; std::invalid_argument for a tracker that the campaign does not have.
std::size_t export_frames(const Campaign& campaign, const std::vector<std::string>& trackers,
                          const std::filesystem::path& file);

}  // namespace asterism::bench
