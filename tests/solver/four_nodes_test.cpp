// Newton's compiled iterations for four nodes against those of Newton itself, which a solve that watches for
// a stop takes. Where the processor has no such instructions, both are the same.

#include <gtest/gtest.h>

#include <asterism/solver/energy/energy.hpp>
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

}  // namespace
}  // namespace asterism
