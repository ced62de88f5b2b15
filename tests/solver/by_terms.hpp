#pragma once

// The methods of systems of terms as solvers of springs, by name and as types with the options that tests
// set.

#include <asterism/solver/run/any_solver.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/solver/terms/from_springs.hpp>
#include <string_view>
#include <vector>

namespace asterism::testing {

template <typename Springs>
AnySolver<Springs> by_terms(std::string_view name, const std::vector<NamedOption>& options = {}) {
  return AnySolver<Springs>(system_solvers().make(name, options), asterism::detail::FromSprings<Springs>());
}

template <typename Springs>
struct Staircase {
  StaircaseOptions options;
  static constexpr std::string_view name() { return "staircase"; }
  Summary solve(const Springs& system, typename Springs::Points& x) const {
    return solve_staircase(system, x, options);
  }
};

struct StartsOptions : AlignedOptions {
  int starts = 8;
};

template <typename Springs>
struct MultiStart {
  StartsOptions options;
  static constexpr std::string_view name() { return "multi-start"; }
  Summary solve(const Springs& system, typename Springs::Points& x) const {
    AnySolver<Springs> solver = by_terms<Springs>(name(), {{"starts", options.starts}});
    static_cast<AlignedOptions&>(solver.options()) = options;
    return solver.solve(system, x);
  }
};

}  // namespace asterism::testing
