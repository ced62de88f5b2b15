#include "sparse_newton_cases.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

ASTERISM_SPARSE_NEWTON_CASES()

}  // namespace ASTERISM_ABI
}  // namespace asterism
