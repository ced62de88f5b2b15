#pragma once

#include <asterism/solver/base/config.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

/// A problem of an input, and its place. Reads as "<subject> <index> <problem>". `problem` is null if
/// nothing is wrong.
struct Defect {
  const char* subject = nullptr;  ///< what is wrong, e.g. "link"
  int index = -1;                 ///< -1: the subject needs no index
  const char* problem = nullptr;  ///< what is wrong with it; null if nothing is

  /// Whether there is a problem.
  explicit operator bool() const { return problem != nullptr; }
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
