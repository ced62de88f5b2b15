#pragma once

#include <algorithm>
#include <asterism/solver/config.hpp>
#include <cstddef>
#include <numeric>
#include <string_view>
#include <vector>

namespace asterism::inline ASTERISM_ABI::detail {

/// How many letters are to be put in, taken out or replaced to make one word the other (Levenshtein): errors
/// name the nearest of what is known.
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

}  // namespace asterism::inline ASTERISM_ABI::detail
