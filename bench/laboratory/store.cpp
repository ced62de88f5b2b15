#include "store.hpp"

#include <unistd.h>

#include <Eigen/Core>
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <optional>
#include <set>
#include <stdexcept>
#include <thread>

#include "laboratory.hpp"

namespace asterism::bench {

namespace {

namespace fs = std::filesystem;

// The CPU time of a fixed computation, some 100 us [s].
double calibration_seconds() {
  const double before = cpu_seconds();
  volatile double sink = 1;
  double x = 1;
  for (int i = 0; i < 50000; ++i) x = 1 / (x + 0.5);
  sink = x;
  (void)sink;
  return cpu_seconds() - before;
}

double calibrate() {
  std::vector<double> seconds(9);
  for (double& s : seconds) s = calibration_seconds();
  return median(seconds);
}

/// Runs and cells of a results file.
struct Contents {
  std::vector<Json> runs;
  std::map<std::string, Json> cells;

  void read(const fs::path& path) {
    std::ifstream file(path);
    if (!file) return;
    int number = 0;
    const auto first_run = static_cast<int>(runs.size());
    for (std::string line; std::getline(file, line);) {
      ++number;
      const bool is_complete = !file.eof();  // ends in a newline
      const auto fail = [&](const std::string& what) {
        throw std::runtime_error(path.string() + ", line " + std::to_string(number) + ": " + what);
      };
      Json json;
      try {
        json = parse_json(line);
      } catch (const std::runtime_error& error) {
        if (!is_complete) return;
        fail(std::string("not a line of results: ") + error.what());
      }
      constexpr std::int64_t kMostRuns = 1'000'000;
      if (!json.is_object() || !json.contains("run") || !json["run"].is_number_integer() ||
          json["run"].get<std::int64_t>() < 0 || json["run"].get<std::int64_t>() > kMostRuns)
        fail("not a line of results");
      json["run"] = first_run + json["run"].get<int>();
      if (json.contains("machine")) {
        runs.push_back(json);
      } else if (json.contains("key") && json["key"].is_string()) {
        cells[json["key"]] = json;
      } else {
        fail("neither a run nor a cell");
      }
    }
  }
};

/// The files of an experiment: a merged one, and a part for each shard that is running or was interrupted.
class ResultFiles {
 public:
  ResultFiles(const fs::path& folder, const std::string& name) : folder_(folder), name_(name) {
    fs::create_directories(folder);
  }

  fs::path merged() const { return folder_ / (name_ + ".jsonl"); }
  fs::path part(int shard) const { return folder_ / (name_ + ".part" + std::to_string(shard) + ".jsonl"); }

  Contents read() const {
    Contents contents;
    contents.read(merged());
    for (const fs::path& part : parts()) contents.read(part);
    return contents;
  }

  /// Replaces all files by one with the cells in the order of the experiment, then those of other settings.
  void merge(const Contents& contents, const std::vector<Cell>& cells) const {
    const fs::path scratch = merged().string() + ".new";
    std::ofstream file(scratch);
    for (const Json& run : contents.runs) file << run << '\n';
    std::set<std::string> written;
    for (const Cell& cell : cells) {
      const auto at = contents.cells.find(cell.key);
      if (at != contents.cells.end() && written.insert(cell.key).second) file << at->second << '\n';
    }
    for (const auto& [key, cell] : contents.cells) {
      if (!written.contains(key)) file << cell << '\n';
    }
    file.close();
    if (!file) throw std::runtime_error("cannot write " + scratch.string());
    fs::rename(scratch, merged());
    for (const fs::path& part : parts()) fs::remove(part);
  }

 private:
  std::vector<fs::path> parts() const {
    std::vector<fs::path> result;
    for (const auto& entry : fs::directory_iterator(folder_)) {
      if (entry.path().filename().string().starts_with(name_ + ".part")) result.push_back(entry.path());
    }
    std::sort(result.begin(), result.end());
    return result;
  }

