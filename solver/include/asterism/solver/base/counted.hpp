#pragma once

#include <asterism/solver/base/config.hpp>
#include <concepts>
#include <string>
#include <string_view>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// "1 frame", "2 frames"; `many` for a plural without -s.
template <std::integral Count>
std::string counted(Count count, std::string_view one, std::string_view many = {}) {
  std::string text = std::to_string(count) + ' ';
  if (count != 1 && !many.empty()) return text.append(many);
  return text.append(one).append(count == 1 ? "" : "s");
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
