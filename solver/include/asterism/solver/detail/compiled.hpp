#pragma once

#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/run/summary.hpp>
#include <utility>

// Solvers take long to compile: seconds each for one type of system. asterism::solver_compiled has them ready
// for the common types, and defines ASTERISM_SOLVER_COMPILED for its users, for whom the headers then only
// declare what it has; other types are compiled where they are used, as everything is with asterism::solver.

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// The types of systems that asterism::solver_compiled has the solvers for.
using PlaneSystem = SpringSystem<double, 2>;
using SpaceSystem = SpringSystem<double, 3>;
using FourPartSystem = SpringSystem<double, 2, 4>;

/// What the solvers' solve is: their run, with a workspace of the system's size, by a function that can be
/// declared for a type without its solver's class, which takes a compiler long to look into.
struct Compiled {
  template <template <typename...> typename Solver, typename System, typename... Policies>
  static Summary solve(Solver<System, Policies...>& solver, const System& system, typename System::Points& x);
};

// Not inline: for inlining, a compiler looks into what is compiled elsewhere, too.
template <template <typename...> typename Solver, typename System, typename... Policies>
Summary Compiled::solve(Solver<System, Policies...>& solver, const System& system,
                        typename System::Points& x) {
  if constexpr (System::kMaxNodes == Eigen::Dynamic && requires { solver.session_; }) {
    // Anew for another size: Eigen 3.4 frees a matrix before it allocates it in another size, and once more
    // at its end if that failed.
    if (!solver.session_.fits(system)) {
      auto options = std::move(solver.options);
      solver = Solver<System, Policies...>();
      solver.options = std::move(options);
    }
  }
  return solver.run(system, x);
}

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
/// Declares it for those of these types that have no bound on their nodes.
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
/// Declares the proofs for these types, which those of other scalars use, too.
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
