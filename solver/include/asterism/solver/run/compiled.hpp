#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/problem/compiled_types.hpp>
#include <asterism/solver/run/summary.hpp>
#include <memory>
#include <utility>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// Implements the solvers' `solve`: calls `run` with a workspace of the system's size. This function can be
/// declared for a type without instantiating the solver's class, which takes long to compile.
struct Compiled {
  template <template <typename...> typename Solver, typename System, typename... Policies>
  static Summary solve(Solver<System, Policies...>& solver, const System& system, typename System::Points& x);
};

// Not inline: to inline it, a compiler would instantiate what is compiled elsewhere.
template <template <typename...> typename Solver, typename System, typename... Policies>
Summary Compiled::solve(Solver<System, Policies...>& solver, const System& system,
                        typename System::Points& x) {
  if constexpr (System::kMaxNodes == Eigen::Dynamic && requires { solver.session_; }) {
    // A new solver for another size: Eigen 3.4 frees a matrix before it allocates it in another size, and
    // frees it again in its destructor if that failed.
    if (!solver.session_.fits(system)) {
      auto options = std::move(solver.options);
      std::destroy_at(&solver);  // and constructed, not assigned, which takes longer to compile
      std::construct_at(&solver);
      solver.options = std::move(options);
    }
  }
  return solver.run(system, x);
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
