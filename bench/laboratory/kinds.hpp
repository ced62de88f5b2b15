#pragma once

#include "experiments.hpp"

namespace asterism::bench {

/// Prints how the kinds of systems differ.
void kinds(const Selection& selection);

}  // namespace asterism::bench
