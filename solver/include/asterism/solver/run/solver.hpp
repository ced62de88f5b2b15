#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/summary.hpp>
#include <concepts>
#include <string_view>

namespace asterism {
inline namespace ASTERISM_ABI {

/// A minimiser of a spring system's energy. `solve` starts at x and leaves its result there; x must not share
/// memory with the system (InvalidInput otherwise). It never throws, prints or exits. The energy has many
/// stationary points, and the start decides which one is found: it is part of the problem.
template <typename S, typename System>
concept Solver = requires(S solver, const System& system, typename System::Points& x) {
  { solver.solve(system, x) } -> std::same_as<Summary>;
  { solver.options } -> std::convertible_to<SolverOptions>;
  { solver.name() } -> std::convertible_to<std::string_view>;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
