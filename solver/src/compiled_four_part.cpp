#include "compiled.hpp"
#include "widest.hpp"

namespace asterism::lanes_v0_1 {

#ifdef ASTERISM_LANES_X86
bool iterate_four_nodes_avx512(FourNodesSearch& at);
bool differentiate_four_nodes_avx512(const FourNodes& at, const FourNodesGradient& gradient);
#endif

bool iterate_four_nodes([[maybe_unused]] FourNodesSearch& at) {
#ifdef ASTERISM_LANES_X86
  if (has_avx512()) return iterate_four_nodes_avx512(at);
#endif
  return false;
}

bool differentiate_four_nodes([[maybe_unused]] const FourNodes& at,
                              [[maybe_unused]] const FourNodesGradient& gradient) {
#ifdef ASTERISM_LANES_X86
  if (has_avx512()) return differentiate_four_nodes_avx512(at, gradient);
#endif
  return false;
}

}  // namespace asterism::lanes_v0_1

namespace asterism {
inline namespace ASTERISM_ABI {

ASTERISM_COMPILE_SOLVERS(detail::FourPartSystem)

}  // namespace ASTERISM_ABI
}  // namespace asterism
