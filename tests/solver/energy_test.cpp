#include <gtest/gtest.h>

#include <asterism/solver/energy/align.hpp>
#include <asterism/solver/energy/covariance.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/hessian.hpp>
#include <asterism/solver/energy/hessian_operator.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>
#include <type_traits>
#include <vector>

#include "matrices.hpp"
#include "test_systems.hpp"

namespace asterism {
namespace {

template <typename System>
class Energy : public ::testing::Test {};

// Each dimension, storage and scalar once; every_solver.cpp has more combinations.
using Systems = ::testing::Types<testing::Line, testing::Fixed2, testing::Bounded2, testing::Spacef>;
TYPED_TEST_SUITE(Energy, Systems);

// Random systems; if the number of nodes is not fixed, of seven nodes and of one.
template <typename System>
std::vector<testing::RandomSystem<System>> make(std::uint64_t seed) {
  std::vector<testing::RandomSystem<System>> result;
  for (const int n : {7, 1}) {
    testing::Rng rng(seed);
    result.push_back(testing::random_system<System>(
        rng, System::TopologyType::full(System::kNodes == Eigen::Dynamic ? n : System::kNodes)));
    if (System::kNodes != Eigen::Dynamic) break;
  }
  return result;
}

// The same system in double, where differences are more accurate.
template <typename System>
auto in_double(const testing::RandomSystem<System>& from) {
  using Double = std::conditional_t<System::kDim == 1, testing::Line, SpringSystem<double, System::kDim>>;
  testing::RandomSystem<Double> to{
      Double(Double::TopologyType::from_links(from.system.nodes(), from.system.links())),
      from.start.template cast<double>()};
  to.system.anchors = from.system.anchors.template cast<double>();
  to.system.anchor_stiffness = from.system.anchor_stiffness.template cast<double>();
  to.system.rest_length = from.system.rest_length.template cast<double>();
  to.system.link_stiffness = from.system.link_stiffness.template cast<double>();
  return to;
}

template <typename Points>
Eigen::MatrixXd in_double(const Points& points) {
  return points.template cast<double>();
}

template <typename Scalar>
constexpr double rounding() {
  return std::is_same_v<Scalar, float> ? 2e-5 : 1e-12;
}

// The energy's formula, term by term.
double sum_over_springs(const Eigen::MatrixXd& anchors, const Eigen::VectorXd& anchor_stiffness,
                        std::span<const Link> links, const Eigen::VectorXd& rest_length,
                        const Eigen::VectorXd& link_stiffness, const Eigen::MatrixXd& x) {
  double sum = 0;
  for (Eigen::Index i = 0; i < x.cols(); ++i) {
    sum += 0.5 * anchor_stiffness[i] * (x.col(i) - anchors.col(i)).squaredNorm();
  }
  int l = 0;
  for (const Link& link : links) {
    const double stretch = rest_length[l] - (x.col(link.i) - x.col(link.j)).norm();
    sum += 0.5 * link_stiffness[l] * stretch * stretch;
    ++l;
  }
  return sum;
}

TYPED_TEST(Energy, IsTheSumOverTheSprings) {
  for (const auto& original : make<TypeParam>(1)) {
    const auto& [system, x] = original;
    const auto [twin, twin_x] = in_double(original);
    const double expected = sum_over_springs(twin.anchors, twin.anchor_stiffness, twin.links(),
                                             twin.rest_length, twin.link_stiffness, twin_x);
    typename TypeParam::Points g;
    EXPECT_NEAR(double(energy(system, x)), expected, rounding<typename TypeParam::Scalar>() * expected);
    EXPECT_NEAR(double(energy_and_gradient(system, x, g)), expected,
                rounding<typename TypeParam::Scalar>() * expected);
    EXPECT_TRUE(testing::is_same(in_double(g), in_double(gradient(system, x))));
  }
}

TYPED_TEST(Energy, GradientMatchesFiniteDifferences) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    for (const auto& original : make<TypeParam>(seed)) {
      const auto [system, x] = in_double(original);
      const auto energy_at = [&system = system](const Eigen::MatrixXd& at) {
        return Eigen::MatrixXd::Constant(1, 1, energy(system, at)).eval();
      };
      const double tolerance = std::is_same_v<typename TypeParam::Scalar, float> ? 1e-5 : 1e-7;
      EXPECT_TRUE(testing::is_near(in_double(gradient(original.system, original.start)).reshaped(1, x.size()),
                                   testing::differences(energy_at, x, 1e-6), tolerance));
    }
  }
}

