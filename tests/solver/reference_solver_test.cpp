// The references, Ceres, liblbfgs and nonlinear CG with numeric gradients, have the guarantees of every
// solver.
#include <gtest/gtest.h>

#include "every_solver.hpp"

#ifdef ASTERISM_TEST_CERES
#include <asterism/solver/reference/ceres.hpp>
#endif
#ifdef ASTERISM_TEST_LBFGS
#include <asterism/solver/reference/liblbfgs.hpp>
#endif

#include <asterism/testing/random_system.hpp>
#include <cstdint>
#include <string_view>

namespace asterism {
namespace {

template <typename System>
using ForwardCg = NonlinearCg<System, ForwardDifferences<System>>;
template <typename System>
using CentralCg = NonlinearCg<System, CentralDifferences<System>>;

#ifdef ASTERISM_TEST_CERES
template <typename System>
using CeresDense = reference::Ceres<System, reference::CeresMethod::LevenbergMarquardtDense>;
template <typename System>
using CeresSparse = reference::Ceres<System, reference::CeresMethod::LevenbergMarquardtSparse>;
template <typename System>
using CeresLbfgs = reference::Ceres<System, reference::CeresMethod::Lbfgs>;
template <typename System>
using CeresCg = reference::Ceres<System, reference::CeresMethod::NonlinearCg>;
#endif

const bool kReferencesRegistered = [] {
#ifdef ASTERISM_TEST_CERES
  register_solvers<Fixed2>("4 nodes", {solver_kind<CeresDense, Fixed2>()});
  register_solvers<Dynamic2>("plane", {solver_kind<CeresLbfgs, Dynamic2>()});
  register_solvers<Dynamic3>("space", {solver_kind<CeresCg, Dynamic3>()});
  register_solvers<Bounded3f>("bounded space, float", {solver_kind<CeresSparse, Bounded3f>()});
#endif
#ifdef ASTERISM_TEST_LBFGS
  register_solvers<Fixed2>("4 nodes", {solver_kind<reference::Liblbfgs, Fixed2>()});
  register_solvers<Dynamic3>("space", {solver_kind<reference::Liblbfgs, Dynamic3>()});
#endif
  register_solvers<Fixed2>("4 nodes", {solver_kind<ForwardCg, Fixed2>(), solver_kind<CentralCg, Fixed2>()});
  register_solvers<Dynamic3>("space", {solver_kind<CentralCg, Dynamic3>()});
  return true;
}();

testing::RandomSystem<Dynamic2> dynamic_system(std::uint64_t seed, int n) {
  testing::Rng rng(seed);
  return testing::random_system<Dynamic2>(rng, Topology<>::full(n));
}

template <typename Gradient>
void expect_differences(int energies_a_gradient, double accuracy) {
  const auto [system, start] = dynamic_system(1, 6);
  Gradient differences;
  Summary summary;
  summary.energy_evaluations = summary.gradient_evaluations = 0;
  differences.start(characteristic_length(system, start));
  Dynamic2::Points numeric;
  EXPECT_EQ(differences(system, start, numeric, summary), energy(system, start));
  EXPECT_EQ(summary.energy_evaluations, energies_a_gradient);
  EXPECT_EQ(summary.gradient_evaluations, 0);
  const Dynamic2::Points analytic = gradient(system, start);
  const double error = (numeric - analytic).norm() / analytic.norm();
  EXPECT_LT(error, accuracy);
  EXPECT_GT(error, accuracy * 1e-4);  // it is not the analytic gradient

  // A solve takes this many for each gradient, including the one at the start.
  auto x = start;
  NonlinearCg<Dynamic2, Gradient> solver;
  solver.options.tolerance = 1e-6;
  const Summary solved = solver.solve(system, x);
  EXPECT_EQ(solved.status, Status::Converged) << solved;
  EXPECT_EQ(solved.gradient_evaluations, 0);
  EXPECT_EQ(solved.energy_evaluations % energies_a_gradient, 0);
  EXPECT_GT(solved.energy_evaluations, energies_a_gradient * solved.iterations);
}

TEST(NumericGradients, CountEachEnergy) {
  expect_differences<ForwardDifferences<Dynamic2>>(1 + 2 * 6, 1e-6);
  expect_differences<CentralDifferences<Dynamic2>>(1 + 4 * 6, 1e-8);
}

#ifdef ASTERISM_TEST_LBFGS
TEST(LiblbfgsWords, AreInTheMessage) {
  const auto [system, start] = dynamic_system(2, 16);
  reference::Liblbfgs<Dynamic2> solver;
  solver.options.tolerance = 1e-6;
  auto x = start;
  EXPECT_EQ(solver.solve(system, x).message, "LBFGS_STOP (1)");
  x = start;
  solver.options.max_iterations = 3;
  const Summary few = solver.solve(system, x);
  EXPECT_EQ(few.message, "LBFGSERR_MAXIMUMITERATION: the maximum number of iterations (-997)");
  EXPECT_EQ(few.iterations, 3);
  EXPECT_EQ(few.energy_evaluations, few.gradient_evaluations);
  // If liblbfgs gives up, the message says so, and the summary shows how far it came.
  x = start;
  solver.options.max_iterations = 10000;
  solver.options.tolerance = 0;
  const Summary most = solver.solve(system, x);
  EXPECT_EQ(most.status, Status::NoProgress);
  EXPECT_TRUE(std::string_view(most.message).starts_with("LBFGSERR_")) << most;
  EXPECT_LT(most.stationarity, 1e-6);
}
#endif

}  // namespace
}  // namespace asterism
