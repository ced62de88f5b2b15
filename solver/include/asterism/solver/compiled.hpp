#pragma once

#include <asterism/solver/config.hpp>
#include <asterism/solver/spring_system.hpp>

// Solvers take long to compile: seconds each for one type of system. asterism::solver_compiled has them ready
// for the common types, and defines ASTERISM_SOLVER_COMPILED for its users, for whom the headers then only
// declare what it has; other types are compiled where they are used, as everything is with asterism::solver.

namespace asterism::inline ASTERISM_ABI::detail {

/// The types of systems that asterism::solver_compiled has the solvers for.
using PlaneSystem = SpringSystem<double, 2>;
using SpaceSystem = SpringSystem<double, 3>;
using FourPartSystem = SpringSystem<double, 2, 4>;

}  // namespace asterism::inline ASTERISM_ABI::detail

#ifdef ASTERISM_SOLVER_COMPILED
/// Declares a solver's class for these types.
#define ASTERISM_COMPILED_SOLVER(Solver)                          \
  extern template class ASTERISM_API Solver<detail::PlaneSystem>; \
  extern template class ASTERISM_API Solver<detail::SpaceSystem>; \
  extern template class ASTERISM_API Solver<detail::FourPartSystem>;
/// Declares a function solve(system, x, options) for these types.
#define ASTERISM_COMPILED_SOLVE(solve, Options)                                                              \
  extern template ASTERISM_API Summary solve(const detail::PlaneSystem&, detail::PlaneSystem::Points&,       \
                                             const Options&);                                                \
  extern template ASTERISM_API Summary solve(const detail::SpaceSystem&, detail::SpaceSystem::Points&,       \
                                             const Options&);                                                \
  extern template ASTERISM_API Summary solve(const detail::FourPartSystem&, detail::FourPartSystem::Points&, \
                                             const Options&);
#else
#define ASTERISM_COMPILED_SOLVER(Solver)
#define ASTERISM_COMPILED_SOLVE(solve, Options)
#endif
