#define ASTERISM_LANES_AVX2

#include "part_kernels_impl.hpp"

namespace asterism::part_kernels_v0_1 {

extern const KernelSet kAvx2Kernels;
const KernelSet kAvx2Kernels = kKernels;

}  // namespace asterism::part_kernels_v0_1
