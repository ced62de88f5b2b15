// The lowest minimum from several starts.
#include <asterism/solver/method/auto.hpp>
#include <asterism/solver/method/multi_start.hpp>

#include "asterism_solvers.hpp"

namespace asterism::bench {
namespace {

using MultiStartAuto = MultiStart<System, Auto<System>>;
const Registration kMultiStart({"multi-start", "auto from 8 starts", kOurs, 200, 10000,
                                make_runner<MultiStartAuto>});

}  // namespace
}  // namespace asterism::bench
