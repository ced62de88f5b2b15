#pragma once

// Methods for systems of terms as solvers of springs, for lists of types of solvers.

#include <asterism/solver/terms/from_springs.hpp>
#include <string_view>

namespace asterism::testing {

template <typename Springs, bool kDirect>
class SchwarzOf {
 public:
  ThreadedOptions options;

  static constexpr std::string_view name() {
    return kDirect ? "Schwarz, sparse LDL^T" : "Schwarz, Newton-CG";
  }
  Summary solve(const Springs& springs, typename Springs::Points& x) {
    static_cast<AlignedOptions&>(solver_.options()) = options;
    return solver_.solve(springs, x);
  }

 private:
  AnySolver<Springs> solver_ = system_solver<Springs>(kDirect ? "schwarz-direct" : "schwarz");
};

template <typename Springs>
using Schwarz = SchwarzOf<Springs, false>;
template <typename Springs>
using DirectSchwarz = SchwarzOf<Springs, true>;

}  // namespace asterism::testing
