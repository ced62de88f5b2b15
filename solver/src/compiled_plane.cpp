#include "compiled.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

ASTERISM_COMPILE_SOLVERS(detail::PlaneSystem)
ASTERISM_COMPILE_SPARSE_SOLVERS(detail::PlaneSystem)

}  // namespace ASTERISM_ABI
}  // namespace asterism
