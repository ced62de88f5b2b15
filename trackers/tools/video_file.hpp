#pragma once

#include <filesystem>
#include <optional>
#include <span>

namespace asterism::tools {

/// What the structure of a video file says about its end. Formats without such a structure (transport
/// streams, say) have the default.
struct VideoContainer {
  bool cut = false;            ///< the file is shorter than its structure says
  bool counts_offset = false;  ///< the announced duration begins at time 0, not with the first frame
};

/// Reads the structure of an AVI, Matroska or WebM, MP4 or MOV, or FLV file.
VideoContainer read_container(const std::filesystem::path& file);

/// The packets in a video file, one a frame; 0 if they cannot be counted.
int count_packets(const std::filesystem::path& file);

/// The time from frame to frame if at least nine of ten are equal, up to a tenth. times: those of the frames
/// [s], ascending.
std::optional<double> steady_interval(std::span<const double> times);

/// Frames that a video of a steady rate lacks.
struct MissingFrames {
  int count = 0;  ///< about
  int after = 0;  ///< the frame before the first gap, from 1
};
/// Counts the frames that are missing in gaps of at least two; empty if there are none, or if the rate
/// varies.
std::optional<MissingFrames> missing_frames(std::span<const double> times);

}  // namespace asterism::tools
