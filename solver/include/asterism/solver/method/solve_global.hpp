#pragma once

#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/time_limit.hpp>
#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/method/auto.hpp>
#include <asterism/solver/method/branch_and_bound.hpp>
#include <asterism/solver/method/make_solver.hpp>
#include <asterism/solver/method/multi_start.hpp>
#include <asterism/solver/run/certifier_reference.hpp>
#include <asterism/solver/run/summary.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The lowest minimum that the library finds, by the strongest method for this type of system:
/// BranchAndBound; Staircase for models other than Springs, and for dimensions other than 2 and 3; MultiStart
/// for anisotropic anchors, loads, and links that certify does not support. All of them keep to
/// options.max_seconds; where that ends the search, the status is MaxIterations. Summary::lower_bound is the
/// proven bound; Summary::is_within(gap) says whether x is the global minimum. Moves x (Dim x N), the start.
template <typename System>
Summary solve_global(const System& system, typename System::Points& x,
                     const BranchAndBoundOptions& options = {}) {
  const auto solve_by = [&](auto& solver) {
    if (const char* problem = options.problem()) return detail::refused(solver.name(), problem);
    const detail::TimeLimit time(options.max_seconds, options);
    const CertifierReference certifier = solver.options.certifier;
    static_cast<AlignedOptions&>(solver.options) = options;
    if (!solver.options.certifier) solver.options.certifier = certifier;
    if (system.has_loads()) solver.options.gap = 0;  // no bound is known
    solver.options.on_iteration = time.observed();
    if constexpr (requires { solver.on_lifted_iteration; }) solver.on_lifted_iteration = time.hidden();
    Summary summary = solver.solve(system, x);
    time.explain(summary);
    return summary;
  };
  const auto solve_from_many_starts = [&] {
    Certifier<System> certifier;
    detail::AutoStarts<System> solver;
    solver.options.certifier = certifier;
    return solve_by(solver);
  };
  if (system.has_loads()) return solve_from_many_starts();
  if constexpr (detail::is_searchable<System>()) {
    BranchAndBound<System> solver;
    solver.options = options;
    return solver.solve(system, x);
  } else if constexpr (detail::is_liftable<System>()) {
    detail::AutoStaircase<System> solver;
    return solve_by(solver);
  } else {
    return solve_from_many_starts();
  }
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
