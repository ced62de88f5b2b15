#define ASTERISM_LANES_AVX512

#include "position_lanes_kernel.hpp"

namespace asterism::lanes_v0_1 {

void run_avx512(const FixTask& task);
void run_avx512(const FixTask& task) { run_with_these_instructions(task); }
void run_avx512(Cells& cells);
void run_avx512(Cells& cells) { run_with_these_instructions(cells); }

}  // namespace asterism::lanes_v0_1
