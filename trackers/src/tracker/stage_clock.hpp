#pragma once

#include <chrono>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Milliseconds since construction or the last `lap`.
class StageClock {
 public:
  double lap() {
    const auto now = std::chrono::steady_clock::now();
    const double milliseconds = std::chrono::duration<double, std::milli>(now - last_).count();
    last_ = now;
    return milliseconds;
  }

 private:
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
