// Uses every solver of asterism::solver_compiled; compiled_symbols.cmake checks the symbols that this needs.
#include <asterism/solver.hpp>

namespace asterism {

template <typename... Solvers, typename System>
void solve_by(const System& system, typename System::Points& x) {
  (Solvers().solve(system, x), ...);
}

template <typename System>
void solve_by_all(const System& system, typename System::Points& x) {
  solve_by<Ida<System>, Newton<System>, Lbfgs<System>, NonlinearCg<System>, Auto<System>,
           detail::ForwardCg<System>, detail::CentralCg<System>>(system, x);
  if constexpr (System::kNodes == Eigen::Dynamic) {
    solve_by<SparseIda<System>, detail::JacobiLbfgs<System>>(system, x);
  }
}

template void solve_by_all(const detail::PlaneSystem&, detail::PlaneSystem::Points&);
template void solve_by_all(const detail::SpaceSystem&, detail::SpaceSystem::Points&);
template void solve_by_all(const detail::FourPartSystem&, detail::FourPartSystem::Points&);

}  // namespace asterism
