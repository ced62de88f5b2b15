// Methods that need the gradient alone: L-BFGS and the paper's nonlinear conjugate gradients.
#include <asterism/solver/linear/jacobi_metric.hpp>
#include <asterism/solver/linear/sparse_cholesky.hpp>
#include <asterism/solver/method/lbfgs.hpp>
#include <asterism/solver/method/nonlinear_cg.hpp>

#include "asterism_solvers.hpp"

namespace asterism::bench {
namespace {

template <template <typename> typename Gradient>
SolverEntry nonlinear_cg(const std::string& name, int dense_nodes, int sparse_nodes) {
  using Solver = NonlinearCg<System, Gradient<System>>;
  return {name, std::string(Solver::name()), kOurs, dense_nodes, sparse_nodes, make_runner<Solver>};
}

const Registration kLbfgs(ours<Lbfgs>("lbfgs", 1000, 0));
using JacobiLbfgs = Lbfgs<System, JacobiMetric<System>>;
const Registration kJacobi({"lbfgs-jacobi", std::string(JacobiLbfgs::name()), kOurs, 1000, 100000,
                            make_runner<JacobiLbfgs>});
using CholeskyLbfgs = Lbfgs<System, SparseCholesky<System>>;
const Registration kCholesky({"lbfgs-cholesky", std::string(CholeskyLbfgs::name()), kOurs, 0, 10000,
                              make_runner<CholeskyLbfgs>});
const Registration kCg(nonlinear_cg<AnalyticGradient>("ncg", 1000, 10000));
const Registration kForward(nonlinear_cg<ForwardDifferences>("ncg-forward", 64, 0));
const Registration kCentral(nonlinear_cg<CentralDifferences>("ncg-central", 64, 0));

}  // namespace
}  // namespace asterism::bench
