#define ASTERISM_LANES_AVX2

#include "batch_kernel.hpp"

namespace asterism::lanes_v0_1 {

extern const KernelSet kAvx2Kernels;
const KernelSet kAvx2Kernels = kKernels;

}  // namespace asterism::lanes_v0_1
