#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/method/branch_and_bound.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/solver/terms/from_springs.hpp>
#include <asterism/solver/terms/solve.hpp>
#include <string_view>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The lowest minimum that the library finds, by the strongest method for this type of system: BranchAndBound
/// for springs in 2 or 3 dimensions without loads; for all others, solve_global of their terms, which is the
/// staircase, or many starts for loads. Both keep to options.max_seconds; where that ends the search, the
/// status is MaxIterations. Summary::lower_bound is the proven bound; Summary::is_within(gap) says whether x
/// is the global minimum. Moves x (Dim x N), the start. Needs asterism::solver_compiled.
template <HasTerms Springs>
Summary solve_global(const Springs& system, typename Springs::Points& x,
                     const BranchAndBoundOptions& options = {}) {
  if constexpr (detail::is_searchable<Springs>()) {
    if (!system.has_loads()) {
      BranchAndBound<Springs> solver;
      solver.options = options;
      return solver.solve(system, x);
    }
  }
  if (const char* problem = options.problem()) return detail::refused("solve_global", problem);
  return detail::solve_converted(
      "solve_global", detail::FromSprings<Springs>(), system, x,
      [&](const System& terms, Eigen::MatrixXd& points) { return solve_global(terms, points, options); });
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
