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

/// The JSON of a text. Throws std::runtime_error if it is not JSON, and for values nested deeper than any
/// that the project writes, because copying or writing them could overflow the stack.
Json parse_json(std::string_view text);

/// A share of the work: the parts whose number modulo `count` is `index`.
struct Shard {
  int index = 0;
  int count = 1;
};

/// Shares work among the processes of mpirun (-DASTERISM_BENCH_MPI=ON); without it, there is one process.
/// Must live as long as main.
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

/// Keeps a folder for this process alone to write to while the object lives: another process waits for up to
/// `patience` and then throws std::runtime_error. Leaves no file behind. Processes of other machines that
/// share the folder are not noticed.
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

/// From then on SIGINT and SIGTERM set stop_signal; a second one ends the process at once.
void stop_on_signals();
/// The signal that asked this process to stop, or 0.
int stop_signal();

/// The current date and time in UTC, "2026-01-31T23:59:59Z".
std::string utc_now();

/// CPU, cores, compiler and flags.
Json process_machine();

}  // namespace asterism::bench
