#pragma once

// SIMD vectors for the batch kernels, one type per instruction set. Everything is inlined or has internal
// linkage: these files are compiled for instructions that not every machine has, and the linker must never
// choose a function of theirs for another file. Hence no standard library either.
#include <asterism/solver/batch/batch_kernels.hpp>

#if defined(__SSE2__)
#if defined(__GNUC__) && !defined(__clang__)
// GCC's own headers leave operands of masked intrinsics undefined, and its warning finds them.
#pragma GCC diagnostic ignored "-Wuninitialized"
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif
#include <immintrin.h>
#endif

#define ASTERISM_INLINED __attribute__((always_inline))
#define ASTERISM_INLINE [[gnu::always_inline]] static inline

namespace asterism::lanes_v0_1 {
namespace {

#if defined(ASTERISM_LANES_AVX512)

struct Double8 {
  using T = double;
  using V = __m512d;
  using M = __mmask8;
  static constexpr int kLanes = 8;

  ASTERISM_INLINE V set(T a) { return _mm512_set1_pd(a); }
  ASTERISM_INLINE V load(const T* a) { return _mm512_loadu_pd(a); }
  ASTERISM_INLINE void store(T* a, V v) { _mm512_storeu_pd(a, v); }
  // Of some lanes alone; the others are 0, and not touched in memory.
  ASTERISM_INLINE V load(const T* a, M which) { return _mm512_maskz_loadu_pd(which, a); }
  ASTERISM_INLINE void store(T* a, V v, M which) { _mm512_mask_storeu_pd(a, which, v); }
  ASTERISM_INLINE V fma(V a, V b, V c) { return _mm512_fmadd_pd(a, b, c); }    // a b + c
  ASTERISM_INLINE V fnma(V a, V b, V c) { return _mm512_fnmadd_pd(a, b, c); }  // c - a b
  ASTERISM_INLINE V fnms(V a, V b, V c) { return _mm512_fnmsub_pd(a, b, c); }  // -a b - c
  ASTERISM_INLINE V min(V a, V b) { return _mm512_min_pd(a, b); }
  ASTERISM_INLINE V max(V a, V b) { return _mm512_max_pd(a, b); }  // b where one is NaN
  ASTERISM_INLINE V abs(V a) { return _mm512_abs_pd(a); }
  ASTERISM_INLINE V sqrt(V a) { return _mm512_sqrt_pd(a); }
  ASTERISM_INLINE T sum(V a) { return _mm512_reduce_add_pd(a); }
  // a_0 b_0 a_1 b_1 ..., and what follows these.
  ASTERISM_INLINE V low_pairs(V a, V b) {
    return _mm512_permutex2var_pd(a, _mm512_setr_epi64(0, 8, 1, 9, 2, 10, 3, 11), b);
  }
  ASTERISM_INLINE V high_pairs(V a, V b) {
    return _mm512_permutex2var_pd(a, _mm512_setr_epi64(4, 12, 5, 13, 6, 14, 7, 15), b);
  }
  // a_0 a_2 ... b_0 b_2 ..., and those between.
  ASTERISM_INLINE V evens(V a, V b) {
    return _mm512_permutex2var_pd(a, _mm512_setr_epi64(0, 2, 4, 6, 8, 10, 12, 14), b);
  }
  ASTERISM_INLINE V odds(V a, V b) {
    return _mm512_permutex2var_pd(a, _mm512_setr_epi64(1, 3, 5, 7, 9, 11, 13, 15), b);
  }
  ASTERISM_INLINE V rotate(V a) {  // a_1 a_2 ... a_0
    return _mm512_castsi512_pd(_mm512_alignr_epi64(_mm512_castpd_si512(a), _mm512_castpd_si512(a), 1));
  }
  ASTERISM_INLINE V inverse(V a) { return set(1) / a; }  // a shorter chain than a refined estimate
  // Refines an estimate of 14 bits: its relative error e becomes e^4.
  ASTERISM_INLINE V inverse_sqrt(V a) {
    const V y = _mm512_rsqrt14_pd(a);
    const V e = fnma(a * y, y, set(1));
    return fma(y * e, fma(fma(set(0.3125), e, set(0.375)), e, set(0.5)), y);
  }
  // The root of a, to rounding, where inverse_sqrt(a) is known.
  ASTERISM_INLINE V sqrt(V a, V inverse) {
    const V near = a * inverse;
    return fma(fnma(near, near, a), inverse * set(0.5), near);
  }
  ASTERISM_INLINE M less(V a, V b) { return _mm512_cmp_pd_mask(a, b, _CMP_LT_OQ); }
  ASTERISM_INLINE M at_most(V a, V b) { return _mm512_cmp_pd_mask(a, b, _CMP_LE_OQ); }
  ASTERISM_INLINE V select(M m, V a, V b) { return _mm512_mask_blend_pd(m, b, a); }
  ASTERISM_INLINE unsigned bits(M m) { return m; }
  ASTERISM_INLINE M mask(unsigned bits) { return static_cast<M>(bits); }
  ASTERISM_INLINE M both(M a, M b) { return a & b; }
  ASTERISM_INLINE M either(M a, M b) { return a | b; }
  ASTERISM_INLINE M without(M a, M b) { return static_cast<M>(a & ~b); }
};

struct Float16 {
  using T = float;
  using V = __m512;
  using M = __mmask16;
  static constexpr int kLanes = 16;

