#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/linear/jacobi_metric.hpp>
#include <asterism/solver/linear/sparse_cholesky.hpp>
#include <asterism/solver/method/auto.hpp>
#include <asterism/solver/method/ida.hpp>
#include <asterism/solver/method/lbfgs.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/method/nonlinear_cg.hpp>
#include <asterism/solver/method/sparse_ida.hpp>
#include <asterism/solver/run/any_solver.hpp>
#include <asterism/solver/run/compiled.hpp>
#ifdef ASTERISM_SOLVER_COMPILED
#include <asterism/solver/method/branch_and_bound.hpp>
#include <asterism/solver/terms/from_springs.hpp>
#endif
#include <string>
#include <string_view>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace detail {

template <typename System>
using ForwardCg = NonlinearCg<System, ForwardDifferences<System>>;
template <typename System>
using CentralCg = NonlinearCg<System, CentralDifferences<System>>;
template <typename System>
using JacobiLbfgs = Lbfgs<System, JacobiMetric<System>>;

/// For SolverRegistry::set_elsewhere: where a method is that the headers alone do not have.
inline std::string compiled_method(std::string_view letters, const std::vector<std::string>&) {
  for (const std::string_view name : {"newton-cg", "newton-sparse", "schwarz", "schwarz-direct",
                                      "multi-start", "staircase", "graduated", "branch-and-bound"}) {
    if (letters == letters_of(name))
      return "asterism::solver_compiled, which has '" + std::string(name) + "'";
  }
  return {};
}

}  // namespace detail

/// The library's solvers of these systems: "auto", "ida", "newton", "lbfgs", "ncg",
/// "ncg-forward", "ncg-central"; for systems without a bound on their nodes also "ida-sparse" and
/// "lbfgs-jacobi". With asterism::solver_compiled also "newton-sparse", which is "newton" of system_methods,
/// and the others of these, such as "newton-cg", "schwarz" and "staircase", except for models that are not
/// made of terms, see to_system; and for springs only, in 2 or 3 dimensions, "branch-and-bound". The adapters
/// of other packages add more: add_cholmod, reference::add_ceres, reference::add_liblbfgs.
template <typename System>
SolverRegistry<System> solver_registry() {
  SolverRegistry<System> registry;
  registry.set_certifier(kept_certifier<System>());
  registry.template add<Auto<System>>("auto");
  registry.template add<Ida<System>>("ida");
  registry.template add<Newton<System>>("newton");
  registry.template add<Lbfgs<System>>("lbfgs");
  registry.template add<NonlinearCg<System>>("ncg");
  registry.template add<detail::ForwardCg<System>>("ncg-forward");
  registry.template add<detail::CentralCg<System>>("ncg-central");
  if constexpr (System::kMaxNodes == Eigen::Dynamic) {
    registry.template add<SparseIda<System>>("ida-sparse");
    registry.template add<detail::JacobiLbfgs<System>>("lbfgs-jacobi");
  }
#ifdef ASTERISM_SOLVER_COMPILED
  registry.set_elsewhere(method_elsewhere);
  if constexpr (HasTerms<System>) {
    registry.add("newton-sparse", [] { return system_solver<System>("newton"); });
    add_system_solvers(registry);
  }
  if constexpr (detail::is_searchable<System>())
    registry.template add<BranchAndBound<System>>("branch-and-bound");
#else
  registry.set_elsewhere(detail::compiled_method);
#endif
  return registry;
}

/// One of these solvers: make_solver<System>("newton", {{"max_iterations", 50}}). Throws as
/// SolverRegistry::make.
template <typename System>
AnySolver<System> make_solver(std::string_view name, const std::vector<NamedOption>& options = {}) {
  return solver_registry<System>().make(name, options);
}

ASTERISM_COMPILED_SOLVER(detail::ForwardCg)
ASTERISM_COMPILED_SOLVER(detail::CentralCg)
ASTERISM_COMPILED_SPARSE_SOLVER(detail::JacobiLbfgs)
#ifdef ASTERISM_SOLVER_COMPILED
extern template ASTERISM_API SolverRegistry<detail::PlaneSystem> solver_registry();
extern template ASTERISM_API SolverRegistry<detail::SpaceSystem> solver_registry();
extern template ASTERISM_API SolverRegistry<detail::FourPartSystem> solver_registry();
#endif

}  // namespace ASTERISM_ABI
}  // namespace asterism
