#pragma once

#include "experiments.hpp"

namespace asterism::bench {

/// Prints what sets the kinds of systems apart.
void kinds(const Selection& selection);

}  // namespace asterism::bench
