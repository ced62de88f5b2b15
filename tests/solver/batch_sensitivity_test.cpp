// Derivatives of the solutions of a batch: those of Sensitivity one by one, and differences of solutions.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <asterism/solver/batch/batch_newton.hpp>
#include <asterism/solver/batch/batch_sensitivity.hpp>
#include <asterism/solver/batch/simd.hpp>
#include <asterism/solver/batch/spring_batch.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/hessian.hpp>
#include <asterism/solver/energy/sensitivity.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/executor.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/testing/random_system.hpp>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <type_traits>
#include <vector>

#include "counting_allocator.hpp"
#include "matrices.hpp"
#include "test_systems.hpp"

namespace asterism {
namespace {

using testing::allocations_in;
using testing::Kind;
using testing::Rng;

using Four = SpringBatch<double, 2, 4>;

/// A system with a point at which its derivatives are asked for, and with dL/dx.
template <typename System>
struct Case {
  System system;
  typename System::Points x;
  typename System::Points grad_x;
  std::string what;
};

template <typename Batch>
Batch batch_of(const std::vector<Case<typename Batch::System>>& cases,
               const typename Batch::TopologyType& topology) {
  Batch batch(topology, static_cast<int>(cases.size()));
  int s = 0;
  for (const auto& one : cases) batch.set(s++, one.system, one.x);
  return batch;
}

template <typename Batch>
BatchGradient<Batch> gradient_of(const Batch& batch, const std::vector<Case<typename Batch::System>>& cases) {
  BatchGradient<Batch> gradient(batch);
  int s = 0;
  for (const auto& one : cases) gradient.set(s++, one.grad_x);
  return gradient;
}

/// All derivatives of system s, in the order of SpringBatch's planes.
template <typename Batch>
Eigen::VectorXd numbers(BatchGradient<Batch>& gradient, int s) {
  std::vector<double> result;
  for (int i = 0; i < gradient.nodes(); ++i) {
    for (int d = 0; d < Batch::kDim; ++d) result.push_back(double(gradient.anchors(i, d)[s]));
  }
  for (int i = 0; i < gradient.nodes(); ++i) result.push_back(double(gradient.anchor_stiffness(i)[s]));
  for (int l = 0; l < gradient.link_count(); ++l) result.push_back(double(gradient.rest_length(l)[s]));
  for (int l = 0; l < gradient.link_count(); ++l) result.push_back(double(gradient.link_stiffness(l)[s]));
  return Eigen::Map<Eigen::VectorXd>(result.data(), static_cast<Eigen::Index>(result.size()));
}

template <typename System>
Eigen::VectorXd numbers(const SystemGradient<System>& gradient) {
  Eigen::VectorXd result(gradient.anchors.size() + gradient.anchor_stiffness.size() +
                         2 * gradient.rest_length.size());
  result << gradient.anchors.reshaped().template cast<double>(),
      gradient.anchor_stiffness.template cast<double>(), gradient.rest_length.template cast<double>(),
      gradient.link_stiffness.template cast<double>();
  return result;
}

/// What rounding changes in each of `numbers` is a few epsilon times this. Not finite where the Hessian is so
/// badly conditioned that it may change them all.
template <typename System>
Eigen::VectorXd scales(const System& system, const typename System::Points& x,
                       const typename System::Points& grad_x) {
  constexpr double kEpsilon = double(std::numeric_limits<typename System::Scalar>::epsilon());
  const Eigen::MatrixXd H = hessian(system, x).template cast<double>();
  const Eigen::VectorXd modes = testing::eigenvalues(H);
  const double condition = modes[modes.size() - 1] / modes[0];
  const bool is_known = condition > 0 && condition * kEpsilon < 1e-3;
  const Eigen::VectorXd lambda =
      testing::inverse(H) * Eigen::VectorXd(grad_x.reshaped().template cast<double>());
  const double move =
      is_known ? lambda.cwiseAbs().maxCoeff() * condition : std::numeric_limits<double>::infinity();
  const double extent = double(x.cwiseAbs().maxCoeff() + system.anchors.cwiseAbs().maxCoeff()) +
                        (system.link_count() > 0 ? double(system.rest_length.maxCoeff()) : 0);
  Eigen::VectorXd result(system.anchors.size() + system.nodes() + 2 * system.link_count());
  Eigen::Index at = 0;
  for (int i = 0; i < system.nodes(); ++i) {
    for (int d = 0; d < System::kDim; ++d) result[at++] = move * double(system.anchor_stiffness[i]);
  }
  for (int i = 0; i < system.nodes(); ++i) result[at++] = move * extent;
  for (int l = 0; l < system.link_count(); ++l) result[at++] = move * double(system.link_stiffness[l]);
  for (int l = 0; l < system.link_count(); ++l) result[at++] = move * extent;
  return result;
}

/// The batch has the verdict of Sensitivity for every system, and its numbers. Returns how many systems the
/// lanes left, with the instructions that left most.
template <typename Batch>
int expect_as_single(const std::vector<Case<typename Batch::System>>& cases,
                     const typename Batch::TopologyType& topology, double digits = 64) {
  using System = typename Batch::System;
  using Points = typename Batch::Points;
  constexpr double kEpsilon = double(std::numeric_limits<typename Batch::Scalar>::epsilon());
  const Batch batch = batch_of<Batch>(cases, topology);
  std::vector<SystemGradient<System>> expected;
  std::vector<Eigen::VectorXd> tolerances;
  Sensitivity<System> sensitivity;
  System system(topology);
  Points x;
  for (int s = 0; s < batch.size(); ++s) {
    batch.get(s, system, x);
    const Points& grad_x = cases[static_cast<std::size_t>(s)].grad_x;
    expected.push_back(sensitivity.backward(system, x, grad_x));
    tolerances.push_back(expected.back() ? Eigen::VectorXd(digits * kEpsilon * scales(system, x, grad_x))
                                         : Eigen::VectorXd());
  }
  int left = 0;
  for (const Simd simd : available_simd()) {
    BatchGradient<Batch> gradient = gradient_of(batch, cases);
    BatchSensitivity<Batch> lanes(batch);
    lanes.simd = simd;
    const BatchGradientSummary summary = lanes.backward(batch, gradient);
    left = std::max(left, summary.by_scalar);
    int computed = 0, first = -1;
    for (int s = 0; s < batch.size(); ++s) {
      const auto at = static_cast<std::size_t>(s);
      SCOPED_TRACE(::testing::Message() << to_string(simd) << ", system " << s << ", " << cases[at].what);
      EXPECT_EQ(gradient.status(s), expected[at].status) << expected[at].message;
      const Eigen::VectorXd found = numbers(gradient, s);
      if (gradient.status(s) == SensitivityStatus::Computed) {
        ++computed;
      } else {
        first = first < 0 ? s : first;
        EXPECT_TRUE(found.array().isNaN().all());
      }
      if (!expected[at] || gradient.status(s) != expected[at].status) continue;
      EXPECT_TRUE(found.allFinite());
      if (!tolerances[at].allFinite()) continue;
      const Eigen::VectorXd error = (found - numbers(expected[at])).cwiseAbs();
      EXPECT_TRUE((error.array() <= tolerances[at].array()).all())
          << error.cwiseQuotient(tolerances[at]).transpose();
    }
    EXPECT_EQ(summary.computed, computed);
    EXPECT_EQ(summary.first_failure, first);
    EXPECT_EQ(bool(summary), first < 0);
    EXPECT_EQ(summary.message.empty(), first < 0);
    EXPECT_EQ(summary.simd, simd);
    if (first >= 0) {
      EXPECT_EQ(summary.status, gradient.status(first));
    }
  }
  return left;
}

/// Solutions of random systems, as BatchNewton finds them.
template <typename Batch>
std::vector<Case<typename Batch::System>> solved(int count, const typename Batch::TopologyType& topology,
                                                 Kind kind) {
  using System = typename Batch::System;
  std::vector<Case<System>> cases;
  Rng rng(4);
  for (int s = 0; s < count; ++s) {
    auto [system, start] = testing::random_system<System>(rng, topology, kind);
    auto grad_x = testing::random_points<System>(rng, topology.nodes(), -1, 1);
    cases.push_back({std::move(system), std::move(start), std::move(grad_x), "solved"});
  }
  Batch batch = batch_of<Batch>(cases, topology);
  BatchNewton(batch).solve(batch);
  for (int s = 0; s < count; ++s) {
    auto& one = cases[static_cast<std::size_t>(s)];
    batch.get(s, one.system, one.x);
  }
  return cases;
}

template <typename Batch>
void expect_solutions_as_single(const typename Batch::TopologyType& topology, bool in_lanes = true) {
  for (const Kind kind : testing::kKinds) {
    SCOPED_TRACE(to_string(kind));
    const int count = topology.nodes() > 9 ? 40 : 150;
    const int left = expect_as_single<Batch>(solved<Batch>(count, topology, kind), topology);
    if (in_lanes) {
      EXPECT_LE(left, count / 10);
    } else {
      EXPECT_EQ(left, count);
    }
  }
}

TEST(BatchSensitivity, OfSolutionsIsThatOfEachInThePlane) {
  expect_solutions_as_single<Four>(Topology<4>::full());
  for (const int nodes : {2, 3, 5, 6, 9}) {
    expect_solutions_as_single<SpringBatch<double, 2>>(Topology<>::full(nodes));
  }
  // With a duplicate link, and links from higher to lower nodes.
  const std::array<Link, 6> chain = {Link{0, 1}, {2, 1}, {2, 3}, {3, 4}, {0, 1}, {4, 0}};
  expect_solutions_as_single<SpringBatch<double, 2>>(Topology<>::from_links(5, chain));
  expect_solutions_as_single<SpringBatch<double, 2>>(Topology<>::full(15));
}

TEST(BatchSensitivity, OfSolutionsIsThatOfEachInSpace) {
  for (const int nodes : {3, 4, 7}) {
    expect_solutions_as_single<SpringBatch<double, 3>>(Topology<>::full(nodes));
  }
  // Two nodes may turn about the line through both, which moves neither: for Sensitivity to see.
  expect_solutions_as_single<SpringBatch<double, 3>>(Topology<>::full(2), false);
  expect_solutions_as_single<SpringBatch<double, 3>>(Topology<>::star(6, 2));
}

TEST(BatchSensitivity, OfSolutionsIsThatOfEachInFloat) {
  expect_solutions_as_single<SpringBatch<float, 2, 4>>(Topology<4>::full());
  for (const int nodes : {4, 5}) expect_solutions_as_single<SpringBatch<float, 3>>(Topology<>::full(nodes));
}

TEST(BatchSensitivity, WithoutAKernelIsThatOfEach) {
  expect_solutions_as_single<SpringBatch<double, 2>>(Topology<>::full(1), false);
  expect_solutions_as_single<SpringBatch<double, 2>>(Topology<>::star(40, 3), false);
  expect_solutions_as_single<SpringBatch<double, 1>>(Topology<>::full(3), false);
  const std::array<Link, 3> apart = {Link{0, 1}, {2, 3}, {3, 4}};  // two components
  expect_solutions_as_single<SpringBatch<double, 2>>(Topology<>::from_links(5, apart), false);
}

/// Any point becomes stationary if each anchor is where it balances the links: with rest lengths about those
/// of the links, or 0.3 to `most` times those, where many a Hessian is indefinite.
template <typename System>
Case<System> balanced(Rng& rng, const typename System::TopologyType& topology, double most) {
  using Scalar = typename System::Scalar;
  Case<System> result{System(topology), testing::random_points<System>(rng, topology.nodes(), 0, 1),
                      testing::random_points<System>(rng, topology.nodes(), -1, 1), "balanced"};
  System& system = result.system;
  const auto draw = [&rng](double low, double high) { return Scalar(rng.uniform(low, high)); };
  system.set_rest_lengths(result.x);
  for (auto& k : system.anchor_stiffness) k = draw(0.2, 2);
  for (auto& k : system.link_stiffness) k = draw(0.2, 2);
  if (most > 0) {
    for (auto& mu : system.rest_length) mu *= draw(0.3, most);
  }
  system.anchors = result.x;
  const typename System::Points force = gradient(system, result.x);
  for (int i = 0; i < topology.nodes(); ++i) {
    system.anchors.col(i) += force.col(i) / system.anchor_stiffness[i];
  }
  return result;
}

constexpr int kSorts = 16;

/// One of many ways in which derivatives may not exist, or only just.
template <typename System>
Case<System> awkward(int sort, Rng& rng, const typename System::TopologyType& topology) {
  using Scalar = typename System::Scalar;
  constexpr bool kDouble = std::is_same_v<Scalar, double>;
  constexpr Scalar kNan = std::numeric_limits<Scalar>::quiet_NaN();
  const auto digits = [&](double low, double high) { return Scalar(std::pow(10, rng.uniform(low, high))); };
  auto result = balanced<System>(rng, topology, sort < 2 ? 3 : sort < 8 ? 1.1 : 0);
  auto& [system, x, grad_x, what] = result;
  const int n = topology.nodes(), links = topology.link_count();
  const Link link = topology.links()[0];
  const auto any = [&rng](int size) { return static_cast<int>(rng.uniform(0, size)); };
  switch (sort) {
    case 0:
    case 1:
      what = "saddle or minimum";
      break;
    case 2:
    case 3: {  // about the option's limit, or the least that counts in float
      what = "not quite stationary";
      const auto step = testing::random_points<System>(rng, n, -1, 1);
      x += step * digits(kDouble ? -8 : -7, kDouble ? -5 : -4);
      break;
    }
    case 4:
      what = "gradient not finite";
      grad_x(0, any(n)) = any(2) == 0 ? kNan : -std::numeric_limits<Scalar>::infinity();
      break;
    case 5:
      what = "value not finite";
      (any(2) == 0 ? system.anchors : x)(1, any(n)) =
          any(2) == 0 ? kNan : 2 * std::numeric_limits<Scalar>::max();
      break;
    case 6:
      what = "stiffness not valid";
      (any(2) == 0 ? system.anchor_stiffness[any(n)] : system.link_stiffness[any(links)]) =
          any(2) == 0 ? kNan : -1;
      break;
    case 7:
      what = "rest length not valid";
      system.rest_length[any(links)] = any(2) == 0 ? kNan : -1;
      break;
    case 8:  // at rest from here on
      what = "nearly coincident";
      x.col(link.j) = x.col(link.i);
      x(0, link.j) += digits(kDouble ? -18 : -9, kDouble ? -8 : -3);
      system.anchors = x;
      system.set_rest_lengths(x);
      break;
    case 9:  // its ends belong there, or it pushes them apart, or it has no stiffness
      what = "coincident";
      x.col(link.j) = x.col(link.i);
      system.anchors = x;
      system.set_rest_lengths(x);
      if (any(4) > 0) system.rest_length[0] = 1;
      if (any(4) == 0) system.link_stiffness[0] = 0;
      break;
    case 10:
      what = "springs without stiffness";
      system.anchor_stiffness[any(n)] = 0;
      system.link_stiffness[any(links)] = 0;
      break;
    case 11:
      what = "one anchor";
      for (int i = 1; i < n; ++i) system.anchor_stiffness[i] = any(2) == 0 ? Scalar(0) : digits(-20, -3);
      break;
    case 12:
      what = "weak anchors";
      system.anchor_stiffness *= digits(-18, -1);
      break;
    case 13:
      what = "far from the origin";
      x.array() += digits(3, kDouble ? 16 : 7);
      system.anchors = x;
      system.set_rest_lengths(x);
      break;
    case 14: {
      what = "other units";
      const Scalar length = digits(kDouble ? -140 : -14, kDouble ? 140 : 14);
      const Scalar stiffness = digits(kDouble ? -140 : -14, kDouble ? 140 : 14);
      x *= length;
      system.anchors = x;
      system.set_rest_lengths(x);
      system.anchor_stiffness *= stiffness;
      system.link_stiffness *= stiffness;
      break;
    }
    default:
      what = "large gradient";
      system.anchor_stiffness *= Scalar(0.01);
      grad_x *= digits(kDouble ? 305 : 35, kDouble ? 308 : 38);
      break;
  }
  return result;
}

template <typename Batch>
void expect_awkward_as_single(const typename Batch::TopologyType& topology) {
  using System = typename Batch::System;
  Rng rng(6);
  std::vector<Case<System>> cases;
  for (int s = 0; s < 40 * kSorts; ++s) cases.push_back(awkward<System>(s % kSorts, rng, topology));
  std::array<int, 8> seen{};
  Sensitivity<System> sensitivity;
  for (const auto& one : cases) {
    ++seen[static_cast<std::size_t>(sensitivity.backward(one.system, one.x, one.grad_x).status)];
  }
  for (const auto status : {SensitivityStatus::Computed, SensitivityStatus::NotStationary,
                            SensitivityStatus::NotPositiveDefinite, SensitivityStatus::CoincidentNodes,
                            SensitivityStatus::NumericalFailure, SensitivityStatus::InvalidInput}) {
    EXPECT_GE(seen[static_cast<std::size_t>(status)], 10) << status;
  }
  expect_as_single<Batch>(cases, topology, 512);
}

TEST(BatchSensitivity, OfAwkwardSystemsHasTheVerdictOfEach) {
  expect_awkward_as_single<Four>(Topology<4>::full());
  expect_awkward_as_single<SpringBatch<float, 2, 4>>(Topology<4>::full());
  expect_awkward_as_single<SpringBatch<double, 2>>(Topology<>::star(5, 2));
  expect_awkward_as_single<SpringBatch<double, 3>>(Topology<>::full(4));
  expect_awkward_as_single<SpringBatch<float, 3>>(Topology<>::full(5));
}

// dL/d(value) of the batch against solutions of a batch with that value moved.
template <typename Batch>
void expect_differences(const typename Batch::TopologyType& topology) {
  constexpr double kStep = 1e-3;
  const auto cases = solved<Batch>(8, topology, Kind::Track);
  Batch batch = batch_of<Batch>(cases, topology);
  BatchNewton<Batch> solver(batch);
  solver.options.tolerance = 1e-12;
  solver.options.align = false;  // to stay at this minimum
  solver.solve(batch);
  BatchGradient<Batch> gradient = gradient_of(batch, cases);
  ASSERT_TRUE(BatchSensitivity(batch).backward(batch, gradient));
  const auto loss = [&](auto&& plane_of, const Eigen::ArrayXd& step) {
    Batch moved = batch;
    plane_of(moved) += step;
    EXPECT_EQ(solver.solve(moved).status, Status::Converged);
    Eigen::VectorXd result(batch.size());
    for (int s = 0; s < batch.size(); ++s) {
      result[s] = moved.points(s).cwiseProduct(cases[static_cast<std::size_t>(s)].grad_x).sum();
    }
    return result;
  };
  // In units of `scale`, one of each system; of fourth order.
  const auto check = [&](auto&& plane_of, const Eigen::ArrayXd& scale) {
    const auto difference = [&](double step) -> Eigen::VectorXd {
      return loss(plane_of, step * scale) - loss(plane_of, -step * scale);
    };
    const Eigen::VectorXd expected = (8 * difference(kStep) - difference(2 * kStep)) / (12 * kStep);
    const Eigen::VectorXd found = plane_of(gradient) * scale;
    EXPECT_TRUE(testing::is_near(found, expected, 1e-5)) << found.transpose() << "\n" << expected.transpose();
  };
  const auto check_relative = [&](auto&& plane_of) { check(plane_of, plane_of(batch)); };
  const auto last = topology.link_count() - 1;
  for (int d = 0; d < Batch::kDim; ++d) check([&](auto& b) { return b.anchors(1, d); }, batch.rest_length(0));
  check_relative([](auto& b) { return b.anchor_stiffness(0); });
  check_relative([](auto& b) { return b.rest_length(0); });
  check_relative([&](auto& b) { return b.rest_length(last); });
  check_relative([&](auto& b) { return b.link_stiffness(last); });
}

TEST(BatchSensitivity, IsTheDifferenceOfSolutions) {
  expect_differences<Four>(Topology<4>::full());
  expect_differences<SpringBatch<double, 2>>(Topology<>::star(6, 0));
  expect_differences<SpringBatch<double, 3>>(Topology<>::full(4));
}

/// Runs the tasks from the last to the first.
struct Backwards {
  void operator()(int task_count, auto&& f) const {
    while (task_count > 0) f(--task_count);
  }
};

// A system's derivatives depend neither on threads nor on its neighbours or its place in the batch.
TEST(BatchSensitivity, ThreadsAndPlacesAgreeBitForBit) {
  auto cases = solved<Four>(3000, Topology<4>::full(), Kind::Lit);
  Rng rng(2);
  for (std::size_t s = 0; s < cases.size(); s += 7) {
    cases[s] = awkward<Four::System>(static_cast<int>(s) % kSorts, rng, Topology<4>::full());
  }
  auto reversed = cases;
  std::reverse(reversed.begin(), reversed.end());
  const Four batch = batch_of<Four>(cases, Topology<4>::full());
  const Four other = batch_of<Four>(reversed, Topology<4>::full());
  for (const Simd simd : available_simd()) {
    BatchSensitivity sensitivity(batch);
    sensitivity.simd = simd;
    auto one = gradient_of(batch, cases);
    sensitivity.backward(batch, one);
    const auto expect_same = [&](BatchGradient<Four>& many, bool is_reversed) {
      for (int s = 0; s < batch.size(); ++s) {
        const int there = is_reversed ? batch.size() - 1 - s : s;
        ASSERT_EQ(many.status(there), one.status(s)) << s;
        if (one.status(s) == SensitivityStatus::Computed) {
          ASSERT_EQ(numbers(many, there), numbers(one, s)) << s;
        }
      }
    };
    for (const int threads : {2, 5}) {
      auto many = gradient_of(batch, cases);
      sensitivity.backward(batch, many, ThreadExecutor{threads});
      expect_same(many, false);
    }
    auto last_first = gradient_of(batch, cases);
    sensitivity.backward(batch, last_first, Backwards());
    expect_same(last_first, false);
    auto elsewhere = gradient_of(other, reversed);
    sensitivity.backward(other, elsewhere);
    expect_same(elsewhere, true);
  }
}

TEST(BatchSensitivity, AnyNumberOfSystems) {
  const auto all = solved<Four>(70, Topology<4>::full(), Kind::Track);
  const Four batch = batch_of<Four>(all, Topology<4>::full());
  auto whole = gradient_of(batch, all);
  BatchSensitivity sensitivity(batch);
  sensitivity.backward(batch, whole);
  for (int count = 0; count <= 70; ++count) {
    const std::vector<Case<Four::System>> some(all.begin(), all.begin() + count);
    const Four part = batch_of<Four>(some, Topology<4>::full());
    auto gradient = gradient_of(part, some);
    const auto summary = sensitivity.backward(part, gradient);
    EXPECT_EQ(summary.status, SensitivityStatus::Computed);
    EXPECT_EQ(summary.computed, count);
    for (int s = 0; s < count; ++s) EXPECT_EQ(numbers(gradient, s), numbers(whole, s));
  }
}

TEST(BatchSensitivity, OptionsAreThoseOfSensitivity) {
  auto cases = solved<Four>(100, Topology<4>::full(), Kind::Track);
  for (auto& one : cases) one.x += 1e-3 * one.grad_x;
  const Four batch = batch_of<Four>(cases, Topology<4>::full());
  for (const Simd simd : available_simd()) {
    BatchSensitivity sensitivity(batch);
    sensitivity.simd = simd;
    auto gradient = gradient_of(batch, cases);
    EXPECT_EQ(sensitivity.backward(batch, gradient).status, SensitivityStatus::NotStationary);
    sensitivity.options.stationarity = 0.1;
    EXPECT_EQ(sensitivity.backward(batch, gradient).computed, 100);
  }
}

TEST(BatchSensitivity, RefusesWhatItCannotDo) {
  const auto cases = solved<Four>(20, Topology<4>::full(), Kind::Track);
  const Four batch = batch_of<Four>(cases, Topology<4>::full());
  auto gradient = gradient_of(batch, cases);
  BatchSensitivity sensitivity(batch);
  EXPECT_TRUE(sensitivity.backward(batch, gradient));
  const auto expect_refused = [&](std::string_view message) {
    const BatchGradientSummary summary = sensitivity.backward(batch, gradient);
    EXPECT_EQ(summary.status, SensitivityStatus::InvalidInput);
    EXPECT_EQ(summary.message, message);
    EXPECT_EQ(summary.computed, 0);
    for (int s = 0; s < gradient.size(); ++s) {
      EXPECT_EQ(gradient.status(s), SensitivityStatus::InvalidInput);
      EXPECT_TRUE(numbers(gradient, s).array().isNaN().all());
    }
    sensitivity.options = {};
    sensitivity.simd = Simd::Auto;
  };
  sensitivity.options.stationarity = -1;
  expect_refused("option stationarity is negative or not finite");
  sensitivity.simd = static_cast<Simd>(17);
  expect_refused("the instructions asked for are not available");
  const Four small(Topology<4>::full(), 3);
  gradient = BatchGradient<Four>(small);
  expect_refused("the gradient is not of the batch's size");

  // What was never set
  BatchGradient<Four> unset(batch);
  EXPECT_EQ(sensitivity.backward(batch, unset).status, SensitivityStatus::InvalidInput);
  const std::array<Link, 1> bad = {Link{0, 7}};
  using Batch = SpringBatch<double, 2>;
  const Batch defective(Topology<>::from_links(3, bad), 2), empty(Topology<>::full(0), 5);
  BatchGradient<Batch> of_defective(defective), of_empty(empty);
  EXPECT_EQ(BatchSensitivity(defective).backward(defective, of_defective).message,
            "link 0 has an end that is out of range");
  EXPECT_EQ(BatchSensitivity(empty).backward(empty, of_empty).status, SensitivityStatus::InvalidInput);
}

// Counts every malloc of the program.
TEST(BatchSensitivity, DoesNotAllocateAgain) {
  const auto check = [](auto batch, const auto& cases, bool awkward_ones) {
    BatchSensitivity sensitivity(batch);
    auto gradient = gradient_of(batch, cases);
    const auto compute = [&] { return allocations_in([&] { sensitivity.backward(batch, gradient); }); };
    EXPECT_EQ(compute() > 0, awkward_ones);
    EXPECT_EQ(compute(), 0);
  };
  auto cases = solved<Four>(2000, Topology<4>::full(), Kind::Track);
  check(batch_of<Four>(cases, Topology<4>::full()), cases, false);
  Rng rng(3);
  for (std::size_t s = 0; s < cases.size(); s += 50) {
    cases[s] = awkward<Four::System>(static_cast<int>(s / 50) % kSorts, rng, Topology<4>::full());
  }
  check(batch_of<Four>(cases, Topology<4>::full()), cases, true);
  using Unbounded = SpringBatch<double, 3>;  // in the lanes alone
  const auto others = solved<Unbounded>(700, Topology<>::full(4), Kind::Track);
  check(batch_of<Unbounded>(others, Topology<>::full(4)), others, false);
}

}  // namespace
}  // namespace asterism
