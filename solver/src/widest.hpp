#pragma once

namespace asterism::lanes_v0_1 {
namespace {

#ifdef ASTERISM_LANES_X86
/// Whether this machine has the instructions that the kernels' sources are compiled for.
inline bool has_avx2() { return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"); }
inline bool has_avx512() {
  return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
         __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("fma");
}
#endif

/// Runs a task's kernel for the widest instructions that this machine has: run_avx512(task), run_avx2(task),
/// or run_with_these_instructions(task), which is compiled for all machines.
template <typename Task>
auto run_with_the_widest(Task& task) {
#ifdef ASTERISM_LANES_X86
  if (has_avx512()) return run_avx512(task);
  if (has_avx2()) return run_avx2(task);
#endif
  return run_with_these_instructions(task);
}

}  // namespace
}  // namespace asterism::lanes_v0_1
