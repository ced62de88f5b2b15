#include <asterism/solver/reference/liblbfgs.hpp>

#include "../laboratory.hpp"

namespace asterism::bench {
namespace {

using Solver = reference::Liblbfgs<System>;
const Registration kLiblbfgs({"liblbfgs", std::string(Solver::name()), "liblbfgs", 1000, 100000,
                              make_runner<Solver>});

}  // namespace
}  // namespace asterism::bench
