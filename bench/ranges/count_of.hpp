#pragma once

#include <charconv>
#include <string_view>

/// The number that an argument is; -1 for anything else.
inline int count_of(std::string_view text) {
  int value = -1;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size() ? value : -1;
}
