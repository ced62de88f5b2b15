#include "hostile_solvers.hpp"

namespace asterism::hostile {

void solve_line(const Problem& problem, std::vector<Attempt>& attempts) {
  using System = SpringSystem<double, 1>;
  static CommonSolvers<System> common;
  static SparseSolvers<System> sparse;
  static TermSolvers<System> dividing;
  solve_with<System>(common, problem, attempts);
  solve_with<System>(sparse, problem, attempts);
  solve_with<System>(dividing, problem, attempts);
}

}  // namespace asterism::hostile
