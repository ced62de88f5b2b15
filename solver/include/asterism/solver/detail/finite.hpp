#pragma once

#include <asterism/solver/detail/config.hpp>
#include <bit>
#include <cstdint>
#include <limits>
#include <type_traits>

// Tests whether numbers are finite by their bits. With -ffast-math or -ffinite-math-only, compilers assume
// that there is no NaN and remove std::isfinite and comparisons, but input can contain NaN all the same.

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// Whether a number is neither infinite nor NaN.
template <typename Scalar>
constexpr bool is_finite(Scalar value) {
  static_assert(std::numeric_limits<Scalar>::is_iec559 && (sizeof(Scalar) == 4 || sizeof(Scalar) == 8));
  using Bits = std::conditional_t<sizeof(Scalar) == 4, std::uint32_t, std::uint64_t>;
  constexpr auto kExponent = std::bit_cast<Bits>(std::numeric_limits<Scalar>::infinity());
  auto bits = std::bit_cast<Bits>(value);
#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
  // Not to be concluded from how the value came about.
  if (!std::is_constant_evaluated()) asm("" : "+r"(bits));
#endif
  return (bits & kExponent) != kExponent;
}

/// Whether all entries are finite, for a matrix or vector with its numbers in memory.
template <typename Derived>
bool all_finite(const Eigen::DenseBase<Derived>& numbers) {
  using Scalar = typename Derived::Scalar;
  using Bits = std::conditional_t<sizeof(Scalar) == 4, std::uint32_t, std::uint64_t>;
  constexpr auto kInfinity = std::bit_cast<Bits>(std::numeric_limits<Scalar>::infinity());
  constexpr Bits kSign = Bits{1} << (8 * sizeof(Bits) - 1);
  constexpr Bits kLeastOfExponent = kInfinity & ~(kInfinity << 1);
  const Scalar* const begin = numbers.derived().data();
#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
  asm volatile("" : : "r"(begin) : "memory");
#endif
  // Adding to an exponent of ones carries into the sign.
  Bits carry = 0;
  for (Eigen::Index i = 0; i < numbers.size(); ++i) {
    carry |= (std::bit_cast<Bits>(begin[i]) & ~kSign) + kLeastOfExponent;
  }
  return (carry & kSign) == 0;
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
