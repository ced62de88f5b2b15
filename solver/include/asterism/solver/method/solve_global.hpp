#pragma once

#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/method/auto.hpp>
#include <asterism/solver/method/branch_and_bound.hpp>
#include <asterism/solver/method/make_solver.hpp>
#include <asterism/solver/method/multi_start.hpp>
#include <asterism/solver/run/summary.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The lowest minimum that the library finds, by the strongest method for this type of system:
/// BranchAndBound, which takes up to options.max_seconds if the Staircase alone does not suffice; Staircase
/// for models other than Springs, and for dimensions other than 2 and 3; MultiStart for anisotropic anchors,
/// loads, and links that certify does not support. Summary::lower_bound is the proven bound;
/// Summary::is_within(gap) says whether x is the global minimum. Moves x (Dim x N), the start.
template <typename System>
Summary solve_global(const System& system, typename System::Points& x,
                     const BranchAndBoundOptions& options = {}) {
  const auto solve_by = [&](auto solver) {
    static_cast<AlignedOptions&>(solver.options) = options;
    if (system.has_loads()) solver.options.gap = 0;  // no bound is known
    return solver.solve(system, x);
  };
  if (system.has_loads()) return solve_by(detail::AutoStarts<System>());
  if constexpr (detail::is_searchable<System>()) {
    BranchAndBound<System> solver;
    solver.options = options;
    return solver.solve(system, x);
  } else if constexpr (detail::is_liftable<System>()) {
    return solve_by(detail::AutoStaircase<System>());
  } else {
    return solve_by(detail::AutoStarts<System>());
  }
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
