#define ASTERISM_LANES_AVX2

#include "link_rows_kernel.hpp"

namespace asterism::lanes_v0_1 {

double sum_avx2(const LinkRows& links);
double sum_avx2(const LinkRows& links) { return sum_with_these_instructions(links); }
PointSums sum_avx2(const PointRow& row);
PointSums sum_avx2(const PointRow& row) { return sum_with_these_instructions(row); }

}  // namespace asterism::lanes_v0_1
