#pragma once

#include <Eigen/Core>
#include <asterism/solver/export.hpp>

/// Library version; the project's CMake version is checked against it by a test.
#define ASTERISM_VERSION_MAJOR 0
#define ASTERISM_VERSION_MINOR 1
#define ASTERISM_VERSION_PATCH 0

// Objects with fixed-size Eigen members change their layout with the SIMD width that Eigen aligns for, and so
// does the way Eigen frees what one side allocated (as it does for gcc's AddressSanitizer). Both are part of
// every symbol's name: a library built for AVX linked into a program that is not becomes a link error instead
// of a crash.
#define ASTERISM_CONCAT_IMPL(a, b) a##b
#define ASTERISM_CONCAT(a, b) ASTERISM_CONCAT_IMPL(a, b)
#define ASTERISM_ABI                                                         \
  ASTERISM_CONCAT(ASTERISM_CONCAT(v0_1_align, EIGEN_MAX_STATIC_ALIGN_BYTES), \
                  ASTERISM_CONCAT(_malloc, EIGEN_MALLOC_ALREADY_ALIGNED))

/// Everything of the library. Headers open it as `namespace asterism::inline ASTERISM_ABI`.
namespace asterism::inline ASTERISM_ABI {}