  ASTERISM_INLINE V set(T a) { return _mm512_set1_ps(a); }
  ASTERISM_INLINE V load(const T* a) { return _mm512_loadu_ps(a); }
  ASTERISM_INLINE void store(T* a, V v) { _mm512_storeu_ps(a, v); }
  ASTERISM_INLINE V load(const T* a, M which) { return _mm512_maskz_loadu_ps(which, a); }
  ASTERISM_INLINE void store(T* a, V v, M which) { _mm512_mask_storeu_ps(a, which, v); }
  ASTERISM_INLINE V fma(V a, V b, V c) { return _mm512_fmadd_ps(a, b, c); }
  ASTERISM_INLINE V fnma(V a, V b, V c) { return _mm512_fnmadd_ps(a, b, c); }
  ASTERISM_INLINE V fnms(V a, V b, V c) { return _mm512_fnmsub_ps(a, b, c); }
  ASTERISM_INLINE V min(V a, V b) { return _mm512_min_ps(a, b); }
  ASTERISM_INLINE V max(V a, V b) { return _mm512_max_ps(a, b); }
  ASTERISM_INLINE V abs(V a) { return _mm512_abs_ps(a); }
  ASTERISM_INLINE V sqrt(V a) { return _mm512_sqrt_ps(a); }
  ASTERISM_INLINE T sum(V a) { return _mm512_reduce_add_ps(a); }
  ASTERISM_INLINE V inverse(V a) {
    const V y = _mm512_rcp14_ps(a);
    return fma(y, fnma(a, y, set(1)), y);
  }
  ASTERISM_INLINE V inverse_sqrt(V a) {
    const V y = _mm512_rsqrt14_ps(a);
    return fma(y * set(0.5F), fnma(a * y, y, set(1)), y);
  }
  ASTERISM_INLINE M less(V a, V b) { return _mm512_cmp_ps_mask(a, b, _CMP_LT_OQ); }
  ASTERISM_INLINE M at_most(V a, V b) { return _mm512_cmp_ps_mask(a, b, _CMP_LE_OQ); }
  ASTERISM_INLINE V select(M m, V a, V b) { return _mm512_mask_blend_ps(m, b, a); }
  ASTERISM_INLINE unsigned bits(M m) { return m; }
  ASTERISM_INLINE M mask(unsigned bits) { return static_cast<M>(bits); }
  ASTERISM_INLINE M both(M a, M b) { return a & b; }
  ASTERISM_INLINE M either(M a, M b) { return a | b; }
  ASTERISM_INLINE M without(M a, M b) { return static_cast<M>(a & ~b); }
};

using DoubleLanes = Double8;
using FloatLanes = Float16;

#elif defined(ASTERISM_LANES_AVX2)

struct Double4 {
  using T = double;
  using V = __m256d;
  using M = __m256d;
  static constexpr int kLanes = 4;

