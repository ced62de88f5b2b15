#pragma once

// Methods of systems of terms as types of solvers of springs, with the options that tests set.

#include <asterism/solver/detail/memory.hpp>
#include <asterism/solver/run/any_solver.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/solver/terms/from_springs.hpp>
#include <new>
#include <string_view>

namespace asterism::testing {

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
    Summary summary;
    const auto work = [&] {  // to make the solver may lack memory, too
      AnySolver<Springs> solver = system_solver<Springs>(name(), {{"starts", options.starts}});
      static_cast<AlignedOptions&>(solver.options()) = options;
      summary = solver.solve(system, x);
    };
    asterism::detail::attempt<std::bad_alloc>(work, [&](const std::bad_alloc& error) {
      summary.solver = name();
      summary.status = Status::OutOfMemory;
      summary.message = asterism::detail::memory_message(error);
    });
    return summary;
  }
};

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
