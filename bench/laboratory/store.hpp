#pragma once

// Results of experiments, stored as soon as they are measured.

#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "process.hpp"

namespace asterism::bench {

/// The smallest part of an experiment that is measured and stored as a whole, in a second or so.
struct Cell {
  std::string key;  ///< unique in the experiment; names everything that the measurement depends on
  std::function<Json()> measure;
};

/// Measured cells by their keys, in the order of the experiment.
using Results = std::vector<std::pair<std::string, Json>>;

/// The settings of a run of an experiment.
struct RunOptions {
  std::filesystem::path folder;
  std::string command;  ///< as typed, for the record
  Shard shard;
  std::function<void()> barrier;  ///< waits for all shards of this run; empty if there is only one
};

/// Measures the cells that folder/name.jsonl does not have yet and stores each as soon as it is measured,
/// with progress and the time left on standard error. If interrupted (SIGINT, SIGTERM), it ends after the
/// current cell, and the same command continues from there. Shards write separate files, which the first one
/// merges.
///
/// The file has one JSON object per line: {"run": number, "machine": ..., "command": ..., "started": ...} for
/// each run, {"key": ..., "run": number, "clock": ..., ...} for each cell; `clock` is the time of a fixed
/// computation beside the cell over that at the start of the run, which tells how steady the machine was.
///
/// Returns all cells; none in a shard that is not the first, or if interrupted. Throws std::runtime_error if
/// another run uses the folder, and one that names file and line for a damaged file. An incomplete last line
/// is not an error: that cell is measured again.
Results run_cells(const std::string& name, const std::vector<Cell>& cells, const RunOptions& options);

/// process_machine, the versions of the packages in use, and how steady the clock is.
Json machine();

}  // namespace asterism::bench
