#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/batch/batch_kernels.hpp>
#include <string_view>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The instructions that a batch is solved with.
enum class Simd {
  Auto,      ///< the widest that this machine has
  Portable,  ///< what the library was compiled for; SSE2 on x86-64
  Avx2,      ///< with FMA
  Avx512,    ///< F, DQ and VL
};

constexpr std::string_view to_string(Simd simd) {
  switch (simd) {
    case Simd::Auto:
      return "auto";
    case Simd::Portable:
      return "portable";
    case Simd::Avx2:
      return "AVX2";
    case Simd::Avx512:
      return "AVX-512";
  }
  return "unknown instructions";
}

namespace detail {

/// The kernels for these instructions other than Auto, nullptr where there are none.
inline const lanes_v0_1::KernelSet* kernels(Simd simd) {
  switch (simd) {
    case Simd::Portable:
      return lanes_v0_1::kernels(lanes_v0_1::kPortable);
    case Simd::Avx2:
      return lanes_v0_1::kernels(lanes_v0_1::kAvx2);
    case Simd::Avx512:
      return lanes_v0_1::kernels(lanes_v0_1::kAvx512);
    case Simd::Auto:
      break;
  }
  return nullptr;
}

}  // namespace detail

/// Whether the library and this machine have these instructions.
inline bool is_available(Simd simd) { return simd == Simd::Auto || detail::kernels(simd) != nullptr; }

/// All that the library and this machine have, the narrowest first, without Simd::Auto.
inline std::vector<Simd> available_simd() {
  std::vector<Simd> result;
  for (const Simd simd : {Simd::Portable, Simd::Avx2, Simd::Avx512}) {
    if (is_available(simd)) result.push_back(simd);
  }
  return result;
}

/// The instructions that Simd::Auto selects.
inline Simd widest_simd() {
  return is_available(Simd::Avx512) ? Simd::Avx512 : is_available(Simd::Avx2) ? Simd::Avx2 : Simd::Portable;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
