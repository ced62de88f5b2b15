#define ASTERISM_POSE_LANES 2
#include "pose_lanes.hpp"

namespace asterism::pose_kernels {

extern const Kernels kAvx2Kernels[2], kAvx512Kernels[2];

namespace {
constexpr Kernels kPortableKernels[2] = {kernels_of<2>(), kernels_of<3>()};
}

int limit_lanes(int most) {
  static int limit = 8;
  const int before = limit;
  if (most > 0) limit = most;
  return before;
}

const Kernels& kernels(int dim) {
#ifdef ASTERISM_POSE_X86
  const int most = limit_lanes(0);
  if (most >= 8 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
      __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("fma"))
    return kAvx512Kernels[dim - 2];
  if (most >= 4 && __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
    return kAvx2Kernels[dim - 2];
#endif
  return kPortableKernels[dim - 2];
}

}  // namespace asterism::pose_kernels
