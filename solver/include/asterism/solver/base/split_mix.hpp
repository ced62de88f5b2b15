#pragma once

#include <asterism/solver/base/config.hpp>
#include <cstddef>
#include <cstdint>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// SplitMix64 (Steele, Lea and Flood 2014): the same random numbers with every compiler and library.
class SplitMix64 {
 public:
  explicit SplitMix64(std::uint64_t seed) : state_(seed) {}

  std::uint64_t operator()() {
    std::uint64_t z = state_ += 0x9e3779b97f4a7c15ULL;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return z ^ (z >> 31);
  }
  /// Less than `limit`, which is at least 1.
  std::size_t below(std::size_t limit) { return static_cast<std::size_t>((*this)() % limit); }
  /// In [0, 1).
  double uniform() { return static_cast<double>((*this)() >> 11) * 0x1p-53; }
  /// In [-1, 1).
  double symmetric() { return static_cast<double>((*this)() >> 11) * 0x1p-52 - 1; }

 private:
  std::uint64_t state_;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
