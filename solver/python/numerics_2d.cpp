#include "numerics_impl.hpp"

namespace asterism::python {

ASTERISM_INSTANTIATE_NUMERICS(2);

}  // namespace asterism::python
