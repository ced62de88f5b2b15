#define ASTERISM_SYSTEM detail::SpaceSystem
#include "compiled.hpp"
