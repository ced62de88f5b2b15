#pragma once

// Systems of terms that are chosen at run time, and their methods, which are compiled once: asterism::system.
#include <asterism/solver/terms/kinds.hpp>
#include <asterism/solver/terms/solution.hpp>
#include <asterism/solver/terms/solve.hpp>
#include <asterism/solver/terms/system.hpp>
#include <asterism/solver/terms/term.hpp>