TYPED_TEST(Energy, HessianMatchesFiniteDifferences) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    for (const auto& original : make<TypeParam>(seed)) {
      const auto [system, x] = in_double(original);
      const Eigen::MatrixXd analytic = in_double(hessian(original.system, original.start));
      const auto gradient_at = [&system = system](const Eigen::MatrixXd& at) -> Eigen::MatrixXd {
        return gradient(system, at);
      };
      const double tolerance = std::is_same_v<typename TypeParam::Scalar, float> ? 1e-5 : 1e-6;
      EXPECT_TRUE(testing::is_near(analytic, testing::differences(gradient_at, x, 1e-6), tolerance));
      EXPECT_TRUE(testing::is_same(analytic, analytic.transpose()));
    }
  }
}

TYPED_TEST(Energy, SparseHessianIsTheDenseOne) {
  for (const auto& [system, x] : make<TypeParam>(3)) {
    const Eigen::MatrixXd dense = in_double(hessian(system, x));
    const Eigen::MatrixXd sparse = in_double(sparse_hessian(system, x).toDense());
    EXPECT_LE((dense - sparse).norm(), rounding<typename TypeParam::Scalar>() * dense.norm());
  }
}

// For x_i = x_j the gradient is that of a spring along u, the limit x_i - x_j -> 0 along u.
void expect_coincident_limit(const testing::Plane& system, const Eigen::Matrix2Xd& x,
                             const Eigen::Vector2d& u) {
  const auto g = gradient(system, x);
  ASSERT_TRUE(g.allFinite());
  auto apart = x;
  apart.col(0) += 1e-9 * u;
  EXPECT_LT((gradient(system, apart) - g).norm(), 1e-7 * g.norm());
  auto descended = x;
  descended -= 1e-6 * g;
  EXPECT_LT(energy(system, descended), energy(system, x));
  EXPECT_NEAR(energy(system, x), energy(system, apart), 1e-7);
}

TEST(CoincidentNodes, PartAlongTheirAnchors) {
  testing::Plane system(Topology<>::full(2));
  system.anchors << 3, 0, 4, 0;
  system.anchor_stiffness << 1, 1;
  system.rest_length << 2;
  system.link_stiffness << 5;
  const Eigen::Matrix2Xd x = Eigen::Matrix2Xd::Ones(2, 2);
  expect_coincident_limit(system, x, {0.6, 0.8});
}

TEST(CoincidentNodes, PartAlongAFixedDirectionWhereAnchorsCoincideToo) {
  SpringSystem<double, 3> system(Topology<>::full(3));
  system.anchors.setConstant(2);
  system.anchor_stiffness.setOnes();
  system.rest_length.setConstant(1);
  system.link_stiffness.setConstant(1);
  const Eigen::Matrix3Xd x = system.anchors;
  const auto g = gradient(system, x);
  EXPECT_GT(g.colwise().norm().minCoeff(), 0.1);
  EXPECT_TRUE(testing::is_same(g, gradient(system, x)));
  EXPECT_LT(g.rowwise().sum().norm(), 1e-15);  // internal forces cancel
  const Link forward[] = {{0, 1}};
  const Link backward[] = {{1, 0}};
  for (const auto& links : {forward, backward}) {
    SpringSystem<double, 3> pair(Topology<>::from_links(2, {links, 1}));
    pair.anchors.setZero();
    pair.anchor_stiffness.setOnes();
    pair.rest_length.setOnes();
    pair.link_stiffness.setOnes();
    static Eigen::Matrix3Xd first;
    const Eigen::Matrix3Xd now = gradient(pair, Eigen::Matrix3Xd(pair.anchors));
    EXPECT_NEAR(now.col(0).norm(), 1, 1e-15);
    if (links == forward) first = now;
    EXPECT_TRUE(testing::is_same(now, first));  // a link has no orientation
  }
}

