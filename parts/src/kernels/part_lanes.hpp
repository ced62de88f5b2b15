#pragma once

// Vectors of floats of the width that a file is compiled for, for the kernels only. Everything is inlined or
// has internal linkage, and the standard library is not used (part_kernels.hpp says why).
#include "part_kernels.hpp"

#if defined(__SSE2__)
#if defined(__GNUC__) && !defined(__clang__)
// GCC's own headers leave operands of masked intrinsics undefined, which sets off its warnings.
#pragma GCC diagnostic ignored "-Wuninitialized"
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif
#include <immintrin.h>
#endif

#define ASTERISM_INLINED __attribute__((always_inline))
#define ASTERISM_INLINE [[gnu::always_inline]] static inline

namespace asterism::part_kernels_v0_1 {
namespace {

#if defined(ASTERISM_LANES_AVX512)
constexpr int kLanes = 16;
#elif defined(ASTERISM_LANES_AVX2)
constexpr int kLanes = 8;
#else
constexpr int kLanes = 4;
#endif

using V = float __attribute__((vector_size(4 * kLanes), may_alias));
using Ints = std::int32_t __attribute__((vector_size(4 * kLanes), may_alias));
using Quad = float __attribute__((vector_size(16), may_alias));
// V without an alignment requirement.
struct __attribute__((packed, may_alias)) UnalignedV {
  V v;
};
struct __attribute__((packed, may_alias)) UnalignedInts {
  Ints v;
};
struct __attribute__((packed, may_alias)) UnalignedQuad {
  Quad v;
};

ASTERISM_INLINE V load(const float* p) { return reinterpret_cast<const UnalignedV*>(p)->v; }
ASTERISM_INLINE void store(float* p, V v) { reinterpret_cast<UnalignedV*>(p)->v = v; }
ASTERISM_INLINE void store(std::int32_t* p, Ints v) { reinterpret_cast<UnalignedInts*>(p)->v = v; }
ASTERISM_INLINE V set(float a) { return V{} + a; }
ASTERISM_INLINE Ints bits(V v) { return reinterpret_cast<Ints>(v); }
ASTERISM_INLINE V from_bits(Ints v) { return reinterpret_cast<V>(v); }
ASTERISM_INLINE V abs(V v) { return from_bits(bits(v) & 0x7FFFFFFF); }

#if defined(ASTERISM_LANES_AVX512)
ASTERISM_INLINE V min(V a, V b) { return _mm512_min_ps(a, b); }  // b if either is NaN
ASTERISM_INLINE V max(V a, V b) { return _mm512_max_ps(a, b); }
ASTERISM_INLINE V sqrt(V a) { return _mm512_sqrt_ps(a); }
#elif defined(ASTERISM_LANES_AVX2)
ASTERISM_INLINE V min(V a, V b) { return _mm256_min_ps(a, b); }
ASTERISM_INLINE V max(V a, V b) { return _mm256_max_ps(a, b); }
ASTERISM_INLINE V sqrt(V a) { return _mm256_sqrt_ps(a); }
#elif defined(__SSE2__)
ASTERISM_INLINE V min(V a, V b) { return _mm_min_ps(a, b); }
ASTERISM_INLINE V max(V a, V b) { return _mm_max_ps(a, b); }
ASTERISM_INLINE V sqrt(V a) { return _mm_sqrt_ps(a); }
#else
ASTERISM_INLINE V select(Ints mask, V a, V b) { return from_bits((mask & bits(a)) | (~mask & bits(b))); }
ASTERISM_INLINE V min(V a, V b) { return select(a < b, a, b); }
ASTERISM_INLINE V max(V a, V b) { return select(a > b, a, b); }
ASTERISM_INLINE V sqrt(V a) {
  for (int i = 0; i < kLanes; ++i) a[i] = __builtin_sqrtf(a[i]);
  return a;
}
#endif

// Shuffles of two vectors: the first halves interleaved, the second halves interleaved, the even lanes, the
// odd lanes, and the last two for pairs of lanes.
#if defined(__clang__)
#define ASTERISM_SHUFFLE(a, b, ...) __builtin_shufflevector(a, b, __VA_ARGS__)
#else
#define ASTERISM_SHUFFLE(a, b, ...) __builtin_shuffle(a, b, Ints{__VA_ARGS__})
#endif
#if defined(ASTERISM_LANES_AVX512)
#define ASTERISM_LOW 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23
#define ASTERISM_HIGH 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31
#define ASTERISM_EVEN 0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30
#define ASTERISM_ODD 1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31
#define ASTERISM_EVEN2 0, 1, 4, 5, 8, 9, 12, 13, 16, 17, 20, 21, 24, 25, 28, 29
#define ASTERISM_ODD2 2, 3, 6, 7, 10, 11, 14, 15, 18, 19, 22, 23, 26, 27, 30, 31
#elif defined(ASTERISM_LANES_AVX2)
#define ASTERISM_LOW 0, 8, 1, 9, 2, 10, 3, 11
#define ASTERISM_HIGH 4, 12, 5, 13, 6, 14, 7, 15
#define ASTERISM_EVEN 0, 2, 4, 6, 8, 10, 12, 14
#define ASTERISM_ODD 1, 3, 5, 7, 9, 11, 13, 15
#define ASTERISM_EVEN2 0, 1, 4, 5, 8, 9, 12, 13
#define ASTERISM_ODD2 2, 3, 6, 7, 10, 11, 14, 15
#else
#define ASTERISM_LOW 0, 4, 1, 5
#define ASTERISM_HIGH 2, 6, 3, 7
#define ASTERISM_EVEN 0, 2, 4, 6
#define ASTERISM_ODD 1, 3, 5, 7
#define ASTERISM_EVEN2 0, 1, 4, 5
#define ASTERISM_ODD2 2, 3, 6, 7
#endif
ASTERISM_INLINE V interleave_low(V a, V b) { return ASTERISM_SHUFFLE(a, b, ASTERISM_LOW); }
ASTERISM_INLINE V interleave_high(V a, V b) { return ASTERISM_SHUFFLE(a, b, ASTERISM_HIGH); }
ASTERISM_INLINE V even(V a, V b) { return ASTERISM_SHUFFLE(a, b, ASTERISM_EVEN); }
ASTERISM_INLINE V odd(V a, V b) { return ASTERISM_SHUFFLE(a, b, ASTERISM_ODD); }
ASTERISM_INLINE V even_pairs(V a, V b) { return ASTERISM_SHUFFLE(a, b, ASTERISM_EVEN2); }
ASTERISM_INLINE V odd_pairs(V a, V b) { return ASTERISM_SHUFFLE(a, b, ASTERISM_ODD2); }

/// From four vectors of (t, b, t', b', ..): the sums t + t' and b + b', in order.
ASTERISM_INLINE void sum_pairs(V a, V b, V c, V d, V& top, V& bottom) {
#if defined(ASTERISM_LANES_AVX2)
  // Shuffle within halves, then once across them.
  const auto sum = [](V x, V y) ASTERISM_INLINED -> V {
    const __m256d p = _mm256_castps_pd(x), q = _mm256_castps_pd(y);
    return _mm256_castpd_ps(_mm256_unpacklo_pd(p, q)) + _mm256_castpd_ps(_mm256_unpackhi_pd(p, q));
  };
  const V first = sum(a, b), second = sum(c, d);
  const __m256i order = _mm256_setr_epi32(0, 4, 1, 5, 2, 6, 3, 7);
  top = _mm256_permutevar8x32_ps(_mm256_shuffle_ps(first, second, 0x88), order);
  bottom = _mm256_permutevar8x32_ps(_mm256_shuffle_ps(first, second, 0xDD), order);
#else
  const V first = even_pairs(a, b) + odd_pairs(a, b), second = even_pairs(c, d) + odd_pairs(c, d);
  top = even(first, second);
  bottom = odd(first, second);
#endif
}

/// Rows become columns: log2(kLanes) perfect shuffles.
ASTERISM_INLINE void transpose(V* v) {
#pragma GCC unroll 4
  for (int stage = 1; stage < kLanes; stage *= 2) {
    V shuffled[kLanes];
#pragma GCC unroll 16
    for (int i = 0; i < kLanes / 2; ++i) {
      shuffled[2 * i] = interleave_low(v[i], v[i + kLanes / 2]);
      shuffled[2 * i + 1] = interleave_high(v[i], v[i + kLanes / 2]);
    }
    for (int i = 0; i < kLanes; ++i) v[i] = shuffled[i];
  }
}

/// Lane i is the sum of the lanes of v[i].
ASTERISM_INLINE V sums(const V* v) {
  // Halves are added and interleaved until one vector is left. This bit-reverses the indices, so the vectors
  // are taken in that order.
  V left[kLanes];
  for (int i = 0; i < kLanes; ++i) {
    int reversed = 0;
    for (int bit = 1, mirror = kLanes / 2; bit < kLanes; bit *= 2, mirror /= 2)
      if ((i & bit) != 0) reversed |= mirror;
    left[i] = v[reversed];
  }
#pragma GCC unroll 4
  for (int count = kLanes; count > 1; count /= 2) {
#pragma GCC unroll 16
    for (int i = 0; i < count / 2; ++i) {
      left[i] = interleave_low(left[2 * i], left[2 * i + 1]) + interleave_high(left[2 * i], left[2 * i + 1]);
    }
  }
  return left[0];
}

ASTERISM_INLINE double sum(V v) {
  double total = 0;
  for (int i = 0; i < kLanes; ++i) total += static_cast<double>(v[i]);
  return total;
}

/// exp(x) - 1 for x in [-87, 0], to about 1e-7 of its value also near 0.
ASTERISM_INLINE V exp_minus_one(V x) {
  // x = n log 2 + r, |r| <= log(2) / 2. Adding and subtracting 1.5 2^23 rounds to an integer.
  const V shifted = x * 1.44269504F + 12582912.0F;
  const V n = shifted - 12582912.0F;
  const V r = (x - n * 0.693359375F) + n * 2.12194440e-4F;
  // Taylor's series to r^7; the remainder is below 1e-8 r.
  V p = set(1.0F / 5040);
  p = p * r + 1.0F / 720;
  p = p * r + 1.0F / 120;
  p = p * r + 1.0F / 24;
  p = p * r + 1.0F / 6;
  p = p * r + 0.5F;
  const V grown = (r * r) * p + r;                                 // exp(r) - 1
  const V power = from_bits((bits(shifted) << 23) + (127 << 23));  // 2^n; 1.5 2^23's own bits are shifted out
  return power * grown + (power - 1.0F);
}

}  // namespace
}  // namespace asterism::part_kernels_v0_1
