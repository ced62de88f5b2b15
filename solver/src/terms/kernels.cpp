#include "all_kernels.hpp"

// The kernels for all machines, and the choice of one.
#include "../widest.hpp"

namespace asterism::lanes_v0_1 {

// NOLINTNEXTLINE(bugprone-macro-parentheses): types have none
#define ASTERISM_RUN(Result, function, Task) \
  Result run_avx2(const Task& task);         \
  Result run_avx512(const Task& task);       \
  Result function(const Task& task) { return run_with_the_widest(task); }

ASTERISM_FOR_EACH_KERNEL(ASTERISM_RUN)

bool has_fast_roots() {
#ifdef ASTERISM_LANES_X86
  return has_avx512();  // which estimates them
#else
  return false;
#endif
}

}  // namespace asterism::lanes_v0_1
