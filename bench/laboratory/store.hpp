#pragma once

// Results of experiments, stored as soon as they are measured.

#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "process.hpp"

namespace asterism::bench {

/// The part of an experiment that is done at one go, a second or so, and stored as a whole.
struct Cell {
  std::string key;  ///< unique in the experiment; says all that the measurement depends on
  std::function<Json()> measure;
};

/// Measured cells by their keys, in the order of the experiment.
using Results = std::vector<std::pair<std::string, Json>>;

/// The settings of a run of an experiment.
struct RunOptions {
  std::filesystem::path folder;
  std::string command;  ///< as typed, for the record
  Shard shard;
  std::function<void()> barrier;  ///< waits for all shards of this run; empty where there is one
};

/// Measures the cells that folder/name.jsonl does not have yet, each stored as soon as it is there, with
/// progress and the time left on standard error. Interrupted (SIGINT, SIGTERM) it ends after the cell at
/// work, and the same command goes on from there. Shards write files of their own, and the first one merges
/// them.
///
/// The file has one JSON object a line: {"run": number, "machine": ..., "command": ..., "started": ...} for
/// each run, {"key": ..., "run": number, "clock": ..., ...} for each cell; `clock` is the time of a fixed
/// computation beside the cell over that at the start of the run: how steady the machine was.
///
/// Returns all cells, empty in a shard that is not the first, or where interrupted. Throws std::runtime_error
/// where another run has the folder, and one that names file and line where a file is damaged, but for a last
/// line that is incomplete: that cell is measured again.
Results run_cells(const std::string& name, const std::vector<Cell>& cells, const RunOptions& options);

/// process_machine, and the versions of what takes part.
Json machine();

}  // namespace asterism::bench
