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

int lanes() {
#ifdef ASTERISM_LANES_X86
  if (has_avx512()) return 8;
  if (has_avx2()) return 4;
#endif
  return DoubleLanes::kLanes;
}

}  // namespace asterism::lanes_v0_1
