#pragma once

#include <chrono>

namespace asterism::tools {

/// Prints the progress of a run on standard error: one updated line on a terminal, otherwise a line every 5
/// seconds.
class Progress {
 public:
  /// total: number of frames, 0 if unknown.
  explicit Progress(int total);
  /// Erases the updated line.
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  void report(int done);

 private:
  using Clock = std::chrono::steady_clock;
  int total_;
  bool terminal_, shown_ = false;
  Clock::time_point start_ = Clock::now(), last_ = start_;
};

}  // namespace asterism::tools
