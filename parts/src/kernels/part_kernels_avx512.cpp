#define ASTERISM_LANES_AVX512

#include "part_kernels_impl.hpp"

namespace asterism::part_kernels_v0_1 {

extern const KernelSet kAvx512Kernels;
const KernelSet kAvx512Kernels = kKernels;

}  // namespace asterism::part_kernels_v0_1
