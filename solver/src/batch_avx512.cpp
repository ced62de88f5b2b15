#define ASTERISM_LANES_AVX512

#include "batch_kernel.hpp"

namespace asterism::lanes_v0_1 {

extern const KernelSet kAvx512Kernels;
const KernelSet kAvx512Kernels = kKernels;

}  // namespace asterism::lanes_v0_1
