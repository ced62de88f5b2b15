#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <cstddef>
#include <functional>
#include <numeric>
#include <string>
#include <string_view>
#include <utility>
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

/// How much a word differs from one that may be meant by it: the edit distance, or 1 if one contains the
/// other or has the same letters in another order.
inline std::size_t difference(std::string_view word, std::string_view other) {
  if (word.size() > other.size()) std::swap(word, other);
  const bool is_part = word.size() > 2 && other.find(word) != other.npos;
  if (word != other && (is_part || std::is_permutation(word.begin(), word.end(), other.begin(), other.end())))
    return 1;
  return edit_distance(word, other);
}

/// The one of `words`, or of their `name`s, that is nearest to a word; there must be at least one. Of several
/// that a word contains, the one with the fewest other letters.
template <typename Words, typename Name = std::identity>
auto nearest(std::string_view word, const Words& words, Name name = {}) {
  return std::ranges::min_element(words, {}, [&](const auto& each) {
    const auto& other = std::invoke(name, each);
    return std::pair(difference(word, other), edit_distance(word, other));
  });
}

/// ", did you mean 'dpt'?", if a name differs from the word by less than half of its letters; else empty.
template <typename Names, typename Name = std::identity>
std::string near_name(std::string_view word, const Names& names, Name name = {}) {
  if (names.empty()) return {};
  const auto near = nearest(word, names, name);
  const auto other = std::invoke(name, *near);
  if (2 * difference(word, other) >= std::max(word.size(), other.size())) return {};
  std::string text = ", did you mean '";
  text.append(*near).append("'?");
  return text;
}

/// " (known: dpt, kcf)".
template <typename Names>
std::string known_names(const Names& names) {
  std::string text;
  for (const auto& name : names) text.append(text.empty() ? " (known: " : ", ").append(name);
  return text.empty() ? text : text.append(")");
}

/// One of both: a near name, or all.
template <typename Names>
std::string name_hint(std::string_view word, const Names& names) {
  const std::string near = near_name(word, names);
  return near.empty() ? known_names(names) : near;
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
