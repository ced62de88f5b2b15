#include "link_rows_kernel.hpp"

// The kernel for all machines, and the choice of one.

namespace asterism::lanes_v0_1 {

double sum_avx2(const LinkRows& links);
double sum_avx512(const LinkRows& links);
PointSums sum_avx2(const PointRow& row);
PointSums sum_avx512(const PointRow& row);

namespace {

template <typename Row>
auto sum_with_the_widest(const Row& row) {
#ifdef ASTERISM_LANES_X86
  const auto has_fma = [] { return __builtin_cpu_supports("fma") != 0; };
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
      __builtin_cpu_supports("avx512vl") && has_fma())
    return sum_avx512(row);
  if (__builtin_cpu_supports("avx2") && has_fma()) return sum_avx2(row);
#endif
  return sum_with_these_instructions(row);
}

}  // namespace

double sum(const LinkRows& links) { return sum_with_the_widest(links); }
PointSums sum(const PointRow& row) { return sum_with_the_widest(row); }

}  // namespace asterism::lanes_v0_1
