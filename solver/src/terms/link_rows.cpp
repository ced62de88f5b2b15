#include "link_rows_kernel.hpp"
#include "placed_points_kernel.hpp"

// The kernels for all machines, and the choice of one.
#include "../widest.hpp"

namespace asterism::lanes_v0_1 {

double run_avx2(const LinkRows& links);
double run_avx512(const LinkRows& links);
void run_avx2(const PlacedPoints& points);
void run_avx512(const PlacedPoints& points);

double sum(const LinkRows& links) { return run_with_the_widest(links); }
void place(const PlacedPoints& points) { run_with_the_widest(points); }

}  // namespace asterism::lanes_v0_1
