#include "numerics_impl.hpp"

ASTERISM_PYTHON_NUMERICS(, 2)
