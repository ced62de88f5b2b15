#pragma once

#include <chrono>

namespace asterism::tools {

/// The progress of a run, on standard error: one updated line on a terminal, otherwise a line every 5
/// seconds.
class Progress {
 public:
  /// total: frames to come, 0 where unknown.
  explicit Progress(int total);
  /// Wipes the refreshed line.
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
