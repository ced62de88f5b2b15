// Starts on a line, also with nodes that coincide: the methods that promise to leave it end at a local
// minimum, by the eigenvalues of the dense Hessian.
#include <gtest/gtest.h>

#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/hessian.hpp>
#include <asterism/solver/method/auto.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/testing/random_system.hpp>
#include <cmath>
#include <cstdint>
#include <ostream>
#include <tuple>
#ifdef ASTERISM_TEST_CHOLMOD
#include <asterism/solver/method/cholmod.hpp>
#endif

#include "by_terms.hpp"
#include "matrices.hpp"

namespace asterism {
namespace {

using testing::Rng;

template <int Dim>
using System = SpringSystem<double, Dim>;

enum class Start { Apart, Integers, Pairs, OnePoint };

std::ostream& operator<<(std::ostream& out, Start start) {
  const char* const names[] = {"apart", "integers", "pairs", "one point"};
  return out << names[static_cast<int>(start)];
}

// Nodes on the first axis, with anchors there too, whose lengths mostly do not fit on a line.
template <int Dim>
testing::RandomSystem<System<Dim>> on_a_line(std::uint64_t seed, Start start, double anchors) {
  Rng rng(seed);
  const int n = 3 + static_cast<int>(seed % 10);
  System<Dim> system(Topology<>::full(n));
  for (double& k : system.link_stiffness) k = start == Start::Integers ? 1 : rng.uniform(0.5, 2);
  for (double& length : system.rest_length) {
    length = rng.uniform(0.5, 4);
    if (start == Start::Integers) length = std::ceil(length);
  }
  system.anchor_stiffness.setConstant(anchors);
  system.anchors.setZero();
  typename System<Dim>::Points x = System<Dim>::Points::Zero(Dim, n);
  for (int i = 0; i < n; ++i) {
    system.anchors(0, i) = start == Start::Integers ? i : rng.uniform(0, n);
    const double apart = i + rng.uniform(-0.4, 0.4);
    x(0, i) = start == Start::Apart      ? apart
              : start == Start::Integers ? i
              : start == Start::Pairs    ? i / 2
                                         : 0;
  }
  return {system, x};
}

template <typename Solver, int Dim>
void expect_local_minimum(const System<Dim>& system, typename System<Dim>::Points x) {
  Solver solver;
  solver.options.hold_floating = true;
  const Summary summary = solver.solve(system, x);
  EXPECT_EQ(summary.status, Status::Converged) << summary;
  for (const Link& link : system.links())
    EXPECT_GT((x.col(link.i) - x.col(link.j)).norm(), 0) << link.i << " " << link.j << " " << summary;
  const Eigen::VectorXd modes = testing::eigenvalues(hessian(system, x));
  EXPECT_GT(modes.minCoeff(), -1e-5 * modes.maxCoeff()) << summary;
}

class CollinearStart : public ::testing::TestWithParam<std::tuple<Start, double>> {
 public:
  template <template <typename> typename Solver>
  void check() const {
    const auto [start, anchors] = GetParam();
    for (std::uint64_t seed = 1; seed <= 60; ++seed) {
      SCOPED_TRACE(seed);
      const auto [plane, flat] = on_a_line<2>(seed, start, anchors);
      expect_local_minimum<Solver<System<2>>, 2>(plane, flat);
      const auto [space, line] = on_a_line<3>(seed, start, anchors);
      expect_local_minimum<Solver<System<3>>, 3>(space, line);
    }
  }
};

TEST_P(CollinearStart, IsLeftByNewton) { check<Newton>(); }
TEST_P(CollinearStart, IsLeftBySparseNewton) { check<testing::SparseNewton>(); }
TEST_P(CollinearStart, IsLeftByAuto) { check<Auto>(); }
#ifdef ASTERISM_TEST_CHOLMOD
TEST_P(CollinearStart, IsLeftByCholmodNewton) { check<testing::CholmodNewton>(); }
#endif

INSTANTIATE_TEST_SUITE_P(Starts, CollinearStart,
                         ::testing::Combine(::testing::Values(Start::Apart, Start::Integers, Start::Pairs,
                                                              Start::OnePoint),
                                            ::testing::Values(0, 1e-3, 1)));

// Four nodes whose least stress is known from many starts, and a triangle of equal sides.
template <typename Solver>
void expect_known_minima() {
  System<2> four(Topology<>::full(4));
  four.rest_length << 2, 1, 1, 2, 4, 4;
  System<2> triangle(Topology<>::full(3));
  triangle.rest_length.setOnes();
  for (auto [system, least] : {std::pair(&four, 1.5091 / 2), std::pair(&triangle, 0.)}) {
    system->link_stiffness.setOnes();
    system->anchor_stiffness.setZero();
    system->anchors.setZero();
    System<2>::Points x = System<2>::Points::Zero(2, system->nodes());
    x.row(0).setLinSpaced(0, system->nodes() - 1);
    Solver solver;
    solver.options.hold_floating = true;
    const Summary summary = solver.solve(*system, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_NEAR(summary.final_energy, least, 1e-3) << summary;
  }
}

TEST(CollinearStarts, EndAtKnownMinima) {
  expect_known_minima<Newton<System<2>>>();
  expect_known_minima<testing::SparseNewton<System<2>>>();
  expect_known_minima<Auto<System<2>>>();
#ifdef ASTERISM_TEST_CHOLMOD
  expect_known_minima<testing::CholmodNewton<System<2>>>();
#endif
}

}  // namespace
}  // namespace asterism
