#include "part_kernels_impl.hpp"

namespace asterism::part_kernels_v0_1 {

extern const KernelSet kPortableKernels;
const KernelSet kPortableKernels = kKernels;

}  // namespace asterism::part_kernels_v0_1
