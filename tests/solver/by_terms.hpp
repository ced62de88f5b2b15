#pragma once

// Methods of systems of terms as types of solvers of springs, with the options that tests set.

#include <asterism/solver/run/any_solver.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/solver/terms/from_springs.hpp>
#ifdef ASTERISM_TEST_CHOLMOD
#include <asterism/solver/method/cholmod.hpp>
#endif
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
    return asterism::detail::solve_by_terms(name(), {{"starts", options.starts}}, options, system, x);
  }
};

struct SparseNewtonOptions : AlignedOptions {
  bool escape_saddles = true;
  bool continuation = true;
};

template <typename Springs>
struct SparseNewton {
  SparseNewtonOptions options;
  static constexpr std::string_view name() { return "Newton, sparse LDL^T"; }
  Summary solve(const Springs& system, typename Springs::Points& x) const {
    return asterism::detail::solve_by_terms(
        "newton", {{"escape_saddles", options.escape_saddles}, {"continuation", options.continuation}},
        options, system, x);
  }
};

template <typename Springs>
struct NewtonCg {
  AlignedOptions options;
  static constexpr std::string_view name() { return "Newton-CG"; }
  Summary solve(const Springs& system, typename Springs::Points& x) const {
    return asterism::detail::solve_by_terms("newton-cg", {}, options, system, x);
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

#ifdef ASTERISM_TEST_CHOLMOD
template <typename Springs>
class CholmodNewton {
 public:
  AlignedOptions options;

  static constexpr std::string_view name() { return "Newton, CHOLMOD"; }
  Summary solve(const Springs& springs, typename Springs::Points& x) {
    static_cast<AlignedOptions&>(solver_.options()) = options;
    return solver_.solve(springs, x);
  }

 private:
  AnySolver<Springs> solver_{newton_by_cholmod(), asterism::detail::FromSprings<Springs>()};
};
#endif

}  // namespace asterism::testing