  ASTERISM_INLINE V set(T a) { return _mm256_set1_pd(a); }
  ASTERISM_INLINE V load(const T* a) { return _mm256_loadu_pd(a); }
  ASTERISM_INLINE void store(T* a, V v) { _mm256_storeu_pd(a, v); }
  ASTERISM_INLINE V load(const T* a, M which) { return _mm256_maskload_pd(a, _mm256_castpd_si256(which)); }
  ASTERISM_INLINE void store(T* a, V v, M which) { _mm256_maskstore_pd(a, _mm256_castpd_si256(which), v); }
  ASTERISM_INLINE V fma(V a, V b, V c) { return _mm256_fmadd_pd(a, b, c); }
  ASTERISM_INLINE V fnma(V a, V b, V c) { return _mm256_fnmadd_pd(a, b, c); }
  ASTERISM_INLINE V fnms(V a, V b, V c) { return _mm256_fnmsub_pd(a, b, c); }
  ASTERISM_INLINE V min(V a, V b) { return _mm256_min_pd(a, b); }
  ASTERISM_INLINE V max(V a, V b) { return _mm256_max_pd(a, b); }
  ASTERISM_INLINE V abs(V a) { return _mm256_andnot_pd(_mm256_set1_pd(-0.0), a); }
  ASTERISM_INLINE V sqrt(V a) { return _mm256_sqrt_pd(a); }
  ASTERISM_INLINE T sum(V a) {
    const __m128d two = _mm_add_pd(_mm256_castpd256_pd128(a), _mm256_extractf128_pd(a, 1));
    return _mm_cvtsd_f64(_mm_add_sd(two, _mm_unpackhi_pd(two, two)));
  }
  ASTERISM_INLINE V low_pairs(V a, V b) {
    return _mm256_permute2f128_pd(_mm256_unpacklo_pd(a, b), _mm256_unpackhi_pd(a, b), 0x20);
  }
  ASTERISM_INLINE V high_pairs(V a, V b) {
    return _mm256_permute2f128_pd(_mm256_unpacklo_pd(a, b), _mm256_unpackhi_pd(a, b), 0x31);
  }
  ASTERISM_INLINE V evens(V a, V b) { return _mm256_permute4x64_pd(_mm256_unpacklo_pd(a, b), 0xd8); }
  ASTERISM_INLINE V odds(V a, V b) { return _mm256_permute4x64_pd(_mm256_unpackhi_pd(a, b), 0xd8); }
  ASTERISM_INLINE V rotate(V a) { return _mm256_permute4x64_pd(a, 0x39); }
  ASTERISM_INLINE V inverse(V a) { return set(1) / a; }
  ASTERISM_INLINE V inverse_sqrt(V a) { return set(1) / sqrt(a); }
  ASTERISM_INLINE V sqrt(V a, V) { return sqrt(a); }
  ASTERISM_INLINE M less(V a, V b) { return _mm256_cmp_pd(a, b, _CMP_LT_OQ); }
  ASTERISM_INLINE M at_most(V a, V b) { return _mm256_cmp_pd(a, b, _CMP_LE_OQ); }
  ASTERISM_INLINE V select(M m, V a, V b) { return _mm256_blendv_pd(b, a, m); }
  ASTERISM_INLINE unsigned bits(M m) { return static_cast<unsigned>(_mm256_movemask_pd(m)); }
  ASTERISM_INLINE M mask(unsigned bits) {
    const __m256i bit = _mm256_set_epi64x(8, 4, 2, 1);
    return _mm256_castsi256_pd(
        _mm256_cmpeq_epi64(_mm256_and_si256(_mm256_set1_epi64x(static_cast<long long>(bits)), bit), bit));
  }
  ASTERISM_INLINE M both(M a, M b) { return _mm256_and_pd(a, b); }
  ASTERISM_INLINE M either(M a, M b) { return _mm256_or_pd(a, b); }
  ASTERISM_INLINE M without(M a, M b) { return _mm256_andnot_pd(b, a); }
};

struct Float8 {
  using T = float;
  using V = __m256;
  using M = __m256;
  static constexpr int kLanes = 8;

