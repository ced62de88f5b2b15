#include "position_lanes_kernel.hpp"

// The kernels for all machines, and the choice of one.
#include "../widest.hpp"

namespace asterism::lanes_v0_1 {

void run_avx2(const FixTask& task);
void run_avx512(const FixTask& task);
void run_avx2(Cells& cells);
void run_avx512(Cells& cells);

void fix(const FixTask& task) { run_with_the_widest(task); }
void judge(Cells& cells) { run_with_the_widest(cells); }

}  // namespace asterism::lanes_v0_1
