#include "descent_cases.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

ASTERISM_DESCENT_CASES()

}  // namespace ASTERISM_ABI
}  // namespace asterism
