#define ASTERISM_SYSTEM detail::PlaneSystem
#include "compiled.hpp"
