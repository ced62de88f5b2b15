#pragma once

#include <algorithm>
#include <array>
#include <asterism/solver/base/config.hpp>
#include <string_view>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// A method's name and its policy's, "L-BFGS, dense Cholesky", joined by the compiler.
template <const std::string_view& kMethod, typename Policy>
class NameWithPolicy {
  static constexpr std::string_view policy() {
    if constexpr (requires { Policy::kName; }) {
      return Policy::kName;
    } else {
      return Policy::kIdaName.substr(Policy::kIdaName.find(", ") + 2);
    }
  }
  static constexpr auto kText = [] {
    std::array<char, kMethod.size() + 2 + policy().size()> text{};
    auto* end = std::copy(kMethod.begin(), kMethod.end(), text.begin());
    *end++ = ',';
    *end++ = ' ';
    std::copy(policy().begin(), policy().end(), end);
    return text;
  }();

 public:
  static constexpr std::string_view value{kText.data(), kText.size()};
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
