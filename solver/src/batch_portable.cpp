#include "batch_kernel.hpp"

namespace asterism::lanes_v0_1 {

extern const KernelSet kPortableKernels;
const KernelSet kPortableKernels = kKernels;

}  // namespace asterism::lanes_v0_1
