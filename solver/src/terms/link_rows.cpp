#include "link_rows_kernel.hpp"
#include "placed_points_kernel.hpp"

// The kernels for all machines, and the choice of one.

namespace asterism::lanes_v0_1 {

double run_avx2(const LinkRows& links);
double run_avx512(const LinkRows& links);
void run_avx2(const PlacedPoints& points);
void run_avx512(const PlacedPoints& points);

namespace {

template <typename Task>
auto run_with_the_widest(const Task& task) {
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

double sum(const LinkRows& links) { return run_with_the_widest(links); }
void place(const PlacedPoints& points) { run_with_the_widest(points); }

}  // namespace asterism::lanes_v0_1
