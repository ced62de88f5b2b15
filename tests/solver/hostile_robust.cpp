#include "hostile_solvers.hpp"

namespace asterism::hostile {

void solve_robust(const Problem& problem, std::vector<Attempt>& attempts) {
  using System = SpringSystem<double, 2, Eigen::Dynamic, Eigen::Dynamic,
                              Model<Hooke, GemanMcClure, AnchorShape::Anisotropic>>;
  static CommonSolvers<System> common;
  static SparseSolvers<System> sparse;
  static TermSolvers<System> dividing;
  solve_with<System>(common, problem, attempts);
  solve_with<System>(sparse, problem, attempts);
  solve_with<System>(dividing, problem, attempts);
}

}  // namespace asterism::hostile
