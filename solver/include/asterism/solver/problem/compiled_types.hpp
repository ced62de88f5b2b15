#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/problem/spring_system.hpp>

// Solvers take seconds each to compile for one type of system. asterism::solver_compiled has them compiled
// for the common types, and defines ASTERISM_SOLVER_COMPILED for its users, so that the headers only declare
// these. Other types are compiled where they are used, as all types are with asterism::solver alone.

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// The types of systems for which asterism::solver_compiled has the solvers.
using PlaneSystem = SpringSystem<double, 2>;
using SpaceSystem = SpringSystem<double, 3>;
using FourPartSystem = SpringSystem<double, 2, 4>;

/// Whether it has Newton's iterations for four nodes of this type in vectors, too.
template <typename System>
inline constexpr bool kHasFourNodes = false;
template <>
inline constexpr bool kHasFourNodes<PlaneSystem> = kIsCompiled;
template <>
inline constexpr bool kHasFourNodes<FourPartSystem> = kIsCompiled;

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism

#ifdef ASTERISM_SOLVER_COMPILED
/// Declares Solver::solve for these types.
#define ASTERISM_COMPILED_SOLVER(Solver)                                                       \
  extern template ASTERISM_API Summary detail::Compiled::solve(                                \
      Solver<detail::PlaneSystem>&, const detail::PlaneSystem&, detail::PlaneSystem::Points&); \
  extern template ASTERISM_API Summary detail::Compiled::solve(                                \
      Solver<detail::SpaceSystem>&, const detail::SpaceSystem&, detail::SpaceSystem::Points&); \
  extern template ASTERISM_API Summary detail::Compiled::solve(                                \
      Solver<detail::FourPartSystem>&, const detail::FourPartSystem&, detail::FourPartSystem::Points&);
/// Declares it for the types without a bound on the number of nodes.
#define ASTERISM_COMPILED_SPARSE_SOLVER(Solver)                                                \
  extern template ASTERISM_API Summary detail::Compiled::solve(                                \
      Solver<detail::PlaneSystem>&, const detail::PlaneSystem&, detail::PlaneSystem::Points&); \
  extern template ASTERISM_API Summary detail::Compiled::solve(                                \
      Solver<detail::SpaceSystem>&, const detail::SpaceSystem&, detail::SpaceSystem::Points&);
/// Declares a function solve(system, x, options) for these types.
#define ASTERISM_COMPILED_SOLVE(solve, Options)                                                              \
  extern template ASTERISM_API Summary solve(const detail::PlaneSystem&, detail::PlaneSystem::Points&,       \
                                             const Options&);                                                \
  extern template ASTERISM_API Summary solve(const detail::SpaceSystem&, detail::SpaceSystem::Points&,       \
                                             const Options&);                                                \
  extern template ASTERISM_API Summary solve(const detail::FourPartSystem&, detail::FourPartSystem::Points&, \
                                             const Options&);
/// Declares the proofs for these types; proofs for other scalars use them, too.
#define ASTERISM_COMPILED_PROVER                                                             \
  extern template ASTERISM_API void                                                          \
  detail::Prover<detail::PlaneSystem, detail::SparseFactor<double>>::certify(                \
      const detail::PlaneSystem&, const detail::PlaneSystem::Points&, double, Certificate&); \
  extern template ASTERISM_API void                                                          \
  detail::Prover<detail::SpaceSystem, detail::SparseFactor<double>>::certify(                \
      const detail::SpaceSystem&, const detail::SpaceSystem::Points&, double, Certificate&); \
  extern template ASTERISM_API void                                                          \
  detail::Prover<detail::FourPartSystem, detail::SparseFactor<double>>::certify(             \
      const detail::FourPartSystem&, const detail::FourPartSystem::Points&, double, Certificate&);
#else
#define ASTERISM_COMPILED_SOLVER(Solver)
#define ASTERISM_COMPILED_SPARSE_SOLVER(Solver)
#define ASTERISM_COMPILED_SOLVE(solve, Options)
#define ASTERISM_COMPILED_PROVER
#endif
