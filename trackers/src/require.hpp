#pragma once

#include <asterism/solver/config.hpp>
#include <stdexcept>

namespace asterism::inline ASTERISM_ABI {

/// Refuses options out of range.
inline void require(bool holds, const char* what) {
  if (!holds) throw std::invalid_argument(what);
}

}  // namespace asterism::inline ASTERISM_ABI
