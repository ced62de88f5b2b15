// The solver's headers, compiled with flags and macros that change the behaviour of Eigen and the compiler
// (one line each in CMakeLists.txt): results must agree up to rounding, and bad input must be refused. There
// is no test framework, as exceptions may be off, and the file is small, as it is compiled many times.
#ifdef ASTERISM_TEST_X11_BEFORE
#define Status int  // as X11/Xlib.h does
#endif
#include <asterism/solver.hpp>
#include <asterism/solver/energy/hessian.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#ifdef ASTERISM_TEST_X11_AFTER
#include "x11_macros.hpp"
#endif

#include <cstdio>
#include <cstring>
#include <vector>

namespace {

int failures = 0;

void expect(bool holds, const char* what) {
  if (holds) return;
  ++failures;
  std::printf("wrong: %s\n", what);
}

// Hidden from the optimiser, like input from elsewhere.
double opaque(double value) {
  volatile double copy = value;
  return copy;
}

double not_a_number() {
  const unsigned long long bits = 0x7ff8000000000000ULL;
  double value = 0;
  std::memcpy(&value, &bits, sizeof value);
  return opaque(value);
}

using Four = asterism::SpringSystem<double, 2, 4>;
using Full = Eigen::Matrix<double, 2, 2, Eigen::ColMajor>;

Four four_parts() {
  Four system(asterism::Topology<4>::full());
  system.anchors << 0, 30, 4, 28, 0, 2, 33, 31;
  system.anchor_stiffness << 0.3, 0.1, 0.2, 0.05;
  system.link_stiffness << 1, 2, 0.5, 0.25, 1.5, 1;
  system.rest_length << 28, 30, 44, 41, 29, 30;
  return system;
}

void solve_four_parts() {
  const Four system = four_parts();
  Four::Points x = system.anchors;
  const asterism::Summary summary = asterism::Newton<Four>().solve(system, x);
  std::printf("energy %.12g at x_0 = (%.12g, %.12g)\n", summary.final_energy, x(0, 0), x(1, 0));
  expect(summary.usable() && summary.positive_definite == true, "a strict minimum");
  expect(std::abs(summary.final_energy - 1.74246213735) < 1e-8, "its energy");
  expect(std::abs(x(0, 0) - 0.567929781923) < 1e-6, "its first coordinate");
  const auto all = asterism::covariance(system, x);
  const auto blocks = asterism::node_covariances(system, x);
  expect(all && blocks, "covariances");
  expect((all.matrix * asterism::hessian(system, x)).isIdentity(1e-9), "the inverse of the Hessian");
}

// Matrices that differ from their transposes in memory: information matrices, and a sparse inverse by
// columns.
void invert_many_parts() {
  using Many = asterism::SpringSystem<
      double, 2, Eigen::Dynamic, Eigen::Dynamic,
      asterism::Model<asterism::Hooke, asterism::Quadratic, asterism::AnchorShape::Anisotropic>>;
  constexpr int kSide = 9;
  std::vector<asterism::Link> links;
  for (int i = 0; i < kSide * kSide; ++i) {
    if (i % kSide != kSide - 1) links.push_back({i, i + 1});
    if (i + kSide < kSide * kSide) links.push_back({i, i + kSide});
    if (i % kSide != kSide - 1 && i + kSide < kSide * kSide) links.push_back({i, i + kSide + 1});
  }
  Many system(asterism::Topology<>::from_links(kSide * kSide, links));
  for (int i = 0; i < system.nodes(); ++i) {
    system.anchors(0, i) = i % kSide + 0.1 * (i % 5);
    system.anchors(1, i) = i / kSide + 0.1 * (i % 7);
    Full information;
    information << 2 + i % 3, 0.5, 0.5, 1;
    system.set_anchor_information(i, information);
  }
  system.link_stiffness.setConstant(3);
  system.set_rest_lengths(system.anchors);
  system.rest_length *= 0.95;
  const auto all = asterism::covariance(system, system.anchors);
  const auto blocks = asterism::node_covariances(system, system.anchors);
  expect(asterism::detail::is_large_and_sparse(system), "a sparse path");
  expect(all && blocks, "covariances of many parts");
  if (!all || !blocks) return;
  double worst = 0;
  for (int i = 0; i < system.nodes(); ++i) {
    const Full expected = all.matrix.block<2, 2>(2 * i, 2 * i);
    worst = std::max(worst, (blocks.of(i) - expected).cwiseAbs().maxCoeff());
  }
  std::printf("variance %.12g, sparse off by %.1g\n", all.matrix(0, 0), worst);
  expect(worst < 1e-10, "the sparse covariances");
}

// Enough nodes for rows of springs, whose vectors lie anywhere in memory.
void sum_rows_of_springs() {
  using Rows = asterism::SpringSystem<double, 2>;
  Rows system(asterism::Topology<>::full(11));
  for (int i = 0; i < system.nodes(); ++i) {
    system.anchors(0, i) = i % 4;
    system.anchors(1, i) = i / 4;
  }
  system.anchor_stiffness.setConstant(1);
  system.link_stiffness.setConstant(2);
  system.set_rest_lengths(system.anchors);
  system.rest_length *= 0.5;
  double expected = 0;
  for (const asterism::Link& link : system.links())
    expected += (system.anchors.col(link.i) - system.anchors.col(link.j)).squaredNorm() / 4;
  Rows::Points gradient;
  const double energy = asterism::energy_and_gradient(system, system.anchors, gradient);
  expect(std::abs(energy - expected) < 1e-9 * expected, "the energy of rows of springs");
  expect(std::abs(gradient.sum()) < 1e-9 * expected, "their forces");
}

void refuse_bad_input() {
  using asterism::Newton;
  Newton<Four> solver;
  for (const double bad : {not_a_number(), 1 / opaque(0), -1 / opaque(0)}) {
    for (int where = 0; where < 5; ++where) {
      Four system = four_parts();
      Four::Points x = system.anchors;
      if (where == 0) x(1, 2) = bad;
      if (where == 1) system.anchors(0, 3) = bad;
      if (where == 2) system.anchor_stiffness[1] = bad;
      if (where == 3) system.rest_length[5] = bad;
      if (where == 4) system.link_stiffness[0] = bad;
      const auto summary = solver.solve(system, x);
      expect(!summary.usable() && asterism::to_string(summary.status) == "invalid input", "a refusal");
      expect(!asterism::covariance(system, x), "no covariance");
    }
  }
  Four system = four_parts();
  system.anchors *= opaque(1e200);
  Four::Points x = four_parts().anchors;
  expect(asterism::to_string(solver.solve(system, x).status) == "numerical failure", "an overflow noticed");
  expect(x == four_parts().anchors, "x as it was");
  x = system.anchors;
  solver.options.tolerance = not_a_number();
  expect(!solver.solve(four_parts(), x).usable(), "a bad option refused");
}

}  // namespace

int main() {
  solve_four_parts();
  invert_many_parts();
  sum_rows_of_springs();
  refuse_bad_input();
  return failures == 0 ? 0 : 1;
}
