#include "test_systems.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

ASTERISM_TEST_PLANE()

}  // namespace ASTERISM_ABI

namespace testing {

ASTERISM_TEST_RANDOMS()

}  // namespace testing
}  // namespace asterism
