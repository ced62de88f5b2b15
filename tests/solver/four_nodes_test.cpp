// Newton's compiled iterations for four nodes against those of Newton itself, which a solve that watches for
// a stop takes, and compiled derivatives against those of a type of systems that has none. Where the
// processor has no such instructions, both are the same.

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/sensitivity.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/problem/compiled_types.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/testing/random_system.hpp>
#include <atomic>
#include <cmath>
#include <cstdint>

namespace asterism {
namespace {

template <typename System>
struct Solved {
  Summary summary;
  typename System::Points x;
};

template <typename System>
Solved<System> solve(const System& system, const typename System::Points& start, const NewtonOptions& options,
                     bool compiled) {
  static const std::atomic<bool> stop = false;
  Newton<System> newton(system, options);
  if (!compiled) newton.options.stop = &stop;
  Solved<System> result{{}, start};
  result.summary = newton.solve(system, result.x);
  return result;
}

// The same decisions, and numbers up to rounding.
template <typename System>
void expect_same(const System& system, const typename System::Points& start, const NewtonOptions& options) {
  const auto [got, x] = solve(system, start, options, true);
  const auto [expected, y] = solve(system, start, options, false);
  EXPECT_EQ(got.status, expected.status);
  EXPECT_EQ(got.message, expected.message);
  EXPECT_EQ(got.iterations, expected.iterations);
  EXPECT_EQ(got.positive_definite, expected.positive_definite);
  EXPECT_EQ(got.initial_energy, expected.initial_energy);
  EXPECT_NEAR(got.final_energy, expected.final_energy, 1e-9 * std::abs(expected.final_energy));
  EXPECT_LE((x - y).norm(), 1e-6 * y.norm());
}

template <typename System>
class FourNodes : public ::testing::Test {};
using Types = ::testing::Types<detail::FourPartSystem, detail::PlaneSystem>;
TYPED_TEST_SUITE(FourNodes, Types);

TYPED_TEST(FourNodes, TakeTheStepsOfNewton) {
  const auto topology = TypeParam::TopologyType::full(4);
  for (const testing::Kind kind : testing::kKinds) {
    for (std::uint64_t i = 0; i < 400; ++i) {
      SCOPED_TRACE(::testing::Message() << to_string(kind) << ' ' << i);
      auto [system, start] = testing::numbered_system<TypeParam>(kind, topology, 90000 + i);
      NewtonOptions options;
      if (i % 4 == 1) options.max_iterations = static_cast<int>(i / 4 % 8);
      if (i % 4 == 2) options.align = false;
      if (i % 4 == 3) system.anchor_stiffness *= 1e-4;  // aligned after every step
      if (i % 5 == 1) system.anchor_stiffness[static_cast<int>(i % 4)] = 0;
      if (i % 5 == 2) options.tolerance = 1e-3;
      expect_same(system, start, options);
      start = solve(system, start, options, false).x;  // where nothing, or rounding, is left to gain
      expect_same(system, start, options);
    }
  }
}

TYPED_TEST(FourNodes, LeaveSaddlesAndPeaksToNewton) {
  TypeParam system(TypeParam::TopologyType::full(4));
  system.anchors << 0, 10, 20, 30, 0, 0, 0, 0;
  system.anchor_stiffness.setConstant(0.1);
  system.link_stiffness.setOnes();
  system.rest_length.setConstant(25);
  typename TypeParam::Points start = system.anchors;  // on a line, which the minimum leaves
  expect_same(system, start, {});
  EXPECT_GT(std::abs(solve(system, start, {}, true).x.row(1).minCoeff()), 1);
  NewtonOptions stays;
  stays.escape_saddles = false;
  expect_same(system, start, stays);
  start.setZero();  // four nodes in one place
  expect_same(system, start, {});
  start << 0, 1e-170, 20, 30, 0, 0, 0, 5;  // lengths whose squares underflow
  expect_same(system, start, {});
}

TYPED_TEST(FourNodes, ServeAllSystemsAlike) {
  const auto topology = TypeParam::TopologyType::full(4);
  auto [system, start] = testing::numbered_system<TypeParam>(testing::Kind::Lit, topology, 5);
  for (const double scale : {1e-100, 1e-30, 1e30, 1e100, 1e140}) {
    SCOPED_TRACE(scale);
    auto other = system;
    other.anchor_stiffness *= scale;
    other.link_stiffness *= scale;
    expect_same(other, start, {});
    other = system;
    other.anchors *= scale;
    other.rest_length *= scale;
    expect_same(other, typename TypeParam::Points(start * scale), {});
  }
  auto fixed = system;
  fixed.fix(2);
  expect_same(fixed, start, {});
  auto loose = system;
  loose.link_stiffness[3] = 0;
  expect_same(loose, start, {});
  auto loaded = system;
  loaded.loads = TypeParam::Points::Constant(2, 4, 0.5);
  expect_same(loaded, start, {});
  auto offset = system;
  offset.rest_offset = decltype(offset.rest_offset)::Constant(2, 6, 3);
  expect_same(offset, start, {});
}

TYPED_TEST(FourNodes, KeepTheCallbacksOfNewton) {
  const auto [system, start] =
      testing::numbered_system<TypeParam>(testing::Kind::Lit, TypeParam::TopologyType::full(4), 6);
  int seen = 0;
  auto count = [&](const Iteration& at) { return seen += at.number == seen ? 1 : 100, true; };
  NewtonOptions options;
  options.on_iteration = count;
  const Summary summary = solve(system, start, options, true).summary;
  EXPECT_EQ(seen, summary.iterations + 1);
}

// The same verdict, and derivatives that differ by rounding, which the condition of the Hessian enlarges.
template <typename System>
void expect_same_derivatives(const System& system, const typename System::Points& x,
                             const typename System::Points& grad_x, double share, int* computed = nullptr) {
  using Other = SpringSystem<double, 2, Eigen::Dynamic, 8>;
  Other other(Other::TopologyType::full(4));
  other.anchors = system.anchors;
  other.anchor_stiffness = system.anchor_stiffness;
  other.rest_length = system.rest_length;
  other.link_stiffness = system.link_stiffness;
  const auto got = sensitivity(system, x, grad_x);
  const auto expected = sensitivity(other, Other::Points(x), Other::Points(grad_x));
  ASSERT_EQ(got.status, expected.status) << got.message << " / " << expected.message;
  if (!got) return;
  if (computed) ++*computed;
  EXPECT_LE((got.anchors - expected.anchors).norm(), share * expected.anchors.norm());
  EXPECT_LE((got.anchor_stiffness - expected.anchor_stiffness).norm(),
            share * expected.anchor_stiffness.norm());
  EXPECT_LE((got.rest_length - expected.rest_length).norm(), share * expected.rest_length.norm());
  EXPECT_LE((got.link_stiffness - expected.link_stiffness).norm(), share * expected.link_stiffness.norm());
}

TYPED_TEST(FourNodes, HaveTheDerivativesOfOtherTypes) {
  const auto topology = TypeParam::TopologyType::full(4);
  int computed = 0;
  for (const testing::Kind kind : testing::kKinds) {
    for (std::uint64_t i = 0; i < 400; ++i) {
      SCOPED_TRACE(::testing::Message() << to_string(kind) << ' ' << i);
      auto [system, start] = testing::numbered_system<TypeParam>(kind, topology, 70000 + i);
      if (i % 5 == 1) system.anchor_stiffness[static_cast<int>(i % 4)] = 0;
      if (i % 5 == 2) system.anchor_stiffness *= 1e-4;
      if (i % 5 == 3) system.anchor_stiffness.template tail<3>().setZero();  // they turn about the first
      NewtonOptions options;
      if (i % 7 == 1) options.tolerance = 1e-4;  // not stationary enough
      const auto x = solve(system, start, options, false).x;
      typename TypeParam::Points grad_x = start - system.anchors;
      if (i % 7 == 2) grad_x *= 1e150;
      if (i % 7 == 3) grad_x *= 1e-150;
      expect_same_derivatives(system, x, grad_x, 1e-8, &computed);
    }
  }
  EXPECT_GT(computed, 1000);
}

TYPED_TEST(FourNodes, HaveNoDerivativesWhereOthersHaveNone) {
  TypeParam system(TypeParam::TopologyType::full(4));
  system.anchors << 0, 10, 0, 10, 0, 0, 10, 10;
  system.anchor_stiffness.setOnes();
  system.link_stiffness.setOnes();
  system.rest_length << 9, 12, 13, 15, 11, 10;
  const typename TypeParam::Points minimum = solve(system, system.anchors, {}, false).x;
  typename TypeParam::Points grad_x(2, 4);
  grad_x << 1, 2, 3, -1, 0, 2, 0, 5;
  int computed = 0;
  expect_same_derivatives(system, minimum, grad_x, 1e-12, &computed);
  EXPECT_EQ(computed, 1);
  typename TypeParam::Points x = minimum;
  x.col(1) = x.col(0);
  expect_same_derivatives(system, x, grad_x, 0);  // linked nodes in one place
  x = minimum;
  x(0, 0) += 1e-3;  // not stationary
  expect_same_derivatives(system, x, grad_x, 0);
  TypeParam square = system;
  square.anchor_stiffness.setConstant(0.01);
  square.rest_length << 10, 10, std::sqrt(200.0), std::sqrt(200.0), 10, 10;
  NewtonOptions stays;
  stays.align = stays.escape_saddles = false;
  x = typename TypeParam::Points((10 - system.anchors.array()).matrix());
  x = solve(square, x, stays, false).x;  // turned by half a turn: stationary, but a maximum of rotation
  EXPECT_EQ(sensitivity(square, x, grad_x).status, SensitivityStatus::NotPositiveDefinite);
  expect_same_derivatives(square, x, grad_x, 0);
  for (const double scale : {1e-150, 1e-100, 1e100, 1e150}) {
    SCOPED_TRACE(scale);
    auto other = system;
    other.anchors *= scale;
    other.rest_length *= scale;
    expect_same_derivatives(other, typename TypeParam::Points(minimum * scale), grad_x, 1e-12);
    other = system;
    other.anchor_stiffness *= scale;
    other.link_stiffness *= scale;
    expect_same_derivatives(other, minimum, grad_x, 1e-12);
  }
}

}  // namespace
}  // namespace asterism
