#pragma once

#include <asterism/solver/base/config.hpp>
#include <limits>

namespace asterism {
inline namespace ASTERISM_ABI {

/// A problem of an input, and its place. Reads as "<subject> <index> <problem>". `problem` is null if
/// nothing is wrong.
struct Defect {
  static constexpr int kNoIndex = std::numeric_limits<int>::min();  ///< the subject needs no index

  const char* subject = nullptr;  ///< what is wrong, e.g. "link"
  int index = kNoIndex;           ///< of the subject, or the number that is wrong
  const char* problem = nullptr;  ///< what is wrong with it; null if nothing is

  /// Whether there is a problem.
  explicit operator bool() const { return problem != nullptr; }
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
