#include "model_kits.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

ASTERISM_TEST_KITS()

}  // namespace ASTERISM_ABI
}  // namespace asterism
