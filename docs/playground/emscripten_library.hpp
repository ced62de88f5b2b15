#pragma once

// Parts of the standard library that the solver's headers use and Debian 12's emscripten (libc++ 13) lacks.
// Only emcc includes this file, before all others (-include); with a newer library it defines nothing.
#include <algorithm>
#include <bit>
#include <charconv>
#include <cstdio>
#include <functional>
#include <iterator>
#include <type_traits>

#if !defined(__cpp_lib_bit_cast)
namespace std {

template <typename To, typename From>
constexpr To bit_cast(const From& from) noexcept {
  return __builtin_bit_cast(To, from);
}

}  // namespace std
#endif

#if _LIBCPP_VERSION < 14000
namespace std {

// For numbers in messages, written as by printf.
inline to_chars_result to_chars(char* first, char* last, double value) {
  char text[32];
  const int size = snprintf(text, sizeof text, "%.6g", value);
  if (size > last - first) return {last, errc::value_too_large};
  for (int i = 0; i < size; ++i) first[i] = text[i];
  return {first + size, errc()};
}
inline to_chars_result to_chars(char* first, char* last, double value, chars_format, int precision) {
  char text[48];
  const int size = snprintf(text, sizeof text, "%.*f", precision, value);
  if (size > last - first) return {last, errc::value_too_large};
  for (int i = 0; i < size; ++i) first[i] = text[i];
  return {first + size, errc()};
}
inline to_chars_result to_chars(char* first, char* last, double value, chars_format form) {
  if (form == chars_format::fixed && value == static_cast<double>(static_cast<long long>(value)))
    return to_chars(first, last, value, form, 0);  // all digits of a whole number
  return to_chars(first, last, value);
}

namespace ranges {

template <typename Range, typename Less = std::less<>, typename Projection>
auto min_element(const Range& range, Less is_less, Projection projection) {
  return std::min_element(std::begin(range), std::end(range), [&](const auto& a, const auto& b) {
    return is_less(projection(a), projection(b));
  });
}

}  // namespace ranges
}  // namespace std
#endif
