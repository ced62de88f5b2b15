// Models beyond the paper's springs: user-defined link potentials, robust and anisotropic anchors.
#include <gtest/gtest.h>

#include <asterism/solver.hpp>
#include <asterism/testing/check_model.hpp>
#include <cmath>
#include <cstdint>

#include "matrices.hpp"
#include "model_kits.hpp"
#include "test_systems.hpp"

namespace asterism {
namespace {

using testing::SoftSpring;

struct TooStiff {
  template <typename Scalar>
  Derivatives<Scalar> operator()(Scalar r, Scalar mu) const {
    return {(r - mu) * (r - mu), 2 * (r - mu), 2};
  }
};

struct WrongSlope {
  template <typename Scalar>
  Derivatives<Scalar> operator()(Scalar r, Scalar mu) const {
    return {(r - mu) * (r - mu) / 2, (r - mu) / 2, Scalar(0.5)};
  }
};

struct ConvexLoss {
  template <typename Scalar>
  Derivatives<Scalar> operator()(Scalar s) const {
    return {s * s / 2, s, 1};
  }
};

TEST(CheckModel, AcceptsWhatSolversCanRelyOn) {
  EXPECT_STREQ(check_link_potential(Hooke()).problem, nullptr);
  EXPECT_STREQ(check_link_potential(SoftSpring(), 0.5).problem, nullptr);
  EXPECT_STREQ(check_link_potential(Rope()).problem, nullptr);
  EXPECT_STREQ(check_link_potential(Repulsion()).problem, nullptr);
  EXPECT_STREQ(check_link_potential(RobustHooke<Huber>{{3}}, 3).problem, nullptr);
  EXPECT_STREQ(check_link_potential(RobustHooke<GemanMcClure>{{1}}, 0.02).problem, nullptr);
  EXPECT_STREQ(check_link_potential(RobustHooke<Truncated>{{2, 3}}, 2).problem, nullptr);
  EXPECT_STREQ(check_anchor_loss(Quadratic()).problem, nullptr);
  EXPECT_STREQ(check_anchor_loss(Huber{3}, 3).problem, nullptr);
  EXPECT_STREQ(check_anchor_loss(GemanMcClure{0.1}, 0.1).problem, nullptr);
  EXPECT_STREQ(check_anchor_loss(Truncated{0.1}, 0.1).problem, nullptr);
  EXPECT_STREQ(check_anchor_loss(Truncated{5, 0.01}, 5).problem, nullptr);
}

TEST(CheckModel, NamesWhatIsWrong) {
  EXPECT_STREQ(check_link_potential(TooStiff()).problem, "has more curvature along than a spring");
  EXPECT_STREQ(check_link_potential(WrongSlope()).problem, "has derivatives that are not those of its value");
  EXPECT_STREQ(check_anchor_loss(ConvexLoss()).problem, "is not concave");
}

using testing::Ellipses;
using testing::Everything;
using testing::Gemans;
using testing::Hubers;
using testing::Plain;
using testing::Ropes;
using testing::Soft;
using testing::Spacers;

template <typename K>
class EveryModel : public ::testing::Test {};
using Kits = ::testing::Types<Soft, Ropes, Spacers, Hubers, Gemans, Ellipses, Everything, Plain>;
TYPED_TEST_SUITE(EveryModel, Kits);

TYPED_TEST(EveryModel, GradientAndHessianAreTheEnergys) {
  using System = typename TypeParam::System;
  using Points = typename System::Points;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const auto [system, x] = TypeParam::random(seed);
    const Eigen::MatrixXd g = gradient(system, x);
    const Eigen::MatrixXd H = hessian(system, x);
    const auto energy_at = [&system = system](const Eigen::MatrixXd& at) -> Eigen::MatrixXd {
      return Eigen::MatrixXd::Constant(1, 1, energy(system, Points(at)));
    };
    const auto gradient_at = [&system = system](const Eigen::MatrixXd& at) -> Eigen::MatrixXd {
      return gradient(system, Points(at));
    };
    const Eigen::MatrixXd slope = testing::differences(energy_at, x, 1e-6);
    const Eigen::MatrixXd bend = testing::differences(gradient_at, x, 1e-6);
    for (Eigen::Index k = 0; k < g.size(); ++k) {
      EXPECT_NEAR(g.data()[k], slope(0, k), 1e-5 * (1 + std::abs(slope(0, k))));
    }
    EXPECT_LE((H - bend).cwiseAbs().maxCoeff(), 1e-4 * H.cwiseAbs().maxCoeff()) << seed;
    EXPECT_LT((Eigen::MatrixXd(sparse_hessian(system, x)) - H).cwiseAbs().maxCoeff(),
              1e-9 * H.cwiseAbs().maxCoeff());
  }
}

TYPED_TEST(EveryModel, IdaNeverRaisesTheEnergy) {
  using System = typename TypeParam::System;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const auto [system, start] = TypeParam::random(seed);
    Ida<System> ida;
    ida.options.max_iterations = 1;
    auto x = start;
    double before = energy(system, x);
    for (int i = 0; i < 60; ++i) {
      const Summary summary = ida.solve(system, x);
      ASSERT_TRUE(summary.usable()) << summary;
      ASSERT_LE(summary.final_energy, before * (1 + 1e-14));
      before = summary.final_energy;
    }
  }
}

template <typename System>
using PlainIda = Ida<System>;

TYPED_TEST(EveryModel, IdaAndNewtonAgree) {
  testing::finds_minimum<TypeParam, PlainIda>();
  testing::finds_minimum<TypeParam, Newton>();
}

TYPED_TEST(EveryModel, AlignmentNeverRaisesTheEnergy) {
  using System = typename TypeParam::System;
  int moved = 0;
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    const auto [system, x] = TypeParam::random(seed);
    const typename System::Points aligned = rigid_alignment(system, x);
    EXPECT_LE(energy(system, aligned), energy(system, x) * (1 + 1e-14));
    moved += aligned != x;
  }
  EXPECT_GT(moved, 25);
}

TYPED_TEST(EveryModel, FixedNodesStayAndTheOthersFindTheirMinimum) {
  testing::expect_fixed_nodes_to_stay<TypeParam, Newton<typename TypeParam::System>>();
}

}  // namespace
}  // namespace asterism
