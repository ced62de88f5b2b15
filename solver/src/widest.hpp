#pragma once

namespace asterism::lanes_v0_1 {
namespace {

/// Runs a task's kernel for the widest instructions that this machine has: run_avx512(task), run_avx2(task),
/// or run_with_these_instructions(task), which is compiled for all machines.
template <typename Task>
auto run_with_the_widest(Task& task) {
#ifdef ASTERISM_LANES_X86
  const auto has_fma = [] { return __builtin_cpu_supports("fma") != 0; };
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
      __builtin_cpu_supports("avx512vl") && has_fma())
    return run_avx512(task);
  if (__builtin_cpu_supports("avx2") && has_fma()) return run_avx2(task);
#endif
  return run_with_these_instructions(task);
}

}  // namespace
}  // namespace asterism::lanes_v0_1
