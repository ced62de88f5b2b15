// Every solver on difficult models.
#include <gtest/gtest.h>

#include <asterism/solver.hpp>

#include "by_terms.hpp"
#include "matrices.hpp"
#include "model_kits.hpp"
#include "test_systems.hpp"

namespace asterism {
namespace {

using testing::Everything;
using testing::Gemans;
using testing::Ropes;

template <typename System>
using PlainLbfgs = Lbfgs<System>;
template <typename System>
using PlainNonlinearCg = NonlinearCg<System>;
template <typename System>
using PlainSparseNewton = testing::SparseNewton<System>;

// A nonlinear potential, a loss that is not convex, and both with anisotropic anchors.
template <typename K>
class HardModel : public ::testing::Test {};
using HardKits = ::testing::Types<Ropes, Gemans, Everything>;
TYPED_TEST_SUITE(HardModel, HardKits);

TYPED_TEST(HardModel, SolversAgree) {
  testing::finds_minimum<TypeParam, PlainLbfgs>();
  testing::finds_minimum<TypeParam, testing::NewtonCg>();
  testing::finds_minimum<TypeParam, PlainSparseNewton>();
  testing::finds_minimum<TypeParam, PlainNonlinearCg>();
}

TYPED_TEST(HardModel, FixedNodesStayAndTheOthersFindTheirMinimum) {
  using System = typename TypeParam::System;
  testing::expect_fixed_nodes_to_stay<TypeParam, Lbfgs<System, JacobiMetric<System>>>();
}

}  // namespace
}  // namespace asterism
