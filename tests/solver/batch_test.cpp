#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <asterism/solver/batch/batch_newton.hpp>
#include <asterism/solver/batch/simd.hpp>
#include <asterism/solver/batch/spring_batch.hpp>
#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/hessian.hpp>
#include <asterism/solver/method/ida.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/executor.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/testing/random_system.hpp>
#include <cmath>
#include <limits>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "counting_allocator.hpp"
#include "matrices.hpp"
#include "test_systems.hpp"

namespace asterism {
namespace {

using testing::allocations_in;
using testing::Kind;
using testing::Rng;

using Fixed = SpringSystem<double, 2, 4>;

template <typename System>
using Samples = std::vector<testing::RandomSystem<System>>;

template <typename System>
Samples<System> samples(int count, const typename System::TopologyType& topology, Kind kind = Kind::Lit) {
  Rng rng(3);
  Samples<System> result;
  for (int i = 0; i < count; ++i) result.push_back(testing::random_system<System>(rng, topology, kind));
  return result;
}

template <typename Batch, typename System>
Batch batch_of(const Samples<System>& systems, const typename Batch::TopologyType& topology) {
  Batch batch(topology, static_cast<int>(systems.size()));
  for (int s = 0; s < batch.size(); ++s) {
    const auto& [system, start] = systems[static_cast<std::size_t>(s)];
    batch.set(s, system, start);
  }
  return batch;
}

template <typename System>
double least_eigenvalue(const System& system, const typename System::Points& x) {
  return testing::eigenvalues(hessian(system, x).template cast<double>())[0];
}

/// Checks what must hold for every system of a batch, given the start it was set from.
template <typename Batch>
void expect_sound(const Batch& batch, int s, const typename Batch::Points& start, const char* what = "") {
  typename Batch::System system(batch.topology());
  typename Batch::Points x;
  batch.get(s, system, x);
  const Status status = batch.status(s);
  if (status == Status::InvalidInput || status == Status::NumericalFailure) {
    for (Eigen::Index c = 0; c < x.size(); ++c) {
      EXPECT_TRUE(x(c) == start(c) || (std::isnan(x(c)) && std::isnan(start(c)))) << what;
    }
    return;
  }
  EXPECT_TRUE(status == Status::Converged || status == Status::MaxIterations || status == Status::NoProgress);
  EXPECT_TRUE(x.allFinite()) << what;
  const double before = double(energy(system, start)), after = double(energy(system, x));
  // Rounding of the sums and of the coordinates.
  const double epsilon = double(std::numeric_limits<typename Batch::Scalar>::epsilon());
  const double extent =
      std::max(double(start.cwiseAbs().maxCoeff()), double(system.anchors.cwiseAbs().maxCoeff()));
  const double slack =
      64 * epsilon * before + double(node_stiffness(system).sum()) * std::pow(8 * epsilon * extent, 2);
  EXPECT_LE(after, before + slack) << what << " " << s;
  EXPECT_LE(batch.final_energy(s), batch.initial_energy(s)) << what << " " << s;
  EXPECT_NEAR(double(batch.final_energy(s)), after, slack) << what;
  EXPECT_NEAR(double(batch.initial_energy(s)), before, slack) << what;
  EXPECT_GE(batch.iterations(s), 0);
}

/// A converged system satisfies the library's stopping rule and is not at a saddle.
template <typename Batch>
void expect_minimum(const Batch& batch, int s, double tolerance, const char* what = "") {
  if (batch.status(s) != Status::Converged) return;
  typename Batch::System system(batch.topology());
  typename Batch::Points x;
  batch.get(s, system, x);
  const double rounding = std::is_same_v<typename Batch::Scalar, float> ? 1e-5 : 1e-13;
  EXPECT_LE(stationarity(system, x), tolerance * (1 + 1e-6) + rounding) << what << " " << s;
  // In float, a known saddle may remain because no step away from it exceeds rounding.
  if (std::is_same_v<typename Batch::Scalar, float> && batch.positive_definite(s) == false) return;
  const auto H = hessian(system, x);
  const double least = least_eigenvalue(system, x);
  EXPECT_GT(least, -100 * rounding * double(H.diagonal().maxCoeff())) << what << " " << s;
}

TEST(Batch, ReachesTheMinimaOfNewton) {
  for (const Kind kind : {Kind::Lit, Kind::Track, Kind::Orig, Kind::Disp}) {
    const auto systems = samples<Fixed>(3000, Topology<4>::full(), kind);
    std::vector<double> expected;
    Newton<Fixed> newton;
    for (const auto& [system, start] : systems) {
      auto x = start;
      expected.push_back(newton.solve(system, x).final_energy);
    }
    for (const Simd simd : available_simd()) {
      auto batch = batch_of<SpringBatch<double, 2, 4>>(systems, Topology<4>::full());
      BatchNewton solver(batch);
      solver.simd = simd;
      const BatchSummary summary = solver.solve(batch);
      EXPECT_EQ(summary.status, Status::Converged) << summary.message;
      EXPECT_EQ(summary.converged, 3000);
      EXPECT_EQ(summary.simd, simd);
      EXPECT_LE(summary.by_scalar, 150) << to_string(simd);
      int same = 0;
      for (int s = 0; s < batch.size(); ++s) {
        const auto at = static_cast<std::size_t>(s);
        expect_sound(batch, s, systems[at].start);
        expect_minimum(batch, s, solver.options.tolerance);
        EXPECT_EQ(batch.positive_definite(s), true);
        same += std::abs(batch.final_energy(s) - expected[at]) <= 1e-6 * expected[at];
      }
      EXPECT_GE(same, 2970) << to_string(simd);
    }
  }
}

template <typename Batch>
void expect_minima_of_newton(const typename Batch::TopologyType& topology) {
  using System = typename Batch::System;
  const auto systems = samples<System>(300, topology);
  std::vector<double> expected;
  Newton<System> newton;
  for (const auto& [system, start] : systems) {
    auto x = start;
    expected.push_back(newton.solve(system, x).final_energy);
  }
  for (const Simd simd : available_simd()) {
    auto batch = batch_of<Batch>(systems, topology);
    std::vector<typename Batch::Points> starts(systems.size());
    System system(topology);
    for (int s = 0; s < batch.size(); ++s) batch.get(s, system, starts[static_cast<std::size_t>(s)]);
    BatchNewton<Batch> solver;
    solver.simd = simd;
    const BatchSummary summary = solver.solve(batch);
    EXPECT_GE(summary.converged, 297) << topology.nodes();
    int same = 0;
    for (int s = 0; s < batch.size(); ++s) {
      const auto at = static_cast<std::size_t>(s);
      expect_sound(batch, s, starts[at]);
      expect_minimum(batch, s, solver.options.tolerance);
      same += std::abs(double(batch.final_energy(s)) - expected[at]) <= 1e-5 * expected[at];
    }
    EXPECT_GE(same, topology.nodes() > 5 ? 270 : 294) << topology.nodes() << " " << to_string(simd);
  }
}

// Sizes with a kernel of their own, with the kernel for any size, and without a kernel, which is chosen at
// run time.
TEST(Batch, EverySizeAndScalar) {
  for (const int nodes : {2, 6, 9}) expect_minima_of_newton<SpringBatch<double, 2>>(Topology<>::full(nodes));
  for (const int nodes : {3, 7}) expect_minima_of_newton<SpringBatch<float, 3>>(Topology<>::full(nodes));
  expect_minima_of_newton<SpringBatch<double, 3>>(Topology<>::full(4));
  expect_minima_of_newton<SpringBatch<float, 2, 4>>(Topology<4>::full());
  expect_minima_of_newton<SpringBatch<double, 1>>(Topology<>::full(3));
}

TEST(Batch, InstructionsAgree) {
  const auto systems = samples<Fixed>(2000, Topology<4>::full());
  const auto check = [&]<typename Batch>(std::type_identity<Batch>, double digits) {
    auto reference = batch_of<Batch>(systems, Topology<4>::full());
    BatchNewton<Batch> solver;
    solver.simd = Simd::Portable;
    solver.solve(reference);
    for (const Simd simd : available_simd()) {
      auto batch = batch_of<Batch>(systems, Topology<4>::full());
      solver.simd = simd;
      solver.solve(batch);
      int same = 0;
      for (int s = 0; s < batch.size(); ++s) {
        same += (batch.points(s) - reference.points(s)).norm() < digits &&
                batch.status(s) == reference.status(s) &&
                std::abs(batch.iterations(s) - reference.iterations(s)) <= 1;
      }
      EXPECT_GE(same, 1990) << to_string(simd);
    }
  };
  check(std::type_identity<SpringBatch<double, 2, 4>>(), 1e-7);
  check(std::type_identity<SpringBatch<float, 2, 4>>(), 1e-4);
}

template <typename Batch>
bool same_bits(const Batch& a, const Batch& b) {
  for (int s = 0; s < a.size(); ++s) {
    if (a.points(s) != b.points(s) || a.status(s) != b.status(s) || a.iterations(s) != b.iterations(s) ||
        a.final_energy(s) != b.final_energy(s) || a.initial_energy(s) != b.initial_energy(s) ||
        a.stationarity(s) != b.stationarity(s) || a.positive_definite(s) != b.positive_definite(s))
      return false;
  }
  return true;
}

/// Runs the tasks from the last to the first.
struct Backwards {
  void operator()(int task_count, auto&& f) const {
    while (task_count > 0) f(--task_count);
  }
};

// A system's result depends neither on threads nor on its neighbours or its place in the batch.
TEST(Batch, ThreadsAndPlacesAgreeBitForBit) {
  const int count = 6000;
  const auto systems = samples<Fixed>(count, Topology<4>::full());
  for (const Simd simd : available_simd()) {
    auto one = batch_of<SpringBatch<double, 2, 4>>(systems, Topology<4>::full());
    auto reversed = one, halved = one;
    BatchNewton solver(one);
    solver.simd = simd;
    for (const int threads : {1, 2, 3, 16}) {
      auto many = batch_of<SpringBatch<double, 2, 4>>(systems, Topology<4>::full());
      solver.solve(many, ThreadExecutor{threads});
      if (threads == 1) one = many;
      EXPECT_TRUE(same_bits(one, many)) << threads;
    }
    solver.solve(halved, Backwards());
    EXPECT_TRUE(same_bits(one, halved));
    for (int s = 0; s < count; ++s) {
      const auto& [system, start] = systems[static_cast<std::size_t>(count - 1 - s)];
      reversed.set(s, system, start);
    }
    solver.solve(reversed, ThreadExecutor());
    for (int s = 0; s < count; ++s) {
      ASSERT_EQ(one.points(s), reversed.points(count - 1 - s)) << s;
      ASSERT_EQ(one.iterations(s), reversed.iterations(count - 1 - s));
    }
  }
}

TEST(Batch, AnyNumberOfSystems) {
  const auto all = samples<Fixed>(70, Topology<4>::full());
  auto full = batch_of<SpringBatch<double, 2, 4>>(all, Topology<4>::full());
  for (const Simd simd : available_simd()) {
    BatchNewton solver(full);
    solver.simd = simd;
    full = batch_of<SpringBatch<double, 2, 4>>(all, Topology<4>::full());
    solver.solve(full);
    for (int count = 0; count <= 70; ++count) {
      const Samples<Fixed> some(all.begin(), all.begin() + count);
      auto batch = batch_of<SpringBatch<double, 2, 4>>(some, Topology<4>::full());
      const BatchSummary summary = solver.solve(batch);
      EXPECT_EQ(summary.status, Status::Converged);
      EXPECT_EQ(summary.converged, count);
      for (int s = 0; s < count; ++s) EXPECT_EQ(batch.points(s), full.points(s));
    }
  }
}

/// Makes a system awkward in one of many ways.
template <typename System>
void make_awkward(int sort, System& system, typename System::Points& x, Rng& rng) {
  using Scalar = typename System::Scalar;
  constexpr Scalar kNan = std::numeric_limits<Scalar>::quiet_NaN();
  constexpr Scalar kHuge = std::numeric_limits<Scalar>::max() / 2;
  switch (sort) {
    case 0:
      x.col(1) = x.col(0);
      break;
    case 1:
      x.colwise() = x.col(0).eval();
      break;
    case 2:
      system.anchors.setConstant(5);
      x.setConstant(5);
      break;
    case 3:
      system.link_stiffness.setZero();
      break;
    case 4:
      system.rest_length.setZero();
      break;
    case 5:
      system.anchor_stiffness *= Scalar(1e-12);
      break;
    case 6:
      system.anchor_stiffness *= Scalar(1e-4);
      break;
    case 7:
      system.link_stiffness[0] = Scalar(1e14);
      system.rest_length[0] = Scalar(1e-6);
      break;
    case 8:
      x.row(1).setZero();
      system.anchors.row(1).setZero();
      break;
    case 9:
      x(0, 2) = kNan;
      break;
    case 10:
      system.anchors(1, 0) = kNan;
      break;
    case 11:
      system.link_stiffness[1] = -1;
      break;
    case 12:
      system.rest_length[1] = kNan;
      break;
    case 13:
      system.anchor_stiffness.setZero();
      break;
    case 14:  // a node that nothing holds
      system.anchor_stiffness[0] = 0;
      for (int l = 0; l < system.link_count(); ++l) {
        const Link link = system.links()[static_cast<std::size_t>(l)];
        if (link.i == 0 || link.j == 0) system.link_stiffness[l] = 0;
      }
      break;
    case 15:  // nodes held only by others
      system.anchor_stiffness[0] = system.anchor_stiffness[1] = 0;
      break;
    case 16:
      x *= kHuge;
      break;
    case 17:
      system.link_stiffness.setConstant(kHuge);
      break;
    case 18:  // at rest at the anchors
      system.set_rest_lengths(system.anchors);
      break;
    case 19:
      system.set_rest_lengths(system.anchors);
      x = system.anchors;
      break;
    case 20:
      system.rest_length.setZero();
      system.anchors.setZero();
      break;
    case 21:
      system.link_stiffness *= Scalar(1e-20);
      break;
    case 22:
      system.anchors.col(1) = system.anchors.col(0);
      break;
    case 23:
      x(1, 1) = std::numeric_limits<Scalar>::infinity();
      break;
    case 24:  // collinear in reverse order, near a saddle
      x.row(1).setConstant(Scalar(1e-9));
      system.anchors.row(1).setZero();
      x.row(0).reverseInPlace();
      break;
    case 25:
      system.anchor_stiffness *= Scalar(1e12);
      break;
    case 26:  // springs without stiffness whose values would overflow
      system.anchor_stiffness[1] = system.link_stiffness[0] = 0;
      system.anchors.col(1).setConstant(-2 * kHuge);
      system.rest_length[0] = 2 * kHuge;
      break;
    case 27:  // an anchor with hardly any stiffness
      system.anchor_stiffness[0] *= Scalar(1e-12);
      system.anchors.col(0).setConstant(Scalar(1e8));
      break;
    case 28:  // a distant start
      x.array() += Scalar(1e5);
      break;
    case 29:
      x.array() += std::is_same_v<Scalar, double> ? Scalar(1e17) : Scalar(1e9);
      break;
    default:
      x += testing::random_points<System>(rng, system.nodes(), -1, 1);
      break;
  }
}
constexpr int kSorts = 31;

template <typename Batch>
void expect_awkward_sound(const typename Batch::TopologyType& topology) {
  using System = typename Batch::System;
  auto systems = samples<System>(kSorts * 30, topology);
  Rng rng(9);
  for (int s = 0; s < static_cast<int>(systems.size()); ++s) {
    auto& [system, start] = systems[static_cast<std::size_t>(s)];
    if (s / 3 % 2 == 0) make_awkward(s % kSorts, system, start, rng);
  }
  std::vector<Status> expected;
  std::vector<typename System::Points> starts;
  for (const Simd simd : available_simd()) {
    auto batch = batch_of<Batch>(systems, topology);
    if (expected.empty()) {
      System system(topology);
      for (int s = 0; s < batch.size(); ++s) {
        typename System::Points x;
        batch.get(s, system, x);
        starts.push_back(x);
        expected.push_back(Newton<System>().solve(system, x).status);
      }
    }
    BatchNewton<Batch> solver;
    solver.simd = simd;
    const BatchSummary summary = solver.solve(batch);
    int converged = 0;
    for (int s = 0; s < batch.size(); ++s) {
      const auto at = static_cast<std::size_t>(s);
      const bool is_awkward = s / 3 % 2 == 0;
      const std::string what =
          std::string(to_string(simd)) + ", sort " + std::to_string(is_awkward ? s % kSorts : -1);
      expect_sound(batch, s, starts[at], what.c_str());
      expect_minimum(batch, s, solver.options.tolerance, what.c_str());
      const Status status = batch.status(s);
      converged += status == Status::Converged;
      // InvalidInput agrees with Newton; and where Newton converges, so does the batch.
      EXPECT_EQ(status == Status::InvalidInput, expected[at] == Status::InvalidInput) << what;
      EXPECT_EQ(status == Status::NumericalFailure, expected[at] == Status::NumericalFailure) << what;
      if (std::is_same_v<typename Batch::Scalar, double> && expected[at] == Status::Converged) {
        EXPECT_EQ(status, Status::Converged) << what << " " << s;
      }
    }
    EXPECT_EQ(converged, summary.converged);
    ASSERT_GE(summary.first_failure, 0);
    EXPECT_EQ(batch.status(summary.first_failure), summary.status);
  }
}

TEST(Batch, AwkwardSystemsAndTheirNeighbours) {
  expect_awkward_sound<SpringBatch<double, 2, 4>>(Topology<4>::full());
  expect_awkward_sound<SpringBatch<float, 2, 4>>(Topology<4>::full());
  expect_awkward_sound<SpringBatch<double, 3>>(Topology<>::full(4));
  expect_awkward_sound<SpringBatch<double, 2>>(Topology<>::star(5, 2));
}

// The lanes' stopping rule gives the same number as stationarity.hpp, whatever the stiffness of the springs.
TEST(Batch, MeasuresAsTheScalarRule) {
  const auto check = []<typename Batch>(std::type_identity<Batch>, double digits) {
    using System = typename Batch::System;
    using Scalar = typename Batch::Scalar;
    const auto topology = Topology<>::full(5);
    auto systems = samples<System>(700, topology);
    for (std::size_t s = 0; s < systems.size(); ++s) {
      auto& [system, start] = systems[s];
      if (s % 7 == 1) system.anchor_stiffness *= Scalar(1e-6);
      if (s % 7 == 2) system.link_stiffness *= Scalar(1e-5);
      if (s % 7 == 3) system.anchor_stiffness[2] = 0, system.anchors.col(2).setConstant(Scalar(1e18));
      if (s % 7 == 4) system.link_stiffness[3] = 0, system.rest_length[3] = Scalar(1e18);
      if (s % 7 == 5) system.link_stiffness.setZero();
      if (s % 7 == 6) {  // an isolated node
        for (const int l : {0, 1, 2, 3}) system.link_stiffness[l] = 0;
        system.anchors.col(0).setConstant(Scalar(100));
      }
    }
    for (const Simd simd : available_simd()) {
      auto batch = batch_of<Batch>(systems, topology);
      BatchNewton<Batch> solver;
      solver.simd = simd;
      solver.options.max_iterations = 1;
      const BatchSummary summary = solver.solve(batch);
      EXPECT_LT(summary.by_scalar, 200) << to_string(simd);
      for (int s = 0; s < batch.size(); ++s) {
        System system(topology);
        typename Batch::Points x;
        batch.get(s, system, x);
        const double expected = stationarity(system, x);
        EXPECT_NEAR(double(batch.stationarity(s)), expected, digits * (1e-3 + expected))
            << to_string(simd) << ", sort " << s % 7;
      }
    }
  };
  check(std::type_identity<SpringBatch<double, 2>>(), 1e-9);
  check(std::type_identity<SpringBatch<float, 3>>(), 1e-3);
}

// Values of springs without stiffness may become infinite in float, and only anchors with stiffness determine
// the origin.
TEST(Batch, FloatTakesSpringsThatAreOffAndWeakAnchorsFarOff) {
  for (const double far : {1e6, 1e160, std::numeric_limits<double>::max()}) {
    for (const double stiffness : {0.0, 1e-12}) {
      auto [system, start] = samples<Fixed>(1, Topology<4>::full(), Kind::Track)[0];
      system.anchor_stiffness[1] = stiffness;
      if (stiffness == 0 || far == 1e6) system.anchors.col(1).setConstant(-far);
      system.link_stiffness[0] = stiffness;
      if (stiffness == 0) system.rest_length[0] = far;
      auto x = start;
      Newton<Fixed>().solve(system, x);
      SpringBatch<float, 2, 4> batch(Topology<4>::full(), 1);
      batch.set(0, system, start);
      EXPECT_EQ(BatchNewton(batch).solve(batch).status, Status::Converged) << far;
      EXPECT_LT((batch.points(0) - x).norm(), 1e-3) << far;
    }
  }
}

TEST(Batch, SaddlesAreLeft) {
  Fixed system(Topology<4>::full());
  system.anchors << 0, 10, 20, 30, 0, 0, 0, 0;
  system.anchor_stiffness.setConstant(0.01);
  Fixed::Points square;
  square << 0, 20, 20, 0, 0, 0, 20, 20;
  system.set_rest_lengths(square);
  system.link_stiffness.setOnes();
  Fixed::Points saddle = system.anchors;
  solve_ida(system, saddle);
  ASSERT_LT(least_eigenvalue(system, saddle), -0.1);
  for (const Simd simd : available_simd()) {
    SpringBatch<double, 2, 4> batch(Topology<4>::full(), 3);
    batch.set(0, system, saddle);
    batch.set(1, system, system.anchors);
    batch.set(2, system, square);
    BatchNewton solver(batch);
    solver.simd = simd;
    EXPECT_EQ(solver.solve(batch).status, Status::Converged);
    for (int s = 0; s < 3; ++s) {
      EXPECT_GT(least_eigenvalue(system, batch.points(s)), 0);
      EXPECT_EQ(batch.positive_definite(s), true);
    }
    batch.set(0, system, saddle);
    solver.options.escape_saddles = false;
    solver.solve(batch);
    EXPECT_EQ(batch.points(0), saddle);
    EXPECT_EQ(batch.positive_definite(0), false);
  }
}

// Systems with weak anchors are solved in the lanes.
TEST(Batch, WeakAnchors) {
  for (const double weakness : {1e-2, 1e-4, 1e-8, 1e-12}) {
    auto systems = samples<Fixed>(500, Topology<4>::full());
    for (auto& [system, start] : systems) system.anchor_stiffness *= weakness;
    for (const Simd simd : available_simd()) {
      auto batch = batch_of<SpringBatch<double, 2, 4>>(systems, Topology<4>::full());
      BatchNewton solver(batch);
      solver.simd = simd;
      const BatchSummary summary = solver.solve(batch);
      EXPECT_EQ(summary.converged, 500);
      EXPECT_LE(summary.by_scalar, 100);
      for (int s = 0; s < batch.size(); ++s) expect_minimum(batch, s, 1e-8);
    }
  }
}

TEST(Batch, AnyTopology) {
  const std::array<Link, 5> chain = {Link{0, 1}, {2, 1}, {2, 3}, {3, 4}, {0, 1}};  // with a duplicate link
  const std::array<Link, 3> permuted = {Link{2, 1}, {0, 2}, {1, 0}};
  const std::array<Topology<>, 6> topologies = {Topology<>::star(6, 0),
                                                Topology<>::from_links(5, chain),
                                                Topology<>::from_links(3, permuted),
                                                Topology<>::from_links(3, {}),
                                                Topology<>::full(15),
                                                Topology<>::star(40, 3)};
  for (const Topology<>& topology : topologies) {
    using System = SpringSystem<double, 2>;
    const auto systems = samples<System>(100, topology);
    std::vector<double> expected;
    for (const auto& [system, start] : systems) {
      auto x = start;
      expected.push_back(Newton(system).solve(system, x).final_energy);
    }
    for (const Simd simd : available_simd()) {
      auto batch = batch_of<SpringBatch<double, 2>>(systems, topology);
      BatchNewton solver(batch);
      solver.simd = simd;
      EXPECT_EQ(solver.solve(batch).converged, 100);
      int same = 0;
      for (int s = 0; s < batch.size(); ++s) {
        const auto at = static_cast<std::size_t>(s);
        expect_sound(batch, s, systems[at].start);
        expect_minimum(batch, s, 1e-8);
        same += std::abs(batch.final_energy(s) - expected[at]) <= 1e-6 * expected[at] + 1e-20;
      }
      EXPECT_GE(same, topology.nodes() > 6 ? 80 : 97) << topology.nodes();
    }
  }
}

// Errors of the float batch far from the origin, compared with double at the origin.
TEST(Batch, FloatKeepsItsDigitsFarFromTheOrigin) {
  const auto systems = samples<Fixed>(1000, Topology<4>::full(), Kind::Track);
  for (const double offset : {0.0, 1e4, 1e6}) {
    auto moved = systems;
    for (auto& [system, start] : moved) {
      system.anchors.array() += offset;
      start.array() += offset;
    }
    for (const Simd simd : available_simd()) {
      auto batch = batch_of<SpringBatch<float, 2, 4>>(moved, Topology<4>::full());
      BatchNewton<SpringBatch<float, 2, 4>> solver;
      solver.simd = simd;
      EXPECT_EQ(solver.solve(batch).status, Status::Converged);
      std::vector<double> errors;
      for (int s = 0; s < batch.size(); ++s) {
        const auto& [system, start] = systems[static_cast<std::size_t>(s)];
        auto x = start;
        Newton(system).solve(system, x);
        errors.push_back((batch.points(s).array() - offset - x.array()).abs().maxCoeff());
      }
      std::sort(errors.begin(), errors.end());
      EXPECT_LT(errors[500], 1e-5) << offset;
      EXPECT_LT(errors[990], 1e-4) << offset;
    }
  }
}

TEST(Batch, EndsWhereItIsAskedToStop) {
  const auto systems = samples<Fixed>(2000, Topology<4>::full());
  auto batch = batch_of<SpringBatch<double, 2, 4>>(systems, Topology<4>::full());
  std::atomic<bool> stop{false};
  BatchNewton solver(batch);
  solver.options.stop = &stop;
  // The stop is requested after the first task.
  const BatchSummary summary = solver.solve(batch, [&stop](int tasks, auto&& work) {
    ASSERT_GT(tasks, 1);
    for (int task = 0; task < tasks; ++task, stop = true) work(task);
  });
  EXPECT_EQ(summary.status, Status::Interrupted);
  EXPECT_EQ(summary.converged, summary.first_failure);
  EXPECT_GT(summary.converged, 0);
  for (int s = summary.first_failure; s < batch.size(); ++s) {
    EXPECT_EQ(batch.status(s), Status::Interrupted);
    EXPECT_EQ(batch.points(s), systems[static_cast<std::size_t>(s)].start);
  }
}

TEST(Batch, OptionsAreNewtons) {
  const auto systems = samples<Fixed>(200, Topology<4>::full());
  for (const Simd simd : available_simd()) {
    const auto solved = [&](auto&& change) {
      auto batch = batch_of<SpringBatch<double, 2, 4>>(systems, Topology<4>::full());
      BatchNewton solver(batch);
      solver.simd = simd;
      change(solver.options);
      solver.solve(batch);
      for (int s = 0; s < batch.size(); ++s)
        expect_sound(batch, s, systems[static_cast<std::size_t>(s)].start);
      return batch;
    };
    for (const int limit : {0, 1, 3}) {
      const auto stopped = solved([&](NewtonOptions& o) { o.max_iterations = limit; });
      for (int s = 0; s < stopped.size(); ++s) {
        EXPECT_LE(stopped.iterations(s), limit);
        if (limit == 3 && stopped.status(s) == Status::Converged) continue;
        EXPECT_EQ(stopped.status(s), Status::MaxIterations);
        EXPECT_EQ(stopped.iterations(s), limit);
        EXPECT_EQ(stopped.positive_definite(s), std::nullopt);
        if (limit == 0) {
          EXPECT_EQ(stopped.points(s), systems[static_cast<std::size_t>(s)].start);
        }
      }
    }
    const auto loose = solved([](NewtonOptions& o) { o.tolerance = 1e-2; });
    const auto fine = solved([](NewtonOptions& o) { o.tolerance = 0; });
    const auto straight = solved([](NewtonOptions& o) { o.align = false; });
    const auto mirrored = solved([](NewtonOptions& o) { o.allow_reflection = true; });
    int iterations = 0, fine_iterations = 0, converged = 0;
    for (int s = 0; s < loose.size(); ++s) {
      expect_minimum(loose, s, 1e-2);
      expect_minimum(fine, s, 0);
      expect_minimum(straight, s, 1e-8);
      expect_minimum(mirrored, s, 1e-8);
      iterations += loose.iterations(s);
      fine_iterations += fine.iterations(s);
      converged += fine.status(s) == Status::Converged && loose.status(s) == Status::Converged &&
                   straight.status(s) == Status::Converged && mirrored.status(s) == Status::Converged;
      const auto& [system, start] = systems[static_cast<std::size_t>(s)];
      NewtonOptions options;
      options.allow_reflection = true;
      auto x = start;
      Newton(system, options).solve(system, x);
      EXPECT_EQ(mirrored.points(s), x);
    }
    EXPECT_GE(converged, 199);
    EXPECT_LT(iterations, fine_iterations);
  }
}

TEST(Batch, RefusesWhatItCannotDo) {
  const auto systems = samples<Fixed>(20, Topology<4>::full());
  const auto given = batch_of<SpringBatch<double, 2, 4>>(systems, Topology<4>::full());
  auto batch = given;
  BatchNewton solver(batch);
  solver.options.tolerance = -1;
  BatchSummary summary = solver.solve(batch);
  EXPECT_EQ(summary.status, Status::InvalidInput);
  EXPECT_EQ(summary.message, "option tolerance is negative or not finite");
  EXPECT_TRUE(same_bits(batch, given));
  EXPECT_EQ(batch.status(7), Status::NotRun);
  solver.options = {};
  for (const Simd simd : {Simd::Avx2, Simd::Avx512}) {
    solver.simd = simd;
    summary = solver.solve(batch);
    EXPECT_EQ(summary.status == Status::InvalidInput, !is_available(simd)) << summary.message;
  }
  solver.simd = static_cast<Simd>(17);
  EXPECT_EQ(solver.solve(batch).status, Status::InvalidInput);

  const std::array<Link, 1> bad = {Link{0, 7}};
  SpringBatch<double, 2> defective(Topology<>::from_links(3, bad), 2);
  summary = BatchNewton(defective).solve(defective);
  EXPECT_EQ(summary.status, Status::InvalidInput);
  EXPECT_EQ(summary.message, "link 0 has an end that is out of range");

  SpringBatch<double, 2> forgotten(Topology<>::full(3), 5);
  summary = BatchNewton(forgotten).solve(forgotten);
  EXPECT_EQ(summary.status, Status::InvalidInput);
  EXPECT_EQ(summary.first_failure, 0);
  SpringBatch<double, 2> empty(Topology<>::full(0), 5);
  EXPECT_EQ(BatchNewton(empty).solve(empty).status, Status::InvalidInput);

  auto fixed = systems[0];
  fixed.system.fix(1);
  batch.set(3, fixed.system, fixed.start);
  solver.simd = Simd::Auto;
  EXPECT_EQ(solver.solve(batch).first_failure, 3);
  EXPECT_EQ(batch.status(3), Status::InvalidInput);
}

TEST(Batch, PlanesAreTheSystems) {
  const auto systems = samples<SpringSystem<double, 3>>(40, Topology<>::full(5));
  const auto expected = batch_of<SpringBatch<double, 3>>(systems, Topology<>::full(5));
  SpringBatch<double, 3> batch(Topology<>::full(5), 40);
  for (int s = 0; s < 40; ++s) {
    const auto& [system, start] = systems[static_cast<std::size_t>(s)];
    for (int i = 0; i < 5; ++i) {
      for (int d = 0; d < 3; ++d) {
        batch.anchors(i, d)[s] = system.anchors(d, i);
        batch.x(i, d)[s] = start(d, i);
      }
      batch.anchor_stiffness(i)[s] = system.anchor_stiffness[i];
    }
    for (int l = 0; l < 10; ++l) {
      batch.rest_length(l)[s] = system.rest_length[l];
      batch.link_stiffness(l)[s] = system.link_stiffness[l];
    }
  }
  SpringSystem<double, 3> system(Topology<>::full(5));
  SpringSystem<double, 3>::Points x;
  for (int s = 0; s < 40; ++s) {
    const auto& [original, start] = systems[static_cast<std::size_t>(s)];
    batch.get(s, system, x);
    EXPECT_TRUE(testing::is_same(x, start));
    EXPECT_TRUE(testing::is_same(system.anchors, original.anchors));
    EXPECT_TRUE(testing::is_same(system.anchor_stiffness, original.anchor_stiffness));
    EXPECT_TRUE(testing::is_same(system.rest_length, original.rest_length));
    EXPECT_TRUE(testing::is_same(system.link_stiffness, original.link_stiffness));
    EXPECT_TRUE(testing::is_same(batch.points(s), expected.points(s)));
  }
  EXPECT_EQ(BatchNewton(batch).solve(batch).converged, 40);
}

// Counts every malloc of the program.
TEST(Batch, AllocatesOnce) {
  const auto check = [](auto batch, const auto& systems) {
    BatchNewton solver(batch);
    const auto solve = [&] {
      for (int s = 0; s < batch.size(); ++s) {
        auto [system, start] = systems[static_cast<std::size_t>(s)];
        if (s % 50 == 7) start.setConstant(1);  // takes the scalar path too
        batch.set(s, system, start);
      }
      return allocations_in([&] { solver.solve(batch); });
    };
    EXPECT_GT(solve(), 0);
    EXPECT_EQ(solve(), 0);
  };
  using Topology4 = Topology<4>;
  const auto systems = samples<Fixed>(3000, Topology4::full());
  check(SpringBatch<double, 2, 4>(Topology4::full(), 3000), systems);
  check(SpringBatch<float, 2, 4>(Topology4::full(), 3000), systems);
}

TEST(Executors, RunEveryTaskOnce) {
  const auto check = [](auto&& executor) {
    for (const int count : {0, 1, 2, 1000}) {
      std::vector<std::atomic<int>> calls(static_cast<std::size_t>(count));
      executor(count, [&](int task) { ++calls[static_cast<std::size_t>(task)]; });
      for (const auto& n : calls) EXPECT_EQ(n, 1);
    }
  };
  check(SerialExecutor());
  check(ThreadExecutor());
  check(ThreadExecutor{1});
  check(ThreadExecutor{7});
  static_assert(Executor<SerialExecutor> && Executor<ThreadExecutor> && Executor<Backwards>);
}

// The lanes prove the same as certify, with somewhat wider margins for rounding.
template <typename Batch>
void expect_proofs(const typename Batch::TopologyType& topology, Kind kind, double stiffness, double offset) {
  using System = typename Batch::System;
  using Scalar = typename Batch::Scalar;
  const bool is_hard = stiffness != 1 || offset != 0;
  const double accuracy = std::is_same_v<Scalar, float> ? 1e-6 : 1e-9;
  auto systems = samples<System>(is_hard ? 30 : 150, topology, kind);
  for (auto& [system, start] : systems) {
    system.link_stiffness *= Scalar(stiffness);
    system.anchors.array() += Scalar(offset);
    start.array() += Scalar(offset);
  }
  for (const Simd simd : available_simd()) {
    Batch batch = batch_of<Batch>(systems, topology);
    BatchNewton<Batch> solver;
    solver.simd = simd;
    if (is_hard) solver.options.max_iterations = 100;
    solver.solve(batch);
    EXPECT_EQ(batch.lower_bound(0), -1);
    batch = batch_of<Batch>(systems, topology);
    solver.options.gap = 1e-6;
    solver.solve(batch);
    int definite = 0, proven = 0, same = 0;
    System system(topology);
    typename Batch::Points x;
    for (int s = 0; s < batch.size(); ++s) {
      batch.get(s, system, x);
      const Certificate certificate = certify(system, x);
      const auto bound = static_cast<double>(batch.lower_bound(s));
      EXPECT_GE(bound, 0);
      EXPECT_LE(bound, certificate.energy);
      proven += certificate.energy - bound <= 1e-6 * certificate.energy ? 1 : 0;
      if (!(certificate.least_eigenvalue > 0)) continue;
      ++definite;
      // Both lower bounds are within the gap.
      EXPECT_LE(bound, certificate.energy) << s;
      same += bound >= certificate.lower_bound - accuracy * certificate.energy ? 1 : 0;
      if (!is_hard) {
        typename System::Points y = systems[static_cast<std::size_t>(s)].system.anchors;
        Newton<System>().solve(systems[static_cast<std::size_t>(s)].system, y);
        const auto other = static_cast<double>(energy(systems[static_cast<std::size_t>(s)].system, y));
        EXPECT_LE(bound, other * (1 + (std::is_same_v<Scalar, float> ? 1e-5 : 1e-12))) << s;
      }
    }
    if (is_hard) continue;  // where less can be proven
    EXPECT_GT(definite, 0);
    EXPECT_GE(same, 0.99 * definite) << to_string(simd);
    EXPECT_GE(proven, 0.99 * definite) << to_string(simd);
  }
}

TEST(BatchProof, IsThatOfOneSystem) {
  for (const double offset : {0.0, 1e6}) {
    for (const double stiffness : {1.0, 1e12}) {
      SCOPED_TRACE(::testing::Message() << "x " << stiffness << " + " << offset);
      expect_proofs<SpringBatch<double, 2, 4>>(Topology<4>::full(), Kind::Lit, stiffness, offset);
      expect_proofs<SpringBatch<double, 2>>(Topology<>::full(9), Kind::Track, stiffness, offset);
      expect_proofs<SpringBatch<double, 3>>(Topology<>::star(6, 2), Kind::Lit, stiffness, offset);
    }
  }
  expect_proofs<SpringBatch<double, 2>>(Topology<>::full(2), Kind::Lit, 1, 0);
  expect_proofs<SpringBatch<double, 3>>(Topology<>::full(4), Kind::Track, 1, 0);
  expect_proofs<SpringBatch<double, 2>>(Topology<>::full(17), Kind::Track, 1, 0);  // one by one
  expect_proofs<SpringBatch<float, 2, 4>>(Topology<4>::full(), Kind::Track, 1, 0);
}

}  // namespace
}  // namespace asterism