TEST(CoincidentNodes, HessianIsFiniteAndExactForZeroRestLength) {
  SpringSystem<double, 2> system(Topology<>::full(2));
  system.anchors << 0, 1, 0, 0;
  system.anchor_stiffness.setOnes();
  system.link_stiffness.setConstant(3);
  const Eigen::Matrix2Xd x = Eigen::Matrix2Xd::Constant(2, 2, 0.5);
  system.rest_length.setConstant(0);
  Eigen::Matrix4d expected;  // 3/2 |x_0 - x_1|^2, and the anchors' 1/2 |x_i - a_i|^2
  expected << 4, 0, -3, 0, 0, 4, 0, -3, -3, 0, 4, 0, 0, -3, 0, 4;
  EXPECT_TRUE(testing::is_same(hessian(system, x), expected));
  system.rest_length.setConstant(2);
  const Eigen::Matrix4d along = hessian(system, x);
  EXPECT_DOUBLE_EQ(along(0, 0), 4);
  EXPECT_DOUBLE_EQ(along(1, 1), 1);
}

TEST(CoincidentNodes, LengthsBelowTheSquareRootOfTheSmallestNumberAreNotZero) {
  SpringSystem<double, 2> system(Topology<>::full(2));
  system.anchors << 0, 0, 0, 1;
  system.anchor_stiffness.setZero();
  system.link_stiffness.setOnes();
  system.rest_length.setOnes();
  Eigen::Matrix2Xd x(2, 2);
  x << 1e-200, 0, 0, 0;
  EXPECT_NEAR(gradient(system, x)(0, 0), -1, 1e-15);
  EXPECT_NEAR(gradient(system, x)(1, 0), 0, 1e-15);
}

// The energy is not convex: two nodes nearer than their rest length.
TEST(EnergyExamples, IsNotConvex) {
  testing::Plane system(Topology<>::full(2));
  system.anchors << -0.1, 0.1, 0, 0;
  system.anchor_stiffness.setConstant(0.01);
  system.rest_length.setOnes();
  system.link_stiffness.setOnes();
  const Eigen::VectorXd eigenvalues = testing::eigenvalues(hessian(system, system.anchors));
  EXPECT_LT((eigenvalues - Eigen::Vector4d(-7.99, 0.01, 0.01, 2.01)).norm(), 1e-12);
  Eigen::Matrix2Xd left(2, 2);
  left << -0.5, 0.5, 0, 0;
  const Eigen::Matrix2Xd right = -left;
  const Eigen::Matrix2Xd middle = (left + right) / 2;
  EXPECT_NEAR(energy(system, left), 0.0016, 1e-12);
  EXPECT_NEAR(energy(system, right), 0.0036, 1e-12);
  EXPECT_NEAR(energy(system, middle), 0.5001, 1e-12);
}

TEST(EnergyExamples, DuplicatedLinksAddUp) {
  const Link twice[] = {{0, 1}, {1, 0}};
  SpringSystem<double, 2> parallel(Topology<>::from_links(2, twice));
  SpringSystem<double, 2> single(Topology<>::full(2));
  for (auto* system : {&parallel, &single}) {
    system->anchors << 0, 1, 0, 2;
    system->anchor_stiffness << 1, 2;
    system->rest_length.setConstant(3);
  }
  parallel.link_stiffness << 1.5, 2.5;
  single.link_stiffness << 4;
  EXPECT_NEAR(energy(parallel, parallel.anchors), energy(single, single.anchors), 1e-14);
  EXPECT_LT((gradient(parallel, parallel.anchors) - gradient(single, single.anchors)).norm(), 1e-14);
}

/// A potential that is not finite for some rest lengths.
struct Logarithm {
  template <typename Scalar>
  Derivatives<Scalar> operator()(Scalar r, Scalar mu) const {
    return {r / mu, 1 / mu, 0};
  }
};

