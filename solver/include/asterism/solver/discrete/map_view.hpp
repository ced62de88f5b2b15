#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <type_traits>

namespace asterism {
inline namespace ASTERISM_ABI {

/// A map of numbers over pixels that lives elsewhere: x runs from 0 to width - 1, y from 0 to height - 1.
/// `T` is const float for a map that is read, float for one that is written.
template <typename T>
struct MapView {
  T* data = nullptr;                 ///< the number at (0, 0)
  int width = 0;                     ///< [px]
  int height = 0;                    ///< [px]
  std::ptrdiff_t row_stride = 0;     ///< numbers from (x, y) to (x, y + 1)
  std::ptrdiff_t column_stride = 1;  ///< numbers from (x, y) to (x + 1, y)

  MapView() = default;
  /// A map without gaps, row by row.
  MapView(T* numbers, int columns, int rows) : MapView(numbers, columns, rows, columns) {}
  MapView(T* numbers, int columns, int rows, std::ptrdiff_t to_next_row, std::ptrdiff_t to_next_column = 1)
      : data(numbers), width(columns), height(rows), row_stride(to_next_row), column_stride(to_next_column) {}
  /// A map that is written can be read.
  operator MapView<const T>() const requires(!std::is_const_v<T>) {
    return {data, width, height, row_stride, column_stride};
  }

  /// The number at column x of row y.
  T& operator()(int x, int y) const { return data[y * row_stride + x * column_stride]; }
  /// The beginning of row y.
  T* row(int y) const { return data + y * row_stride; }
  /// Whether there are no pixels.
  bool empty() const { return data == nullptr || width <= 0 || height <= 0; }
};

namespace detail {

/// assign(number, other) for the numbers of a map and those of another one of its size.
template <typename Assign>
void for_each_pixel(const MapView<const float>& from, const MapView<float>& to, Assign&& assign) {
  for (int y = 0; y < from.height; ++y) {
    for (int x = 0; x < from.width; ++x) assign(from(x, y), to(x, y));
  }
}

/// Copies a map to one of its size without gaps between columns.
inline void copy_map(const MapView<const float>& from, const MapView<float>& to) {
  if (from.column_stride == 1) {
    for (int y = 0; y < from.height; ++y) std::copy_n(from.row(y), from.width, to.row(y));
  } else {
    for_each_pixel(from, to, [](float number, float& copy) { copy = number; });
  }
}

/// Whether no number is NaN or minus infinity, by their bits: see finite.hpp. `least` is then the least of
/// the negative numbers, 0 if there are none.
inline bool all_are_costs(const MapView<const float>& map, float& least) {
  constexpr std::uint32_t kInfinity = 0x7f800000, kSign = 0x80000000;
  std::uint32_t bad = 0, largest = kSign;  // as bits, negative numbers are larger than all others
  for (int y = 0; y < map.height; ++y) {
    const float* const row = map.row(y);
    const auto test = [&](float value) {
      const auto bits = std::bit_cast<std::uint32_t>(value);
      bad |= static_cast<std::uint32_t>((bits & ~kSign) > kInfinity) |
             static_cast<std::uint32_t>(bits == (kInfinity | kSign));
      largest = std::max(largest, bits);
    };
    if (map.column_stride == 1) {
      for (int x = 0; x < map.width; ++x) test(row[x]);
    } else {
      for (int x = 0; x < map.width; ++x) test(row[x * map.column_stride]);
    }
  }
  least = std::bit_cast<float>(largest);
  return bad == 0;
}

/// The problem of a map of costs, or nullptr; then `least` is the least of its negative numbers,
/// 0 if there are none.
inline const char* map_problem(const MapView<const float>& map, float& least) {
  if (map.empty()) return "is empty";
  if (map.width > 1 << 20 || map.height > 1 << 20) return "is wider or higher than 2^20";
  if (!all_are_costs(map, least)) return "has a number that is NaN or minus infinity";
  return nullptr;
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
