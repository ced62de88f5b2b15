// Models beyond the paper's springs: user-defined link potentials, robust and anisotropic anchors, fixed
// nodes.
#include <gtest/gtest.h>

#include <asterism/solver.hpp>
#include <asterism/testing/check_model.hpp>
#include <asterism/testing/random_system.hpp>
#include <cmath>
#include <functional>
#include <string>
#include <type_traits>

namespace asterism {
namespace {

/// A user's potential: a spring that gives way, phi = c^2 (sqrt(1 + (r - mu)^2 / c^2) - 1).
struct SoftSpring {
  double c = 0.2;

  template <typename Scalar>
  Derivatives<Scalar> operator()(Scalar r, Scalar mu) const {
    const auto scale = static_cast<Scalar>(c);
    const Scalar t = (r - mu) / scale;
    const Scalar root = std::sqrt(1 + t * t);
    return {scale * scale * (root - 1), scale * t / root, 1 / (root * root * root)};
  }
};

/// A cable: pulls when it is taut, does not push.
struct Cable {
  template <typename Scalar>
  Derivatives<Scalar> operator()(Scalar r, Scalar mu) const {
    if (r <= mu) return {0, 0, 0};
    return {(r - mu) * (r - mu) / 2, r - mu, 1};
  }
};

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
  EXPECT_STREQ(check_link_potential(Cable()).problem, nullptr);
  EXPECT_STREQ(check_anchor_loss(Quadratic()).problem, nullptr);
  EXPECT_STREQ(check_anchor_loss(Huber{3}, 3).problem, nullptr);
  EXPECT_STREQ(check_anchor_loss(GemanMcClure{0.1}, 0.1).problem, nullptr);
}

TEST(CheckModel, NamesWhatIsWrong) {
  EXPECT_STREQ(check_link_potential(TooStiff()).problem, "has more curvature along than a spring");
  EXPECT_STREQ(check_link_potential(WrongSlope()).problem, "has derivatives that are not those of its value");
  EXPECT_STREQ(check_anchor_loss(ConvexLoss()).problem, "is not concave");
}

template <typename ModelType, int kDimension = 2>
struct Kit {
  static constexpr int kNodes = 6;
  // Springs are of a type whose solvers are compiled already.
  static constexpr int kMaxNodes = std::is_same_v<ModelType, Springs> ? Eigen::Dynamic : 8;
  using System = SpringSystem<double, kDimension, Eigen::Dynamic, kMaxNodes, ModelType>;

