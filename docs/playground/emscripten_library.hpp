#pragma once

// What the solver's headers use of the standard library and the one of Debian 12's emscripten (libc++ 13)
// does not have. Included before all else, by emcc alone (-include); a newer library has its own.
#include <bit>
#include <charconv>
#include <cstdio>
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

// Of numbers in messages: as printf writes them.
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

}  // namespace std
#endif
