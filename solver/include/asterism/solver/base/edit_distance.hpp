#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <cstddef>
#include <functional>
#include <numeric>
#include <string_view>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

// Errors name the nearest known word.

/// The number of letters to insert, delete or replace to change one word into the other (Levenshtein).
inline std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (const char letter : a) {
    std::size_t diagonal = row[0]++;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t replaced = diagonal + (letter == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({replaced, row[j] + 1, row[j + 1] + 1});
    }
  }
  return row.back();
}

/// The one of `words`, or of their `name`s, that is nearest to a word; there must be at least one.
template <typename Words, typename Name = std::identity>
auto nearest(std::string_view word, const Words& words, Name name = {}) {
  return std::ranges::min_element(
      words, {}, [&](const auto& each) { return edit_distance(word, std::invoke(name, each)); });
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
