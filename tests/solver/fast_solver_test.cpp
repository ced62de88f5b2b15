// Newton, L-BFGS and Newton-CG by what every solver promises.
#include "every_solver.hpp"

namespace asterism {
namespace {

template <typename System>
using DenseLbfgs = Lbfgs<System>;
template <typename System>
using JacobiNewtonCg = NewtonCg<System>;

using Cases =
    ::testing::Types<Case<Newton, Fixed2>, Case<Newton, Dynamic3>, Case<Newton, Bounded3f>,
                     Case<DenseLbfgs, Fixed2>, Case<DenseLbfgs, Dynamic2>, Case<DenseLbfgs, Bounded3f>,
                     Case<JacobiNewtonCg, Dynamic2>, Case<JacobiNewtonCg, Fixed2f>>;
INSTANTIATE_TYPED_TEST_SUITE_P(Fast, EverySolver, Cases);

}  // namespace
}  // namespace asterism
