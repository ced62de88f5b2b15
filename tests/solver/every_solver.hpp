#pragma once

// Tests of the guarantees of every solver (every_solver.cpp), for the solvers that a test file registers.
// They use AnySolver: compiled for every type, they would take minutes.

#include <asterism/solver.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace asterism {

using Fixed2 = SpringSystem<double, 2, 4>;
using Dynamic2 = SpringSystem<double, 2>;
using Dynamic3 = SpringSystem<double, 3>;
using Fixed2f = SpringSystem<float, 2, 4>;
using Bounded3f = SpringSystem<float, 3, Eigen::Dynamic, 8>;

/// How to make a solver for systems of one type.
template <typename System>
struct SolverKind {
  std::string_view name;
  AnySolver<System> (*make)();
  AnySolver<System> (*make_with)(const System&, const SolverOptions&);
};

template <template <typename> typename SolverOf, typename System>
SolverKind<System> solver_kind() {
  using S = SolverOf<System>;
  return {S::name(), [] { return AnySolver<System>(S()); },
          [](const System& system, const SolverOptions& options) {
            return AnySolver<System>(S(system, options));
          }};
}

template <typename System>
using DenseIda = Ida<System>;

/// Registers every test for solvers of one type of system; to be called before main().
template <typename System>
void register_solvers(const std::string& system, const std::vector<SolverKind<System>>& kinds);

}  // namespace asterism
