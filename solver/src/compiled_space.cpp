#include "compiled.hpp"

namespace asterism::inline ASTERISM_ABI {

ASTERISM_COMPILE_SOLVERS(detail::SpaceSystem)
ASTERISM_COMPILE_SPARSE_SOLVERS(detail::SpaceSystem)

}  // namespace asterism::inline ASTERISM_ABI
