#pragma once

#include <asterism/solver/detail/config.hpp>
#include <stdexcept>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Throws std::invalid_argument unless `holds`: for options that are out of range.
inline void require(bool holds, const char* what) {
  if (!holds) throw std::invalid_argument(what);
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
