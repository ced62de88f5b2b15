#define ASTERISM_LANES_AVX2

#include "dense_factor_kernel.hpp"
#include "link_rows_kernel.hpp"
#include "placed_points_kernel.hpp"

namespace asterism::lanes_v0_1 {

double run_avx2(const LinkRows& links);
double run_avx2(const LinkRows& links) { return run_with_these_instructions(links); }
void run_avx2(const PlacedPoints& points);
void run_avx2(const PlacedPoints& points) { run_with_these_instructions(points); }
void run_avx2(const RightHandSides<double>& right);
void run_avx2(const RightHandSides<double>& right) { run_with_these_instructions(right); }
void run_avx2(const RightHandSides<float>& right);
void run_avx2(const RightHandSides<float>& right) { run_with_these_instructions(right); }
void run_avx2(const InverseDiagonal& inverse);
void run_avx2(const InverseDiagonal& inverse) { run_with_these_instructions(inverse); }
void run_avx2(const Inverse<double>& inverse);
void run_avx2(const Inverse<double>& inverse) { run_with_these_instructions(inverse); }
void run_avx2(const Inverse<float>& inverse);
void run_avx2(const Inverse<float>& inverse) { run_with_these_instructions(inverse); }
bool run_avx2(const SymmetricMatrix<double>& matrix);
bool run_avx2(const SymmetricMatrix<double>& matrix) { return run_with_these_instructions(matrix); }
bool run_avx2(const SymmetricMatrix<float>& matrix);
bool run_avx2(const SymmetricMatrix<float>& matrix) { return run_with_these_instructions(matrix); }

}  // namespace asterism::lanes_v0_1
