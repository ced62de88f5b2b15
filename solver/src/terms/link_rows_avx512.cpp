#define ASTERISM_LANES_AVX512

#include "link_rows_kernel.hpp"
#include "placed_points_kernel.hpp"

namespace asterism::lanes_v0_1 {

double run_avx512(const LinkRows& links);
double run_avx512(const LinkRows& links) { return run_with_these_instructions(links); }
void run_avx512(const PlacedPoints& points);
void run_avx512(const PlacedPoints& points) { run_with_these_instructions(points); }

}  // namespace asterism::lanes_v0_1
