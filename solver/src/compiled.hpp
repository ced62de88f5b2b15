#pragma once

// Macros that instantiate, for one type of system, what <asterism/solver/run/compiled.hpp> declares. Its
// declarations apply here too, so that each source only emits its own instantiations.
#define ASTERISM_SOLVER_COMPILED
#include <asterism/solver.hpp>

// NOLINTBEGIN(bugprone-macro-parentheses): types have none
#define ASTERISM_COMPILE(Solver, System) \
  template ASTERISM_API Summary detail::Compiled::solve(Solver<System>&, const System&, System::Points&);

#define ASTERISM_COMPILE_SOLVERS(System)                                                      \
  ASTERISM_COMPILE(Ida, System)                                                               \
  ASTERISM_COMPILE(Newton, System)                                                            \
  ASTERISM_COMPILE(Lbfgs, System)                                                             \
  ASTERISM_COMPILE(NonlinearCg, System)                                                       \
  ASTERISM_COMPILE(Auto, System)                                                              \
  ASTERISM_COMPILE(detail::ForwardCg, System)                                                 \
  ASTERISM_COMPILE(detail::CentralCg, System)                                                 \
  template ASTERISM_API void detail::Prover<System, detail::SparseFactor<double>>::certify(   \
      const System&, const System::Points&, double, Certificate&);                            \
  template ASTERISM_API SolverRegistry<System> solver_registry();                             \
  template ASTERISM_API Summary solve_ida(const System&, System::Points&, const IdaOptions&); \
  template ASTERISM_API Summary solve(const System&, System::Points&, const ThreadedOptions&);

#define ASTERISM_COMPILE_SPARSE_SOLVERS(System) \
  ASTERISM_COMPILE(SparseIda, System)           \
  ASTERISM_COMPILE(detail::JacobiLbfgs, System)
// NOLINTEND(bugprone-macro-parentheses)