// A spring without stiffness adds nothing to anything, whatever position or rest length it has.
template <typename System>
class SpringsThatAreOff : public ::testing::Test {};
using ModelSystems =
    ::testing::Types<testing::Fixed2, testing::Spacef, testing::Bounded2, testing::FixedEllipses,
                     SpringSystem<float, 2, -1, -1, Model<Logarithm, GemanMcClure>>>;
TYPED_TEST_SUITE(SpringsThatAreOff, ModelSystems);

// All quantities computed from a system at x; `v` is any vector.
template <typename System>
std::vector<Eigen::MatrixXd> numbers_of(const System& system, const typename System::Points& x,
                                        const typename System::Points& v) {
  std::vector<Eigen::MatrixXd> all;
  const auto add_number = [&](double number) {
    EXPECT_TRUE(std::isfinite(number));
    all.push_back(Eigen::MatrixXd::Constant(1, 1, number));
  };
  const auto add = [&](const auto& matrix) { all.push_back(in_double(matrix)); };
  const auto add_finite = [&](const auto& matrix) {
    add(matrix);
    EXPECT_TRUE(all.back().allFinite());
  };
  typename System::Points points;
  add_number(double(energy_and_gradient(system, x, points)));
  EXPECT_EQ(all.back()(0, 0), double(energy(system, x)));
  add_finite(points);
  add_number(double(characteristic_length(system, x)));
  add_finite(rigid_alignment(system, x));
  detail::HessianOperator<System> hessian_operator;
  hessian_operator.set(system, x);
  hessian_operator.apply(system, v, points);
  add_finite(points);
  add_finite(hessian(system, x));
  add(sparse_hessian(system, x).toDense());
  if (const auto certainty = covariance(system, x)) add(certainty.matrix);
  add(Eigen::Matrix<double, 1, 1>(stationarity(system, x)));
  return all;
}

TYPED_TEST(SpringsThatAreOff, MeanNothing) {
  using System = TypeParam;
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;
  constexpr Scalar kMost = std::numeric_limits<Scalar>::max();
  constexpr int n = System::kNodes == Eigen::Dynamic ? 12 : System::kNodes;  // 12: in rows
  testing::Rng rng(3);
  const auto [plain, plain_start] =
      testing::random_system<SpringSystem<double, System::kDim>>(rng, Topology<>::full(n));
  const Points start = plain_start.template cast<Scalar>();
  System system(System::TopologyType::full(n));
  system.anchors = plain.anchors.template cast<Scalar>();
  system.anchor_stiffness = plain.anchor_stiffness.template cast<Scalar>();
  system.rest_length = plain.rest_length.template cast<Scalar>();
  system.link_stiffness = plain.link_stiffness.template cast<Scalar>();
  if constexpr (System::kAnisotropic) {
    for (int i = 0; i < n; ++i)
      system.set_anchor_information(i, Scalar(i + 1) * Eigen::Matrix<Scalar, 2, 2>::Identity());
  }
  system.anchor_stiffness[1] = system.anchor_stiffness[3] = 0;
  system.link_stiffness[0] = system.link_stiffness[4] = 0;
  for (const bool coincide : {false, true}) {
    Points x = start;
    if (coincide) x.col(1) = x.col(2);  // linked by a spring with stiffness
    const std::vector<Eigen::MatrixXd> expected = numbers_of(system, x, start);
    for (const Scalar idle : {Scalar(0), 10 * std::sqrt(kMost), kMost}) {
      system.anchors.col(1).setConstant(idle);
      system.anchors.col(3).setConstant(-idle);
      system.rest_length[0] = system.rest_length[4] = idle;
      const std::vector<Eigen::MatrixXd> numbers = numbers_of(system, x, start);
      ASSERT_EQ(numbers.size(), expected.size()) << idle;
      for (std::size_t k = 0; k < numbers.size(); ++k) {
        EXPECT_TRUE(testing::is_same(numbers[k], expected[k])) << idle << ", number " << k;
      }
    }
  }
}

