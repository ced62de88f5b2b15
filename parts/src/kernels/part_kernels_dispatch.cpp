#include <atomic>

#include "part_kernels.hpp"

namespace asterism::part_kernels_v0_1 {

extern const KernelSet kPortableKernels;
#ifdef ASTERISM_PARTS_X86
extern const KernelSet kAvx2Kernels;
extern const KernelSet kAvx512Kernels;
#endif

namespace {

std::atomic<const KernelSet*> preferred{nullptr};

const KernelSet& widest() {
  for (const Isa isa : {kAvx512, kAvx2})
    if (const KernelSet* const set = kernels(isa)) return *set;
  return kPortableKernels;
}

}  // namespace

const KernelSet* kernels(Isa isa) {
  switch (isa) {
    case kPortable:
      return &kPortableKernels;
#ifdef ASTERISM_PARTS_X86
    case kAvx2:
      if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return &kAvx2Kernels;
      break;
    case kAvx512:
      if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
          __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw") &&
          __builtin_cpu_supports("fma"))
        return &kAvx512Kernels;
      break;
#endif
    default:
      break;
  }
  return nullptr;
}

const KernelSet& kernels() {
  static const KernelSet& automatic = widest();
  const KernelSet* const set = preferred.load();
  return set != nullptr ? *set : automatic;
}

void prefer(const KernelSet* set) { preferred = set; }

}  // namespace asterism::part_kernels_v0_1
