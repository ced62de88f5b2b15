#define ASTERISM_LANES_AVX512

#include "all_kernels.hpp"

namespace asterism::lanes_v0_1 {

// NOLINTNEXTLINE(bugprone-macro-parentheses): types have none
#define ASTERISM_RUN(Result, function, Task) \
  Result run_avx512(const Task& task);       \
  Result run_avx512(const Task& task) { return run_with_these_instructions(task); }

ASTERISM_FOR_EACH_KERNEL(ASTERISM_RUN)

}  // namespace asterism::lanes_v0_1
