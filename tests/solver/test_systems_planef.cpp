#include "test_systems.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

ASTERISM_TEST_PLANEF()

}  // namespace ASTERISM_ABI
}  // namespace asterism
