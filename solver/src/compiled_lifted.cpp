#include "compiled.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

ASTERISM_COMPILE(NewtonCg, detail::TwiceLiftedPlane)
ASTERISM_COMPILE(NewtonCg, detail::LiftedSpace)
ASTERISM_COMPILE(NewtonCg, detail::TwiceLiftedSpace)

}  // namespace ASTERISM_ABI
}  // namespace asterism
