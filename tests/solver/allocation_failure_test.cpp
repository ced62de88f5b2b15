// Every allocation of a solver's first solve fails once: OutOfMemory with x as it was, and a solver that then
// solves as a fresh one does. (One that has solved a system of another size is at Eigen's mercy:
// docs/solver.md.)
#include <gtest/gtest.h>

#include <asterism/solver.hpp>
#include <optional>

#ifdef ASTERISM_TEST_CHOLMOD
#include <asterism/solver/cholmod.hpp>
#endif

#include "../../bench/random_system.hpp"
#include "../../bench/sparse_system.hpp"
#include "failing_allocator.hpp"

namespace asterism {
namespace {

using System = SpringSystem<double, 2>;
using Points = System::Points;

template <typename Solver>
class OutOfMemory : public ::testing::Test {};
using Solvers = ::testing::Types<
#ifdef ASTERISM_TEST_CHOLMOD
    CholmodIda<System>, SparseNewton<System, CholmodLlt<System>>,
#endif
    Ida<System>, SparseIda<System>, Newton<System>, Lbfgs<System>, NewtonCg<System>, NonlinearCg<System>,
    Auto<System>, SparseNewton<System>, Schwarz<System>, MultiStart<System, Newton<System>>>;
TYPED_TEST_SUITE(OutOfMemory, Solvers);

using Problem = bench::RandomSystem<System>;

template <typename Solver>
void expect_out_of_memory(const Problem& problem) {
  Points expected = problem.start;
  ASSERT_TRUE(Solver().solve(problem.system, expected).usable());

  // CHOLMOD keeps to another ordering where memory for its best one was lacking.
  const double rounding = Solver::name().ends_with("CHOLMOD") ? 1e-12 : 0;
  std::optional<Solver> solver;
  Points x;
  Summary summary;
  int out_of_memory = 0;
  const auto renew = [&] {
    solver.emplace();
    x = problem.start;
  };
  renew();
  const long allocations =
      testing::fail_each_allocation([&] { summary = solver->solve(problem.system, x); },
                                    [&](long k) {
                                      SCOPED_TRACE(k);
                                      if (summary.status == Status::OutOfMemory) {
                                        ++out_of_memory;
                                        EXPECT_EQ(x, problem.start);
                                      } else {  // a method may do with less
                                        EXPECT_TRUE(summary.usable()) << summary;
                                        EXPECT_TRUE(x.allFinite());
                                      }
                                      x = problem.start;
                                      EXPECT_TRUE(solver->solve(problem.system, x).usable());
                                      EXPECT_LE((x - expected).norm(), rounding);
                                      renew();
                                    });
  EXPECT_TRUE(summary.usable()) << summary;
  EXPECT_EQ(x, expected);
  EXPECT_GT(allocations, 2);
  EXPECT_GT(out_of_memory, 0);
}

TYPED_TEST(OutOfMemory, IsAStatusAndLeavesNothingBehind) {
  bench::Rng rng(1);
  expect_out_of_memory<TypeParam>(bench::random_system<System>(rng, System::TopologyType::full(17)));
}

// Allocations between those of the subdomains' solvers, too.
TEST(OutOfMemorySparse, WithSubdomains) {
  expect_out_of_memory<Schwarz<System>>(bench::sparse_system<System>(1, 700));
}

}  // namespace
}  // namespace asterism
