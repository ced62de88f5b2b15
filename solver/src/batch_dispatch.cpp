#include <asterism/solver/batch/batch_kernels.hpp>

#include "widest.hpp"

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
      if (has_avx2()) return &kAvx2Kernels;
      break;
    case kAvx512:
      if (has_avx512()) return &kAvx512Kernels;
      break;
#endif
    default:
      break;
  }
  return nullptr;
}

}  // namespace asterism::lanes_v0_1
