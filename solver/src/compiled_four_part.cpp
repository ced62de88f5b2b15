#include "compiled.hpp"

namespace asterism::inline ASTERISM_ABI {

ASTERISM_COMPILE_SOLVERS(detail::FourPartSystem)

}  // namespace asterism::inline ASTERISM_ABI
