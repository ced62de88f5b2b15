#include "compiled.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

ASTERISM_COMPILE_SOLVERS(detail::FourPartSystem)

}  // namespace ASTERISM_ABI
}  // namespace asterism