  static testing::RandomSystem<System> random(std::uint64_t seed) {
    testing::Rng rng(seed);
    auto result = testing::random_system<System>(rng, System::TopologyType::full(kNodes));
    if constexpr (System::kAnisotropic) {
      for (int i = 0; i < kNodes; ++i) {
        Eigen::Matrix<double, kDimension, kDimension> root;
        for (auto& entry : root.reshaped()) entry = rng.uniform(-1, 1);
        result.system.set_anchor_information(i, root * root.transpose() * result.system.anchor_stiffness[i]);
      }
    }
    if constexpr (requires { result.system.anchor_loss.scale; }) result.system.anchor_loss.scale = 0.1;
    return result;
  }
};

using Soft = Kit<Model<SoftSpring>>;
using Cables = Kit<Model<Cable>>;
using Hubers = Kit<Model<Hooke, Huber>>;
using Gemans = Kit<Model<Hooke, GemanMcClure>, 3>;
using Ellipses = Kit<Model<Hooke, Quadratic, AnchorShape::Anisotropic>>;
using Everything = Kit<Model<SoftSpring, Huber, AnchorShape::Anisotropic>, 3>;
using Plain = Kit<Springs>;

template <typename K>
class EveryModel : public ::testing::Test {};
using Kits = ::testing::Types<Soft, Cables, Hubers, Gemans, Ellipses, Everything, Plain>;
TYPED_TEST_SUITE(EveryModel, Kits);

TYPED_TEST(EveryModel, GradientAndHessianAreTheEnergys) {
  using System = typename TypeParam::System;
  using Points = typename System::Points;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const auto [system, x] = TypeParam::random(seed);
    const Points g = gradient(system, x);
    const auto H = hessian(system, x);
    constexpr double kStep = 1e-6;
    for (Eigen::Index k = 0; k < x.size(); ++k) {
      Points ahead = x, behind = x;
      ahead.data()[k] += kStep;
      behind.data()[k] -= kStep;
      const double slope = (energy(system, ahead) - energy(system, behind)) / (2 * kStep);
      EXPECT_NEAR(g.data()[k], slope, 1e-5 * (1 + std::abs(slope)));
      const Points bend = (gradient(system, ahead) - gradient(system, behind)) / (2 * kStep);
      for (Eigen::Index l = 0; l < x.size(); ++l) {
        EXPECT_NEAR(H(l, k), bend.data()[l], 1e-4 * H.cwiseAbs().maxCoeff()) << seed;
      }
    }
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

/// From near one of its minima every solver finds that minimum.
template <typename Kit, template <typename> typename SolverOf>
void finds_minimum() {
  using System = typename Kit::System;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    auto [system, start] = Kit::random(seed);
    Newton<System> newton;
    ASSERT_EQ(newton.solve(system, start).status, Status::Converged);
    const double expected = energy(system, start);
    testing::Rng rng(seed);
    auto x = start;
    x += testing::random_points<System>(rng, Kit::kNodes, -1e-3, 1e-3);
    SolverOf<System> solver;
    solver.options.max_iterations = 100000;
    const Summary summary = solver.solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << solver.name() << " seed " << seed << ": " << summary;
    EXPECT_NEAR(summary.final_energy, expected, 1e-6 * expected + 1e-12) << solver.name() << " seed " << seed;
  }
}

template <typename System>
using PlainIda = Ida<System>;
template <typename System>
using PlainLbfgs = Lbfgs<System>;
template <typename System>
using PlainNewtonCg = NewtonCg<System>;
template <typename System>
using PlainNonlinearCg = NonlinearCg<System>;
template <typename System>
using PlainSparseNewton = SparseNewton<System>;

TYPED_TEST(EveryModel, IdaAndNewtonAgree) {
  finds_minimum<TypeParam, PlainIda>();
  finds_minimum<TypeParam, Newton>();
}

// A potential that bends, a loss that is not convex, and both with anchors that are ellipses.
template <typename K>
class HardModel : public ::testing::Test {};
using HardKits = ::testing::Types<Cables, Gemans, Everything>;
TYPED_TEST_SUITE(HardModel, HardKits);

TYPED_TEST(HardModel, SolversAgree) {
  finds_minimum<TypeParam, PlainLbfgs>();
  finds_minimum<TypeParam, PlainNewtonCg>();
  finds_minimum<TypeParam, PlainSparseNewton>();
  finds_minimum<TypeParam, PlainNonlinearCg>();
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

// Eliminating nodes by hand: their links become anchors on a line of sight, which for springs at rest length
// 0 are exactly those of the remaining system.
template <typename Kit, typename Solver>
void expect_fixed_nodes_to_stay() {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    auto [system, x] = Kit::random(seed);
    const auto start = x;
    system.fix(1);
    system.fix(4);
    const Summary summary = Solver().solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_EQ(x.col(1), start.col(1));
    EXPECT_EQ(x.col(4), start.col(4));
    // The gradient of the free system vanishes for the others alone.
    system.release(1);
    system.release(4);
    const auto g = gradient(system, x);
    const auto scale = node_stiffness(system);
    for (int i : {0, 2, 3, 5}) EXPECT_LT(g.col(i).norm(), 1e-5 * scale[i]) << i;
    EXPECT_GT(g.col(1).norm(), 1e-3 * scale[1]);
  }
}

TYPED_TEST(EveryModel, FixedNodesStayAndTheOthersFindTheirMinimum) {
  expect_fixed_nodes_to_stay<TypeParam, Newton<typename TypeParam::System>>();
}

TYPED_TEST(HardModel, FixedNodesStayAndTheOthersFindTheirMinimum) {
  using System = typename TypeParam::System;
  expect_fixed_nodes_to_stay<TypeParam, Lbfgs<System, JacobiMetric<System>>>();
}

TEST(FixedNodes, AreTheSameAsNodesOfInfiniteStiffness) {
  using System = SpringSystem<double, 2>;
  testing::Rng rng(3);
  const auto random = testing::random_system<System>(rng, Topology<>::full(6));
  System system = random.system;
  const System::Points start = random.start;
  System penalised = system;
  penalised.anchors.col(2) = start.col(2);
  penalised.anchor_stiffness[2] = 1e12 * system.anchor_stiffness[2];
  system.fix(2);
  auto expected = start;
  Newton<System>().solve(penalised, expected);
  const auto check = [&](auto&& solver) {
    auto x = start;
    const Summary summary = solver.solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_LT((x - expected).cwiseAbs().maxCoeff(), 1e-5) << summary;
  };
  check(Newton<System>());
  check(Ida<System>());
  check(SparseIda<System>());
  check(Lbfgs<System>());
  check(NewtonCg<System>());
  check(SparseNewton<System>());
  check(NonlinearCg<System>());
  check(Auto<System>());
}

TEST(FixedNodes, AllOfThem) {
  using System = SpringSystem<double, 2, 4>;
  testing::Rng rng(3);
  auto [system, start] = testing::random_system<System>(rng, Topology<4>::full());
  for (int i = 0; i < 4; ++i) system.fix(i);
  auto x = start;
  const Summary summary = Newton<System>().solve(system, x);
  EXPECT_EQ(summary.status, Status::Converged);
  EXPECT_EQ(x, start);
}

TEST(FixedNodes, ThatDoNotExistAreRefused) {
  SpringSystem<double, 2, 4> system(Topology<4>::full());
  system.anchors.setRandom();
  system.anchor_stiffness.setOnes();
  system.set_rest_lengths(system.anchors);
  system.link_stiffness.setOnes();
  system.fix(7);
  auto x = system.anchors;
  const Summary summary = Newton<decltype(system)>().solve(system, x);
  EXPECT_EQ(summary.status, Status::InvalidInput);
  EXPECT_EQ(summary.message, "fixed node 7 is not a node");
}

TEST(FixedNodes, HoldAComponentWithoutAnchors) {
  using System = SpringSystem<double, 2>;
  System system(Topology<>::full(3));
  system.anchors.setZero();
  system.anchor_stiffness.setZero();
  system.rest_length.setConstant(2);
  system.link_stiffness.setOnes();
  System::Points x(2, 3);
  x << 0, 1, 0, 0, 0, 1;
  EXPECT_EQ(validate(system, x).index, 0);
  system.fix(0);
  EXPECT_FALSE(validate(system, x));
  const Summary summary = Auto<System>().solve(system, x);
  EXPECT_EQ(summary.status, Status::Converged) << summary;
  EXPECT_NEAR(summary.final_energy, 0, 1e-12);
  EXPECT_EQ(x.col(0), Eigen::Vector2d::Zero());
}

TEST(RobustAnchors, IgnoreAnOutlierThatDragsASpring) {
  const auto displaced = [](auto system) {
    using System = decltype(system);
    typename System::Points truth(2, 4);
    truth << 0, 40, 0, 40, 0, 0, 40, 40;
    system.anchors = truth;
    system.anchors.col(3) += Eigen::Vector2d(60, 30);
    system.anchor_stiffness.setOnes();
    system.set_rest_lengths(truth);
    system.link_stiffness.setOnes();
    if constexpr (requires { system.anchor_loss.scale; }) system.anchor_loss.scale = 5;
    typename System::Points x = truth;
    EXPECT_EQ(Newton<System>().solve(system, x).status, Status::Converged);
    return (x - truth).colwise().norm().maxCoeff();
  };
  const double spring = displaced(SpringSystem<double, 2, 4>(Topology<4>::full()));
  const double huber = displaced(Hubers::System(Hubers::System::TopologyType::full(4)));
  const double geman =
      displaced(SpringSystem<double, 2, 4, 4, Model<Hooke, GemanMcClure>>(Topology<4>::full()));
  EXPECT_GT(spring, 10);
  EXPECT_LT(huber, 5);
  EXPECT_LT(geman, 1);
  EXPECT_LT(geman, huber);
}

TEST(RobustAnchors, AreSpringsWithinTheirScale) {
  testing::Rng rng(5);
  const auto [system, start] = testing::random_system<SpringSystem<double, 2, 4>>(rng, Topology<4>::full());
  SpringSystem<double, 2, 4, 4, Model<Hooke, Huber>> robust(Topology<4>::full());
  robust.anchors = system.anchors;
  robust.anchor_stiffness = system.anchor_stiffness;
  robust.rest_length = system.rest_length;
  robust.link_stiffness = system.link_stiffness;
  robust.anchor_loss.scale = 100;
  EXPECT_EQ(energy(robust, start), energy(system, start));
  EXPECT_EQ(gradient(robust, start), gradient(system, start));
  EXPECT_EQ(hessian(robust, start), hessian(system, start));
}

using Elliptic = Ellipses::System;

TEST(AnisotropicAnchors, HaveTheEnergyOfTheirInformationMatrix) {
  Elliptic system(Elliptic::TopologyType::full(1));
  system.anchors << 1, 2;
  Eigen::Matrix2d information;
  information << 5, 2, 2, 3;
  system.set_anchor_information(0, information);
  const Eigen::Vector2d d(0.3, -0.7);
  EXPECT_NEAR(energy(system, system.anchors + d), 0.5 * d.dot(information * d), 1e-14);
  EXPECT_LT((hessian(system, system.anchors + d) - information).norm(), 1e-13);
  EXPECT_NEAR(system.anchor_stiffness[0], 4 + std::sqrt(5.0), 1e-12);
}

TEST(AnisotropicAnchors, RefuseWhatIsNoInformationMatrix) {
  const auto refused = [](const Eigen::Matrix2d& information) {
    Elliptic system(Elliptic::TopologyType::full(1));
    system.anchors << 1, 2;
    system.set_anchor_information(0, information);
    Elliptic::Points x = system.anchors;
    const Summary summary = Newton<Elliptic>().solve(system, x);
    EXPECT_EQ(summary.status, Status::InvalidInput);
    return std::string(std::string_view(summary.message));
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(refused(Eigen::Vector2d(1, -1).asDiagonal()),
            "information matrix of anchor 0 is not symmetric and positive semi-definite");
  EXPECT_EQ(refused(Eigen::Matrix2d{{1, 0.5}, {0, 1}}),
            "information matrix of anchor 0 is not symmetric and positive semi-definite");
  EXPECT_EQ(refused(Eigen::Vector2d(nan, 1).asDiagonal()), "anchor stiffness 0 is negative or not finite");
  Elliptic unset(Elliptic::TopologyType::full(1));
  unset.anchors << 1, 2;
  unset.anchor_stiffness << 1;
  Elliptic::Points x = unset.anchors;
  EXPECT_EQ(Newton<Elliptic>().solve(unset, x).status, Status::InvalidInput);
}

TEST(RobustAnchors, RefuseAScaleThatIsNone) {
  Hubers::System system(Hubers::System::TopologyType::full(1));
  system.anchors << 1, 2;
  system.anchor_stiffness << 1;
  system.anchor_loss.scale = 0;
  auto x = system.anchors;
  const Summary summary = Newton<decltype(system)>().solve(system, x);
  EXPECT_EQ(summary.status, Status::InvalidInput);
  EXPECT_EQ(summary.message, "anchor loss is not a positive, finite scale");
}

}  // namespace
}  // namespace asterism
