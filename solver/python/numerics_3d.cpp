#include "numerics_impl.hpp"

namespace asterism::python {

ASTERISM_INSTANTIATE_NUMERICS(3);

}  // namespace asterism::python
