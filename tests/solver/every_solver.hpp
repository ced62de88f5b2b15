#pragma once

// What every solver promises (every_solver.cpp), tested for the solvers that a test file registers. Their
// types are forgotten first: compiled again for every one of them, the tests would take minutes.

#include <asterism/solver.hpp>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace asterism {

using Fixed2 = SpringSystem<double, 2, 4>;
using Dynamic2 = SpringSystem<double, 2>;
using Dynamic3 = SpringSystem<double, 3>;
using Fixed2f = SpringSystem<float, 2, 4>;
using Bounded3f = SpringSystem<float, 3, Eigen::Dynamic, 8>;

template <typename System>
struct AnySolver {
  virtual ~AnySolver() = default;
  virtual Summary solve(const System& system, typename System::Points& x) = 0;
  virtual SolverOptions& options() = 0;
};

template <typename System, Solver<System> SolverType>
struct AnySolverOf final : AnySolver<System> {
  AnySolverOf() = default;
  AnySolverOf(const System& system, const SolverOptions& options) : solver(system, options) {}
  Summary solve(const System& system, typename System::Points& x) override { return solver.solve(system, x); }
  SolverOptions& options() override { return solver.options; }

  SolverType solver;
};

/// How to make the solvers of one type.
template <typename System>
struct SolverKind {
  std::string_view name;
  std::unique_ptr<AnySolver<System>> (*make)();
  std::unique_ptr<AnySolver<System>> (*make_with)(const System&, const SolverOptions&);
};

template <template <typename> typename SolverOf, typename System>
SolverKind<System> solver_kind() {
  using Any = AnySolverOf<System, SolverOf<System>>;
  return {SolverOf<System>::name(),
          []() -> std::unique_ptr<AnySolver<System>> { return std::make_unique<Any>(); },
          [](const System& system, const SolverOptions& options) -> std::unique_ptr<AnySolver<System>> {
            return std::make_unique<Any>(system, options);
          }};
}

template <typename System>
using DenseIda = Ida<System>;

/// Registers every test for solvers of one of these types of systems; to be called before main().
template <typename System>
void register_solvers(const std::string& system, const std::vector<SolverKind<System>>& kinds);

}  // namespace asterism
