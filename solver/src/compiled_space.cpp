#include "compiled.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

ASTERISM_COMPILE_SOLVERS(detail::SpaceSystem)
ASTERISM_COMPILE_SPARSE_SOLVERS(detail::SpaceSystem)

}  // namespace ASTERISM_ABI
}  // namespace asterism