  ASTERISM_INLINE V set(T a) { return _mm256_set1_ps(a); }
  ASTERISM_INLINE V load(const T* a) { return _mm256_loadu_ps(a); }
  ASTERISM_INLINE void store(T* a, V v) { _mm256_storeu_ps(a, v); }
  ASTERISM_INLINE V load(const T* a, M which) { return _mm256_maskload_ps(a, _mm256_castps_si256(which)); }
  ASTERISM_INLINE void store(T* a, V v, M which) { _mm256_maskstore_ps(a, _mm256_castps_si256(which), v); }
  ASTERISM_INLINE V fma(V a, V b, V c) { return _mm256_fmadd_ps(a, b, c); }
  ASTERISM_INLINE V fnma(V a, V b, V c) { return _mm256_fnmadd_ps(a, b, c); }
  ASTERISM_INLINE V fnms(V a, V b, V c) { return _mm256_fnmsub_ps(a, b, c); }
  ASTERISM_INLINE V min(V a, V b) { return _mm256_min_ps(a, b); }
  ASTERISM_INLINE V max(V a, V b) { return _mm256_max_ps(a, b); }
  ASTERISM_INLINE V abs(V a) { return _mm256_andnot_ps(_mm256_set1_ps(-0.0F), a); }
  ASTERISM_INLINE V sqrt(V a) { return _mm256_sqrt_ps(a); }
  ASTERISM_INLINE T sum(V a) {
    const __m128 four = _mm_add_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps(a, 1));
    const __m128 two = _mm_add_ps(four, _mm_movehl_ps(four, four));
    return _mm_cvtss_f32(_mm_add_ss(two, _mm_shuffle_ps(two, two, 1)));
  }
  ASTERISM_INLINE V inverse(V a) { return set(1) / a; }
  ASTERISM_INLINE V inverse_sqrt(V a) {
    const V y = _mm256_rsqrt_ps(a);
    return fma(y * set(0.5F), fnma(a * y, y, set(1)), y);
  }
  ASTERISM_INLINE M less(V a, V b) { return _mm256_cmp_ps(a, b, _CMP_LT_OQ); }
  ASTERISM_INLINE M at_most(V a, V b) { return _mm256_cmp_ps(a, b, _CMP_LE_OQ); }
  ASTERISM_INLINE V select(M m, V a, V b) { return _mm256_blendv_ps(b, a, m); }
  ASTERISM_INLINE unsigned bits(M m) { return static_cast<unsigned>(_mm256_movemask_ps(m)); }
  ASTERISM_INLINE M mask(unsigned bits) {
    const __m256i bit = _mm256_set_epi32(128, 64, 32, 16, 8, 4, 2, 1);
    return _mm256_castsi256_ps(
        _mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32(static_cast<int>(bits)), bit), bit));
  }
  ASTERISM_INLINE M both(M a, M b) { return _mm256_and_ps(a, b); }
  ASTERISM_INLINE M either(M a, M b) { return _mm256_or_ps(a, b); }
  ASTERISM_INLINE M without(M a, M b) { return _mm256_andnot_ps(b, a); }
};

using DoubleLanes = Double4;
using FloatLanes = Float8;

#elif defined(__SSE2__)

// SSE2 has no loads and stores of some lanes alone.
template <typename L>
ASTERISM_INLINE typename L::V load_one_by_one(const typename L::T* a, unsigned which) {
  typename L::T lanes[L::kLanes];
  for (int i = 0; i < L::kLanes; ++i) lanes[i] = (which >> i & 1U) != 0 ? a[i] : typename L::T(0);
  return L::load(lanes);
}
template <typename L>
ASTERISM_INLINE void store_one_by_one(typename L::T* a, typename L::V v, unsigned which) {
  typename L::T lanes[L::kLanes];
  L::store(lanes, v);
  for (int i = 0; i < L::kLanes; ++i) {
    if ((which >> i & 1U) != 0) a[i] = lanes[i];
  }
}

struct Double2 {
  using T = double;
  using V = __m128d;
  using M = __m128d;
  static constexpr int kLanes = 2;

