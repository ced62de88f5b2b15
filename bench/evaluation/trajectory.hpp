#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "region.hpp"

namespace asterism::bench {

using tools::Region;

/// The entry of one frame of a run: a region, or a code of the VOT toolkit.
struct TrajectoryFrame {
  static constexpr int kUnknown = 0;  ///< no region, and frames between a failure and the next start
  static constexpr int kStarted = 1;  ///< the tracker was given the ground truth
  static constexpr int kFailed = 2;

  std::optional<Region> region;
  int code = kUnknown;  ///< if there is no region; the toolkits have further codes

  friend bool operator==(const TrajectoryFrame&, const TrajectoryFrame&) = default;
};

/// The result of one run on one sequence.
struct Trajectory {
  std::vector<TrajectoryFrame> frames;
  /// Further values by name, one per frame, NaN where unknown: "time" [s], "confidence".
  std::map<std::string, std::vector<double>> values;
};

/// The folder of a tracker's results on a sequence in a VOT workspace: results/TRACKER/EXPERIMENT/SEQUENCE.
std::filesystem::path results_folder(const std::filesystem::path& workspace, const std::string& tracker,
                                     const std::string& experiment, const std::string& sequence);
/// The file of a run in that folder: SEQUENCE_001.txt for the first, `run` 1.
std::string run_file(const std::string& sequence, int run);
/// The file of a run of a multi-start experiment, from the anchor at frame `anchor`, from 0:
/// SEQUENCE_00000000.txt.
std::string anchor_file(const std::string& sequence, std::size_t anchor);

/// Whether a run's file exists; the run is complete then if `write_trajectory` wrote it.
bool trajectory_exists(const std::filesystem::path& file);

/// Reads a run's file NAME.txt, or NAME.bin beside it, which the toolkit prefers, and all NAME_VALUE.value
/// whose lines are numbers; without other times, those of the MATLAB toolkit, SEQUENCE_time.txt. Throws
/// std::runtime_error "file:line: reason" for a file that is not a trajectory or has masks or points, and for
/// counts that differ.
Trajectory read_trajectory(const std::filesystem::path& file);

/// Writes NAME.txt and NAME_VALUE.value as the toolkit reads them, the regions last, and makes their folders.
/// A region that is not finite or has a negative size is written as unknown. Throws std::runtime_error if
/// writing fails; a file is written completely or not at all.
void write_trajectory(const std::filesystem::path& file, const Trajectory& trajectory);

/// Replaces or creates a file: whatever happens, it has all of `content` or its former content. Throws
/// std::runtime_error.
void write_atomically(const std::filesystem::path& file, std::string_view content);

}  // namespace asterism::bench