  fs::path folder_;
  std::string name_;
};

std::string duration(double seconds) {
  if (seconds < 90) return format("%.0f s", seconds);
  if (seconds < 5400) return format("%.0f min", seconds / 60);
  return format("%.1f h", seconds / 3600);
}

/// Prints the cells done and the time left on standard error: a changing line on a terminal, else some ten
/// lines.
class Progress {
 public:
  Progress(const std::string& name, std::size_t total) : name_(name), total_(total) {}
  ~Progress() {
    if (is_terminal_) std::fputc('\n', stderr);
  }
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  void show(std::size_t done) const {
    if (!is_terminal_ && done != total_ && done % (total_ / 10 + 1) != 0) return;
    const double elapsed = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count();
    const double left = elapsed / static_cast<double>(done) * static_cast<double>(total_ - done);
    std::fprintf(stderr,
                 is_terminal_ ? "\r%s: %zu of %zu cells, %s left   " : "%s: %zu of %zu cells, %s left\n",
                 name_.c_str(), done, total_, duration(left).c_str());
  }

 private:
  std::string name_;
  std::size_t total_;
  bool is_terminal_ = isatty(STDERR_FILENO) != 0;
  std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
};

/// Measures cells and appends each to the file, until a signal asks to stop.
void measure(const std::string& name, const std::vector<const Cell*>& cells, const Json& run,
             std::ofstream file) {
  file << run << std::endl;
  const double steady = calibrate();
  const Progress progress(name, cells.size());
  for (std::size_t done = 0; done < cells.size() && stop_signal() == 0; ++done) {
    Json line{{"key", cells[done]->key}, {"run", run["run"]}, {"clock", 0}};
    line.update(cells[done]->measure());
    line["clock"] = calibrate() / steady;
    file << line << std::endl;
    if (!file) throw std::runtime_error(name + ": the results cannot be written");
    progress.show(done + 1);
  }
}

}  // namespace

Json machine() {
  Json result = process_machine();
  std::set<std::string> packages = {
      format("Eigen %d.%d.%d", EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION)};
  for (const SolverEntry& entry : solvers()) packages.insert(entry.package);
  result["packages"] = packages;
  // The quartiles of a fixed computation's time over its median: how steady the clock is.
  std::vector<double> seconds(101);
  for (double& s : seconds) s = calibration_seconds();
  result["clock_spread"] = (percentile(seconds, 0.75) - percentile(seconds, 0.25)) / median(seconds);
  return result;
}

Results run_cells(const std::string& name, const std::vector<Cell>& cells, const RunOptions& options) {
  stop_on_signals();
  const ResultFiles files(options.folder, name);
  // The first process merges the results of all processes of this run, so its lock is enough.
  std::optional<FolderLock> lock;
  if (options.shard.index == 0) lock.emplace(options.folder, std::chrono::seconds(0));
  const bool is_sharded = options.shard.count > 1;
  const auto wait = [&] {
    if (options.barrier) options.barrier();
  };

  Contents contents = files.read();
  wait();  // no process writes before all have read
  if (options.shard.index == 0) files.merge(contents, cells);
  wait();

  std::vector<const Cell*> open;
  for (std::size_t c = 0; c < cells.size(); ++c) {
    if (static_cast<int>(c % static_cast<std::size_t>(options.shard.count)) != options.shard.index) continue;
    if (!contents.cells.contains(cells[c].key)) open.push_back(&cells[c]);
  }
  if (!open.empty()) {
    const Json run{{"run", is_sharded ? 0 : static_cast<int>(contents.runs.size())},
                   {"machine", machine()},
                   {"command", options.command},
                   {"started", utc_now()}};
    measure(name, open, run,
            is_sharded ? std::ofstream(files.part(options.shard.index))
                       : std::ofstream(files.merged(), std::ios::app));
  }
  wait();
  if (stop_signal() != 0) {
    std::fprintf(stderr, "%s: interrupted; the same command goes on from here\n", name.c_str());
    return {};
  }
  if (options.shard.index != 0) return {};

  contents = files.read();
  files.merge(contents, cells);
  Results results;
  for (const Cell& cell : cells) results.emplace_back(cell.key, contents.cells.at(cell.key));
  return results;
}

}  // namespace asterism::bench