  ASTERISM_INLINE V set(T a) { return _mm_set1_pd(a); }
  ASTERISM_INLINE V load(const T* a) { return _mm_loadu_pd(a); }
  ASTERISM_INLINE void store(T* a, V v) { _mm_storeu_pd(a, v); }
  ASTERISM_INLINE V load(const T* a, M which) { return load_one_by_one<Double2>(a, bits(which)); }
  ASTERISM_INLINE void store(T* a, V v, M which) { store_one_by_one<Double2>(a, v, bits(which)); }
  ASTERISM_INLINE V fma(V a, V b, V c) { return a * b + c; }
  ASTERISM_INLINE V fnma(V a, V b, V c) { return c - a * b; }
  ASTERISM_INLINE V fnms(V a, V b, V c) { return -(a * b) - c; }
  ASTERISM_INLINE V min(V a, V b) { return _mm_min_pd(a, b); }
  ASTERISM_INLINE V max(V a, V b) { return _mm_max_pd(a, b); }
  ASTERISM_INLINE V abs(V a) { return _mm_andnot_pd(_mm_set1_pd(-0.0), a); }
  ASTERISM_INLINE V sqrt(V a) { return _mm_sqrt_pd(a); }
  ASTERISM_INLINE T sum(V a) { return _mm_cvtsd_f64(_mm_add_sd(a, _mm_unpackhi_pd(a, a))); }
  ASTERISM_INLINE V low_pairs(V a, V b) { return _mm_unpacklo_pd(a, b); }
  ASTERISM_INLINE V high_pairs(V a, V b) { return _mm_unpackhi_pd(a, b); }
  ASTERISM_INLINE V evens(V a, V b) { return _mm_unpacklo_pd(a, b); }
  ASTERISM_INLINE V odds(V a, V b) { return _mm_unpackhi_pd(a, b); }
  ASTERISM_INLINE V rotate(V a) { return _mm_shuffle_pd(a, a, 1); }
  ASTERISM_INLINE V inverse(V a) { return set(1) / a; }
  ASTERISM_INLINE V inverse_sqrt(V a) { return set(1) / sqrt(a); }
  ASTERISM_INLINE V sqrt(V a, V) { return sqrt(a); }
  ASTERISM_INLINE M less(V a, V b) { return _mm_cmplt_pd(a, b); }
  ASTERISM_INLINE M at_most(V a, V b) { return _mm_cmple_pd(a, b); }
  ASTERISM_INLINE V select(M m, V a, V b) { return _mm_or_pd(_mm_and_pd(m, a), _mm_andnot_pd(m, b)); }
  ASTERISM_INLINE unsigned bits(M m) { return static_cast<unsigned>(_mm_movemask_pd(m)); }
  ASTERISM_INLINE M mask(unsigned bits) {
    const double low = (bits & 1U) != 0 ? 1 : 0, high = (bits & 2U) != 0 ? 1 : 0;
    return _mm_cmplt_pd(_mm_setzero_pd(), _mm_set_pd(high, low));
  }
  ASTERISM_INLINE M both(M a, M b) { return _mm_and_pd(a, b); }
  ASTERISM_INLINE M either(M a, M b) { return _mm_or_pd(a, b); }
  ASTERISM_INLINE M without(M a, M b) { return _mm_andnot_pd(b, a); }
};

struct Float4 {
  using T = float;
  using V = __m128;
  using M = __m128;
  static constexpr int kLanes = 4;

