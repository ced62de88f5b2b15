#pragma once

#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/export.hpp>
#include <asterism/solver/run/any_solver.hpp>
#include <asterism/solver/terms/system.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The methods for a System by name, with their options by name, as for every other type of systems:
/// system_solvers().make("multi-start", {{"starts", 50}}). Solvers of one's own can be added.
ASTERISM_API SolverRegistry<System> system_solvers();

}  // namespace ASTERISM_ABI
}  // namespace asterism
