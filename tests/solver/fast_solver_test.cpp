// Newton and L-BFGS have the guarantees of every solver.
#include "every_solver.hpp"

namespace asterism {
namespace {

template <typename System>
using DenseLbfgs = Lbfgs<System>;

const bool kFastRegistered = [] {
  register_solvers<Fixed2>("4 nodes", {solver_kind<Newton, Fixed2>(), solver_kind<DenseLbfgs, Fixed2>()});
  register_solvers<Dynamic2>("plane", {solver_kind<DenseLbfgs, Dynamic2>()});
  register_solvers<Dynamic3>("space", {solver_kind<Newton, Dynamic3>()});
  register_solvers<Fixed2f>("4 nodes, float", {solver_kind<DenseLbfgs, Fixed2f>()});
  register_solvers<Bounded3f>("bounded space, float",
                              {solver_kind<Newton, Bounded3f>(), solver_kind<DenseLbfgs, Bounded3f>()});
  return true;
}();

}  // namespace
}  // namespace asterism
