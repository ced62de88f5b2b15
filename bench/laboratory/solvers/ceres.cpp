// Ceres, in all configurations that suit the problem.

#include <asterism/solver/reference/ceres.hpp>

#include "../laboratory.hpp"

namespace asterism::bench {
namespace {

using reference::CeresMethod;

template <CeresMethod kMethod>
SolverEntry ceres(const std::string& name, int dense_nodes, int sparse_nodes) {
  using Solver = reference::Ceres<System, kMethod>;
  return {name,
          std::string(Solver::name()),
          std::string("Ceres ") + reference::ceres_version(),
          dense_nodes,
          sparse_nodes,
          make_runner<Solver>};
}

const Registration kDense(ceres<CeresMethod::LevenbergMarquardtDense>("ceres-dense", 64, 0));
const Registration kSparse(ceres<CeresMethod::LevenbergMarquardtSparse>("ceres-sparse", 200, 10000));
const Registration kLbfgs(ceres<CeresMethod::Lbfgs>("ceres-lbfgs", 200, 0));
const Registration kCg(ceres<CeresMethod::NonlinearCg>("ceres-cg", 64, 0));

}  // namespace
}  // namespace asterism::bench
