#pragma once

// The methods of systems of terms as solvers of springs, for tests that need a type or many sizes.

#include <asterism/solver/run/any_solver.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/solver/terms/from_springs.hpp>
#include <string_view>
#include <vector>

namespace asterism::testing {

template <typename Springs>
AnySolver<Springs> by_terms(std::string_view name, const std::vector<NamedOption>& options = {}) {
  return AnySolver<Springs>(system_solvers().make(name, options), detail::FromSprings<Springs>());
}

}  // namespace asterism::testing
