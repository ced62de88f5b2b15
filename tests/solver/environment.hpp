#pragma once

#include <cstdlib>

namespace asterism::testing {

/// The whole number that an environment variable has, or another one where it is not set.
inline int environment(const char* name, int otherwise) {
  const char* const value = std::getenv(name);
  return value == nullptr ? otherwise : std::atoi(value);
}

}  // namespace asterism::testing
