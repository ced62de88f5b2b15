#define ASTERISM_SYSTEM detail::FourPartSystem
#include "compiled.hpp"