  ASTERISM_INLINE V set(T a) { return _mm_set1_ps(a); }
  ASTERISM_INLINE V load(const T* a) { return _mm_loadu_ps(a); }
  ASTERISM_INLINE void store(T* a, V v) { _mm_storeu_ps(a, v); }
  ASTERISM_INLINE V load(const T* a, M which) { return load_one_by_one<Float4>(a, bits(which)); }
  ASTERISM_INLINE void store(T* a, V v, M which) { store_one_by_one<Float4>(a, v, bits(which)); }
  ASTERISM_INLINE V fma(V a, V b, V c) { return a * b + c; }
  ASTERISM_INLINE V fnma(V a, V b, V c) { return c - a * b; }
  ASTERISM_INLINE V fnms(V a, V b, V c) { return -(a * b) - c; }
  ASTERISM_INLINE V min(V a, V b) { return _mm_min_ps(a, b); }
  ASTERISM_INLINE V max(V a, V b) { return _mm_max_ps(a, b); }
  ASTERISM_INLINE V abs(V a) { return _mm_andnot_ps(_mm_set1_ps(-0.0F), a); }
  ASTERISM_INLINE V sqrt(V a) { return _mm_sqrt_ps(a); }
  ASTERISM_INLINE T sum(V a) {
    const V two = _mm_add_ps(a, _mm_movehl_ps(a, a));
    return _mm_cvtss_f32(_mm_add_ss(two, _mm_shuffle_ps(two, two, 1)));
  }
  ASTERISM_INLINE V inverse(V a) { return set(1) / a; }
  ASTERISM_INLINE V inverse_sqrt(V a) { return set(1) / sqrt(a); }
  ASTERISM_INLINE M less(V a, V b) { return _mm_cmplt_ps(a, b); }
  ASTERISM_INLINE M at_most(V a, V b) { return _mm_cmple_ps(a, b); }
  ASTERISM_INLINE V select(M m, V a, V b) { return _mm_or_ps(_mm_and_ps(m, a), _mm_andnot_ps(m, b)); }
  ASTERISM_INLINE unsigned bits(M m) { return static_cast<unsigned>(_mm_movemask_ps(m)); }
  ASTERISM_INLINE M mask(unsigned bits) {
    const __m128i bit = _mm_set_epi32(8, 4, 2, 1);
    return _mm_castsi128_ps(_mm_cmpeq_epi32(_mm_and_si128(_mm_set1_epi32(static_cast<int>(bits)), bit), bit));
  }
  ASTERISM_INLINE M both(M a, M b) { return _mm_and_ps(a, b); }
  ASTERISM_INLINE M either(M a, M b) { return _mm_or_ps(a, b); }
  ASTERISM_INLINE M without(M a, M b) { return _mm_andnot_ps(b, a); }
};

using DoubleLanes = Double2;
using FloatLanes = Float4;

#else

// Plain loops over four lanes, which the compiler maps to the machine's instructions.
template <typename T_>
struct Lanes4 {
  using T = T_;
  static constexpr int kLanes = 4;
  struct M {
    bool at[kLanes];
  };
  struct V {
    T at[kLanes];
    [[gnu::always_inline]] friend inline V operator+(V a, V b) {
      return each([&](int i) ASTERISM_INLINED { return a.at[i] + b.at[i]; });
    }
    [[gnu::always_inline]] friend inline V operator-(V a, V b) {
      return each([&](int i) ASTERISM_INLINED { return a.at[i] - b.at[i]; });
    }
    [[gnu::always_inline]] friend inline V operator*(V a, V b) {
      return each([&](int i) ASTERISM_INLINED { return a.at[i] * b.at[i]; });
    }
  };
  template <typename F>
  ASTERISM_INLINE V each(F&& f) {
    V v;
    for (int i = 0; i < kLanes; ++i) v.at[i] = f(i);
    return v;
  }
  template <typename F>
  ASTERISM_INLINE M each_mask(F&& f) {
    M m;
    for (int i = 0; i < kLanes; ++i) m.at[i] = f(i);
    return m;
  }

