#include <asterism/solver/batch/batch_kernels.hpp>

namespace asterism::lanes_v0_1 {

extern const KernelSet kPortableKernels;
#ifdef ASTERISM_LANES_X86
extern const KernelSet kAvx2Kernels;
extern const KernelSet kAvx512Kernels;
#endif

const KernelSet* kernels(Isa isa) {
  switch (isa) {
    case kPortable:
      return &kPortableKernels;
#ifdef ASTERISM_LANES_X86
    case kAvx2:
      if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return &kAvx2Kernels;
      break;
    case kAvx512:
      if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
          __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("fma"))
        return &kAvx512Kernels;
      break;
#endif
    default:
      break;
  }
  return nullptr;
}

}  // namespace asterism::lanes_v0_1
