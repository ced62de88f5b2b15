#pragma once

#include <asterism/solver/base/config.hpp>
#include <bit>
#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>

// Tests whether numbers are finite by their bits. With -ffast-math or -ffinite-math-only, compilers assume
// that there is no NaN and remove std::isfinite and comparisons, but input can contain NaN all the same.

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

template <typename Scalar>
constexpr auto bits_of(Scalar value) {
  static_assert(std::numeric_limits<Scalar>::is_iec559 && (sizeof(Scalar) == 4 || sizeof(Scalar) == 8));
  auto bits = std::bit_cast<std::conditional_t<sizeof(Scalar) == 4, std::uint32_t, std::uint64_t>>(value);
#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
  // Not to be concluded from how the value came about.
  if (!std::is_constant_evaluated()) asm("" : "+r"(bits));
#endif
  return bits;
}

/// Whether a number is neither infinite nor NaN.
template <typename Scalar>
constexpr bool is_finite(Scalar value) {
  constexpr auto kExponent = bits_of(std::numeric_limits<Scalar>::infinity());
  return (bits_of(value) & kExponent) != kExponent;
}

/// Whether a number is NaN.
template <typename Scalar>
constexpr bool is_nan(Scalar value) {
  constexpr auto kInfinity = bits_of(std::numeric_limits<Scalar>::infinity());
  return (bits_of(value) & ~bits_of(Scalar(-0.0))) > kInfinity;
}

/// Whether all numbers are finite and, with kPositive, have no sign. A vector of 16 bytes at a time, as the
/// numbers of few nodes are too few for a compiler to make vectors of them.
template <bool kPositive, typename Scalar>
bool no_defects(const Scalar* numbers, Eigen::Index count) {
  using Bits = std::conditional_t<sizeof(Scalar) == 4, std::uint32_t, std::uint64_t>;
  constexpr auto kInfinity = std::bit_cast<Bits>(std::numeric_limits<Scalar>::infinity());
  constexpr Bits kSign = Bits{1} << (8 * sizeof(Bits) - 1);
  constexpr Bits kLeastOfExponent = kInfinity & ~(kInfinity << 1);
  constexpr int kTogether = 16 / sizeof(Bits);
  typedef Bits Vector [[gnu::vector_size(16)]];
#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
  asm volatile("" : : "r"(numbers) : "memory");
#endif
  // Adding to an exponent of ones carries into the sign.
  const auto defects_of = [](auto bits) {
    auto defects = (bits & ~kSign) + kLeastOfExponent;
    if constexpr (kPositive) defects |= bits;
    return defects;
  };
  Vector together{};
  Eigen::Index i = 0;
  for (; i + kTogether <= count; i += kTogether) {
    Vector bits;
    std::memcpy(&bits, numbers + i, sizeof bits);
    together |= defects_of(bits);
  }
  Bits defects = 0;
  for (; i < count; ++i) defects |= defects_of(std::bit_cast<Bits>(numbers[i]));
  for (int k = 0; k < kTogether; ++k) defects |= together[k];
  return (defects & kSign) == 0;
}

/// Whether all entries are finite, for a matrix or vector with its numbers in memory.
template <typename Derived>
bool all_finite(const Eigen::DenseBase<Derived>& numbers) {
  return no_defects<false>(numbers.derived().data(), numbers.size());
}

/// The same, and none is negative; a -0 counts as negative.
template <typename Derived>
bool all_finite_and_positive(const Eigen::DenseBase<Derived>& numbers) {
  return no_defects<true>(numbers.derived().data(), numbers.size());
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
