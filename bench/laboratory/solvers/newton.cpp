// Methods that use the Hessian, and the library's choice.
#include <asterism/solver/linear/dense_cholesky.hpp>
#include <asterism/solver/method/auto.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/method/newton_cg.hpp>
#include <asterism/solver/method/schwarz.hpp>
#include <asterism/solver/method/sparse_newton.hpp>

#include "asterism_solvers.hpp"

namespace asterism::bench {
namespace {

const Registration kNewton(ours<Newton>("newton", 64, 0));
const Registration kNewtonCg({"newton-cg", std::string(NewtonCg<System>::name()), kOurs, 400, 100000,
                              make_runner<NewtonCg<System>>});
using DenseNewtonCg = NewtonCg<System, DenseCholesky<System>>;
const Registration kDenseNewtonCg({"newton-cg-dense", std::string(DenseNewtonCg::name()), kOurs, 400, 0,
                                   make_runner<DenseNewtonCg>});
const Registration kSparseNewton({"newton-sparse", std::string(SparseNewton<System>::name()), kOurs, 100,
                                  100000, make_runner<SparseNewton<System>>});
const Registration kSchwarz({"schwarz", std::string(Schwarz<System>::name()), kOurs, 0, 1000000,
                             make_runner<Schwarz<System>>});
using DirectSchwarz = Schwarz<System, SparseNewton<System>>;
const Registration kDirectSchwarz({"schwarz-direct", std::string(DirectSchwarz::name()), kOurs, 0, 1000000,
                                   make_runner<DirectSchwarz>});
const Registration kAuto(ours<Auto>("auto", 1000, 1000000));

}  // namespace
}  // namespace asterism::bench
