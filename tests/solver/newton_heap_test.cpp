// Newton, Auto, multi-start and alignment of fixed and bounded sizes never touch the heap: every malloc of
// the program is counted.
#include <gtest/gtest.h>

#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/method/auto.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/testing/random_system.hpp>

#include "counting_allocator.hpp"

namespace asterism {
namespace {

using testing::allocations_in;

template <typename System>
void expect_no_heap(int n) {
  testing::Rng rng(5);
  const auto random = testing::random_system<System>(rng, System::TopologyType::full(n));
  auto system = random.system;
  auto x = random.start;
  Summary summary;
  EXPECT_EQ(allocations_in([&] { summary = Newton<System>().solve(system, x); }), 0) << "n = " << n;
  EXPECT_TRUE(summary.usable()) << summary;
  EXPECT_EQ(allocations_in([&] {  // weak anchors, coincident nodes
              system.anchor_stiffness *= typename System::Scalar(1e-5);
              x.setConstant(3);
              summary = Newton<System>().solve(system, x);
            }),
            0);
  EXPECT_TRUE(summary.usable()) << summary;
  EXPECT_EQ(allocations_in([&] { x = rigid_alignment(system, random.start, true); }), 0);
  EXPECT_EQ(allocations_in([&] {
              system.anchor_stiffness.setZero();
              summary = Newton<System>().solve(system, x);
            }),
            0);
  EXPECT_EQ(summary.status, Status::InvalidInput);
  EXPECT_EQ(allocations_in([&] {
              SolverOptions options;
              options.hold_floating = true;
              summary = Newton<System>(system, options).solve(system, x);
            }),
            0);
  EXPECT_TRUE(summary.usable()) << summary;
  x = random.start;
  EXPECT_EQ(allocations_in([&] { summary = solve(random.system, x); }), 0);
  EXPECT_TRUE(summary.usable()) << summary;
  Certificate certificate;
  for (const double stretch : {1.0, 1.5}) {  // with compressed springs W is factored twice
    x *= static_cast<typename System::Scalar>(stretch);
    EXPECT_EQ(allocations_in([&] { certificate = certify(random.system, x); }), 0) << "n = " << n;
    EXPECT_NE(certificate.proof, Proof::NotApplicable);
  }
  x = random.start;
  EXPECT_EQ(allocations_in([&] {
              Certifier<System> certifier;
              SolverOptions options;
              options.gap = 1e-3;
              options.certifier = certifier;
              summary = Newton<System>(random.system, options).solve(random.system, x);
            }),
            0);
  EXPECT_GE(summary.lower_bound, 0);
}

TEST(Heap, NewtonOfFixedAndBoundedSizesDoesNotUseIt) {
  expect_no_heap<SpringSystem<double, 2, 4>>(4);
  for (const int n : {1, 4, 30}) expect_no_heap<SpringSystem<float, 3, Eigen::Dynamic, 32>>(n);
}

// Also shows that the counter works.
TEST(Heap, NewtonOfDynamicSizesUsesItOnce) {
  using System = SpringSystem<double, 2>;
  testing::Rng rng(6);
  const auto random = testing::random_system<System>(rng, Topology<>::full(12));
  const auto& system = random.system;
  Newton<System> newton;
  System::Points x = random.start;
  EXPECT_GT(allocations_in([&] { newton.solve(system, x); }), 0);
  x = random.start;
  EXPECT_EQ(allocations_in([&] { newton.solve(system, x); }), 0);
  Certifier<System> certifier;
  EXPECT_GT(allocations_in([&] { certifier.certify(system, x); }), 0);
  EXPECT_EQ(allocations_in([&] { certifier.certify(system, random.start); }), 0);
}

}  // namespace
}  // namespace asterism
