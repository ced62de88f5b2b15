// IDA, its sparse factorisations, and its accelerations.
#include <asterism/solver/linear/sparse_cholesky.hpp>
#include <asterism/solver/method/ida.hpp>

#include "../comparison_solvers.hpp"
#include "../laboratory.hpp"
#include "asterism_solvers.hpp"

#ifdef ASTERISM_BENCH_CHOLMOD
#include <asterism/solver/linear/cholmod.hpp>
#endif

namespace asterism::bench {
namespace {

const Registration kIda(ours<Ida>("ida", 1000, 0));
const Registration kIdaSparse({"ida-sparse", std::string(Ida<System, SparseCholesky<System>>::name()), kOurs,
                               0, 10000, make_runner<Ida<System, SparseCholesky<System>>>});
#ifdef ASTERISM_BENCH_CHOLMOD
const Registration kIdaCholmod({"ida-cholmod", std::string(CholmodIda<System>::name()), kOurs, 0, 10000,
                                make_runner<CholmodIda<System>>});
#endif

std::unique_ptr<Runner> make_relaxed(int) {
  auto runner = std::make_unique<RunnerOf<Ida<System>>>();
  runner->solver().options.relaxation = 1.7;
  return runner;
}
const Registration kRelaxed({"ida-relaxed", "IDA, over-relaxed by 1.7", kOurs, 1000, 0, make_relaxed});
const Registration kAnderson({"ida-anderson", std::string(AndersonIda<System>::name()), kOurs, 1000, 0,
                              make_runner<AndersonIda<System>>});
const Registration kChebyshev({"ida-chebyshev", std::string(ChebyshevIda<System>::name()), kOurs, 1000, 0,
                               make_runner<ChebyshevIda<System>>});

}  // namespace
}  // namespace asterism::bench
