#pragma once

// Functions for long-running benchmarks: shares of the work, signals, and a description of the machine.

#include <chrono>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

namespace asterism::bench {

using Json = nlohmann::ordered_json;

/// The JSON of a text. Throws std::runtime_error if it is not JSON, and for values that are nested deeper
/// than any of ours, because copying or writing them could overflow the stack.
Json parse_json(std::string_view text);

/// A share of the work: of its parts, those whose number leaves `index` when divided by `count`.
struct Shard {
  int index = 0;
  int count = 1;
};

/// Shares work among the processes of mpirun (-DASTERISM_BENCH_MPI=ON); one process without it. Lives as long
/// as main.
class Processes {
 public:
  Processes(int& argc, char**& argv);
  ~Processes();
  Processes(const Processes&) = delete;
  Processes& operator=(const Processes&) = delete;

  Shard shard() const { return shard_; }
  /// Ends all processes; does nothing if there is only one. For errors: the others would wait for this one.
  void abort() const;
  /// Waits for all processes; empty if there is only one.
  std::function<void()> barrier() const;

 private:
  Shard shard_;
};

/// A folder that this process alone writes to, for as long as the object lives: another one that asks for it
/// waits for up to `patience`, and then std::runtime_error says so. Leaves nothing behind. Processes of other
/// machines that share the folder are not seen.
class FolderLock {
 public:
  FolderLock(const std::filesystem::path& folder, std::chrono::seconds patience);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  int file_;
};

/// FNV-1a of a text, 16 hexadecimal digits.
std::string digest(std::string_view text);

/// From here on SIGINT and SIGTERM set stop_signal, a second one ends the process at once.
void stop_on_signals();
/// The signal that asked this process to stop, or 0.
int stop_signal();

/// Date and time of now, "2026-01-31T23:59:59Z".
std::string utc_now();

/// CPU, cores, compiler and flags.
Json process_machine();

}  // namespace asterism::bench
