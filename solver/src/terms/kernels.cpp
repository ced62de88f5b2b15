#include "dense_factor_kernel.hpp"
#include "link_rows_kernel.hpp"
#include "placed_points_kernel.hpp"

// The kernels for all machines, and the choice of one.
#include "../widest.hpp"

namespace asterism::lanes_v0_1 {

double run_avx2(const LinkRows& links);
double run_avx512(const LinkRows& links);
void run_avx2(const PlacedPoints& points);
void run_avx512(const PlacedPoints& points);
void run_avx2(const RightHandSides<double>& right);
void run_avx512(const RightHandSides<double>& right);
void run_avx2(const RightHandSides<float>& right);
void run_avx512(const RightHandSides<float>& right);
void run_avx2(const InverseDiagonal& inverse);
void run_avx512(const InverseDiagonal& inverse);
void run_avx2(const Inverse<double>& inverse);
void run_avx512(const Inverse<double>& inverse);
void run_avx2(const Inverse<float>& inverse);
void run_avx512(const Inverse<float>& inverse);
bool run_avx2(const SymmetricMatrix<double>& matrix);
bool run_avx512(const SymmetricMatrix<double>& matrix);
bool run_avx2(const SymmetricMatrix<float>& matrix);
bool run_avx512(const SymmetricMatrix<float>& matrix);

double sum(const LinkRows& links) { return run_with_the_widest(links); }
void place(const PlacedPoints& points) { run_with_the_widest(points); }
void solve(const RightHandSides<double>& right) { run_with_the_widest(right); }
void solve(const RightHandSides<float>& right) { run_with_the_widest(right); }
void invert(const InverseDiagonal& inverse) { run_with_the_widest(inverse); }
void invert(const Inverse<double>& inverse) { run_with_the_widest(inverse); }
void invert(const Inverse<float>& inverse) { run_with_the_widest(inverse); }
bool factorize(const SymmetricMatrix<double>& matrix) { return run_with_the_widest(matrix); }
bool factorize(const SymmetricMatrix<float>& matrix) { return run_with_the_widest(matrix); }

}  // namespace asterism::lanes_v0_1
