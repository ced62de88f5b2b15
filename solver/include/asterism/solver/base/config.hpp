#pragma once

#if __cplusplus < 202002L
#error "Asterism needs C++20: -std=c++20"
#endif

#include <Eigen/Core>
#include <asterism/solver/base/export.hpp>

#if defined(Status) || defined(Success) || defined(None) || defined(Bool) || defined(True) || defined(False)
#error \
    "X11's headers define words of Asterism and Eigen (Status, Success, None ...) as macros: include them after ours, or #undef those first"
#endif

/// Library version; the project's CMake version is checked against it by a test.
#define ASTERISM_VERSION_MAJOR 0
#define ASTERISM_VERSION_MINOR 1
#define ASTERISM_VERSION_PATCH 0

// Objects with fixed-size Eigen members change their layout with the SIMD width that Eigen aligns for, and so
// does the way Eigen frees what one side allocated (as it does for gcc's AddressSanitizer). Both are part of
// every symbol's name: a library built for AVX linked into a program that is not becomes a link error instead
// of a crash. So is whether there are exceptions: code without them would forget to catch lack of memory.
#define ASTERISM_CONCAT_IMPL(a, b) a##b
#define ASTERISM_CONCAT(a, b) ASTERISM_CONCAT_IMPL(a, b)
#ifdef __cpp_exceptions
#define ASTERISM_EXCEPTIONS
#else
#define ASTERISM_EXCEPTIONS _noexcept
#endif
#define ASTERISM_ABI                                             \
  ASTERISM_CONCAT(                                               \
      ASTERISM_CONCAT(v0_1_align, EIGEN_MAX_STATIC_ALIGN_BYTES), \
      ASTERISM_CONCAT(ASTERISM_CONCAT(_malloc, EIGEN_MALLOC_ALREADY_ALIGNED), ASTERISM_EXCEPTIONS))

/// Everything of the library. Headers open the two namespaces one after the other, which ctags and Doxygen
/// read.
namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// Whether asterism::solver_compiled is there, and with it the kernels of asterism::system. What it decides
/// may not change the layout of a class.
#ifdef ASTERISM_SOLVER_COMPILED
inline constexpr bool kIsCompiled = true;
#else
inline constexpr bool kIsCompiled = false;
#endif

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