TEST(Stationarity, IsTheLargestForceOverStiffnessAndLength) {
  SpringSystem<double, 2> system(Topology<>::from_links(2, {}));
  system.anchors << -3, 3, 0, 0;  // root mean square about the centroid: 3
  system.anchor_stiffness << 2, 4;
  Eigen::Matrix2Xd x = system.anchors;
  x(0, 0) += 0.3;
  x(1, 1) += 0.6;
  EXPECT_NEAR(characteristic_length(system, x), 3, 1e-15);
  EXPECT_NEAR(stationarity(system, x), 0.2, 1e-15);  // node 1 would move 0.6
}

TEST(Stationarity, LengthFallsBackToTheSpreadOfX) {
  SpringSystem<double, 2> system(Topology<>::full(2));
  system.anchors.setConstant(5);
  system.anchor_stiffness.setOnes();
  system.rest_length.setZero();
  system.link_stiffness.setOnes();
  Eigen::Matrix2Xd x = system.anchors;
  EXPECT_EQ(characteristic_length(system, x), 0);
  EXPECT_EQ(stationarity(system, x), 0);
  x(0, 0) += 4;
  x(0, 1) -= 4;
  EXPECT_DOUBLE_EQ(characteristic_length(system, x), 4);
  EXPECT_GT(stationarity(system, x), 0.1);
  x.array() += 1e18;  // a distant start does not loosen the tolerance
  EXPECT_DOUBLE_EQ(characteristic_length(system, x), 5);
}

// Without anchors and rest lengths, the length is the spread of x, independent of translation.
TEST(Stationarity, LengthWithoutAnchorsIsInvariantToTranslation) {
  SpringSystem<double, 2> system(Topology<>::full(2));
  system.anchor_stiffness.setZero();
  system.rest_length.setZero();
  system.link_stiffness.setOnes();
  Eigen::Matrix2Xd x(2, 2);
  x << -1, 1, 0, 0;
  EXPECT_DOUBLE_EQ(characteristic_length(system, x), 1);
  x.array() += 4096;
  EXPECT_DOUBLE_EQ(characteristic_length(system, x), 1);
}

TEST(Stationarity, IgnoresAnchorsAndLinksWithoutStiffness) {
  SpringSystem<double, 2> system(Topology<>::full(3));
  system.anchors << -1, 1, 1e9, 0, 0, 0;
  system.anchor_stiffness << 1, 1, 0;
  system.rest_length << 1, 1, 1e9;
  system.link_stiffness << 1, 1, 0;
  EXPECT_NEAR(characteristic_length(system, system.anchors), 1, 1e-15);
}

// A spring that holds little counts little; springs that hold enough count equally.
TEST(Stationarity, LengthIsOfWhatHolds) {
  SpringSystem<double, 2> system(Topology<>::from_links(3, std::vector<Link>{{0, 1}}));
  system.anchors << -1, 1, 0, 0, 0, 0;
  system.anchor_stiffness << 1, 5, 1;
  system.rest_length << 1;
  system.link_stiffness << 1;
  const auto length = [&] { return characteristic_length(system, system.anchors); };
  EXPECT_NEAR(length(), 1, 1e-15);
  system.anchors.col(2).setConstant(1e8);  // the anchor of an isolated node
  EXPECT_NEAR(length(), 1, 1e-15);
  system.link_stiffness << 1e-9;  // a link that holds little
  system.rest_length << 10;
  EXPECT_NEAR(length(), 1, 1e-3);
  system.link_stiffness << 1e-3;
  EXPECT_NEAR(length(), std::sqrt((2 + 100) / 3.0), 1e-12);
  system.fix(1);  // its anchor has no effect
  EXPECT_NEAR(length(), std::sqrt(100 / 2.0), 1e-12);
  system.release(1);
  system.link_stiffness << 0;  // only isolated nodes
  system.anchors.col(2) << 0, 3;
  EXPECT_NEAR(length(), std::sqrt((2 + 6) / 3.0), 1e-15);
}

}  // namespace
}  // namespace asterism
