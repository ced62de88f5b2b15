#pragma once

#include <asterism/solver/base/config.hpp>
#include <cstddef>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Floats that begin on a cache line.
class AlignedFloats {
 public:
  /// All become zero. Allocates only for more than ever before.
  void reset(std::ptrdiff_t count) {
    lines_.assign(static_cast<std::size_t>(count + kPerLine - 1) / kPerLine, Line{});
  }
  /// The first value, aligned; null for none.
  float* data() { return lines_.empty() ? nullptr : lines_.front().values; }
  const float* data() const { return lines_.empty() ? nullptr : lines_.front().values; }

 private:
  static constexpr int kPerLine = 16;
  struct alignas(64) Line {
    float values[kPerLine];
  };
  std::vector<Line> lines_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