  ASTERISM_INLINE V set(T a) {
    return each([&](int) ASTERISM_INLINED { return a; });
  }
  ASTERISM_INLINE V load(const T* a) {
    return each([&](int i) ASTERISM_INLINED { return a[i]; });
  }
  ASTERISM_INLINE void store(T* a, V v) {
    for (int i = 0; i < kLanes; ++i) a[i] = v.at[i];
  }
  ASTERISM_INLINE V load(const T* a, M which) {
    return each([&](int i) ASTERISM_INLINED { return which.at[i] ? a[i] : T(0); });
  }
  ASTERISM_INLINE void store(T* a, V v, M which) {
    for (int i = 0; i < kLanes; ++i) {
      if (which.at[i]) a[i] = v.at[i];
    }
  }
  ASTERISM_INLINE V fma(V a, V b, V c) { return a * b + c; }
  ASTERISM_INLINE V fnma(V a, V b, V c) { return c - a * b; }
  ASTERISM_INLINE V fnms(V a, V b, V c) { return set(0) - a * b - c; }
  ASTERISM_INLINE T sum(V a) { return (a.at[0] + a.at[2]) + (a.at[1] + a.at[3]); }
  ASTERISM_INLINE V low_pairs(V a, V b) {
    return each([&](int i) ASTERISM_INLINED { return (i % 2 == 0 ? a : b).at[i / 2]; });
  }
  ASTERISM_INLINE V high_pairs(V a, V b) {
    return each([&](int i) ASTERISM_INLINED { return (i % 2 == 0 ? a : b).at[kLanes / 2 + i / 2]; });
  }
  ASTERISM_INLINE V evens(V a, V b) {
    return each([&](int i) ASTERISM_INLINED { return (2 * i < kLanes ? a : b).at[2 * i % kLanes]; });
  }
  ASTERISM_INLINE V odds(V a, V b) {
    return each([&](int i) ASTERISM_INLINED { return (2 * i < kLanes ? a : b).at[2 * i % kLanes + 1]; });
  }
  ASTERISM_INLINE V rotate(V a) {
    return each([&](int i) ASTERISM_INLINED { return a.at[(i + 1) % kLanes]; });
  }
  ASTERISM_INLINE V min(V a, V b) { return select(less(a, b), a, b); }
  ASTERISM_INLINE V max(V a, V b) { return select(less(b, a), a, b); }
  ASTERISM_INLINE V abs(V a) {
    return each([&](int i) ASTERISM_INLINED { return a.at[i] < 0 ? -a.at[i] : a.at[i]; });
  }
  ASTERISM_INLINE V sqrt(V a) {
    return each([&](int i) ASTERISM_INLINED {
      if constexpr (sizeof(T) == sizeof(float))
        return __builtin_sqrtf(a.at[i]);
      else
        return __builtin_sqrt(a.at[i]);
    });
  }
  ASTERISM_INLINE V inverse(V a) {
    return each([&](int i) ASTERISM_INLINED { return 1 / a.at[i]; });
  }
  ASTERISM_INLINE V inverse_sqrt(V a) { return inverse(sqrt(a)); }
  ASTERISM_INLINE V sqrt(V a, V) { return sqrt(a); }
  ASTERISM_INLINE M less(V a, V b) {
    return each_mask([&](int i) ASTERISM_INLINED { return a.at[i] < b.at[i]; });
  }
  ASTERISM_INLINE M at_most(V a, V b) {
    return each_mask([&](int i) ASTERISM_INLINED { return a.at[i] <= b.at[i]; });
  }
  ASTERISM_INLINE V select(M m, V a, V b) {
    return each([&](int i) ASTERISM_INLINED { return m.at[i] ? a.at[i] : b.at[i]; });
  }
  ASTERISM_INLINE unsigned bits(M m) {
    unsigned result = 0;
    for (int i = 0; i < kLanes; ++i) result |= (m.at[i] ? 1U : 0U) << i;
    return result;
  }
  ASTERISM_INLINE M mask(unsigned bits) {
    return each_mask([&](int i) ASTERISM_INLINED { return (bits >> i & 1U) != 0; });
  }
  ASTERISM_INLINE M both(M a, M b) {
    return each_mask([&](int i) ASTERISM_INLINED { return a.at[i] && b.at[i]; });
  }
  ASTERISM_INLINE M either(M a, M b) {
    return each_mask([&](int i) ASTERISM_INLINED { return a.at[i] || b.at[i]; });
  }
  ASTERISM_INLINE M without(M a, M b) {
    return each_mask([&](int i) ASTERISM_INLINED { return a.at[i] && !b.at[i]; });
  }
};

using DoubleLanes = Lanes4<double>;
using FloatLanes = Lanes4<float>;

#endif

/// The lanes from `from` on and before `to`.
template <typename L>
ASTERISM_INLINE typename L::M lanes_between(std::ptrdiff_t from, std::ptrdiff_t to) {
  const auto below = [](std::ptrdiff_t lane) ASTERISM_INLINED {
    return lane <= 0 ? 0U : lane < L::kLanes ? (1U << lane) - 1 : ~0U;
  };
  return L::mask(below(to) & ~below(from) & ((1U << L::kLanes) - 1));
}

}  // namespace
}  // namespace asterism::lanes_v0_1
