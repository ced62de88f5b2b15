#pragma once

#include <asterism/solver/base/config.hpp>
#include <chrono>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// The wall-clock time since it was made, if it is wanted: to read the clock twice takes as long as a tenth
/// of the solve of a few nodes.
class Stopwatch {
 public:
  explicit Stopwatch(bool is_wanted = true) : is_wanted_(is_wanted) {
    if (is_wanted_) begin_ = std::chrono::steady_clock::now();
  }
  /// For Summary::seconds: -1 if the time is not wanted.
  double seconds() const {
    if (!is_wanted_) return -1;
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count();
  }

 private:
  bool is_wanted_;
  std::chrono::steady_clock::time_point begin_;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
