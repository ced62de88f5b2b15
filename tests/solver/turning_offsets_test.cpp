// Offsets that turn and scale with the constellation: against linear least squares, and finite differences.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <asterism/solver/terms/from_springs.hpp>
#include <asterism/solver/terms/solve.hpp>
#include <cmath>
#include <cstdint>
#include <limits>

#include "matrices.hpp"
#include "test_systems.hpp"

namespace asterism {
namespace {

using testing::random_points;
using testing::Rng;

template <int Dim>
using System = SpringSystem<double, Dim>;

// Of springs, by their terms.
template <int Dim>
struct Turning {
  TurningOptions options;
  Eigen::MatrixXd T;

  Summary solve(const System<Dim>& system, typename System<Dim>::Points& x) {
    Eigen::MatrixXd points = x;
    const Summary summary = solve_turning(to_system(system), points, T, options);
    x = points;
    return summary;
  }
  Eigen::Matrix<double, Dim, Dim> transform() const { return T; }
};

template <int Dim>
Eigen::MatrixXd turn(int a, int b, double angle) {
  Eigen::MatrixXd R = Eigen::MatrixXd::Identity(Dim, Dim);
  R(a, a) = R(b, b) = std::cos(angle), R(b, a) = std::sin(angle), R(a, b) = -std::sin(angle);
  return R;
}

template <int Dim>
Eigen::Matrix<double, Dim, Dim> random_rotation(Rng& rng) {
  Eigen::Matrix<double, Dim, Dim> R = Eigen::Matrix<double, Dim, Dim>::Identity();
  for (int round = 0; round < 2; ++round) {  // one round would favour some rotations
    for (int b = 1; b < Dim; ++b) {
      for (int a = 0; a < b; ++a) R = (turn<Dim>(a, b, rng.uniform(-3.2, 3.2)) * R).eval();
    }
  }
  return R;
}

// A shape, turned and scaled and then detected with errors.
template <int Dim>
testing::RandomSystem<System<Dim>> random_shape(std::uint64_t seed, int nodes, double error) {
  Rng rng(seed);
  System<Dim> system(Topology<>::full(nodes));
  const auto shape = random_points<System<Dim>>(rng, nodes, -10, 10);
  system.set_rest_offsets(shape);
  for (double& k : system.link_stiffness) k = rng.uniform(0.2, 2);
  for (double& k : system.anchor_stiffness) k = rng.uniform(0.01, 0.1);
  system.anchors = rng.uniform(0.5, 2) * random_rotation<Dim>(rng) * shape +
                   random_points<System<Dim>>(rng, nodes, -error, error);
  system.anchors.colwise() += Eigen::Matrix<double, Dim, 1>::Constant(rng.uniform(-50, 50));
  return {system, system.anchors};
}

// sum k_i |x_i - a_i|^2 + sum k_ij |x_i - x_j - (a, -b; b, a) m_ij|^2 is linear least squares in x, a and b.
System<2>::Points least_squares(const System<2>& system, Eigen::Matrix2d& transform) {
  const int n = system.nodes(), rows = 2 * (n + system.link_count());
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(rows, 2 * n + 2);
  Eigen::VectorXd b = Eigen::VectorXd::Zero(rows);
  for (int i = 0; i < n; ++i) {
    const double w = std::sqrt(system.anchor_stiffness[i]);
    for (int d = 0; d < 2; ++d) A(2 * i + d, 2 * i + d) = w, b[2 * i + d] = w * system.anchors(d, i);
  }
  int row = 2 * n, l = 0;
  for (const Link& link : system.links()) {
    const double w = std::sqrt(system.link_stiffness[l]);
    const Eigen::Vector2d m = system.rest_offset.col(l++);
    for (int d = 0; d < 2; ++d, ++row) {
      A(row, 2 * link.i + d) = w;
      A(row, 2 * link.j + d) = -w;
      A(row, 2 * n) = -w * m[d];
      A(row, 2 * n + 1) = d == 0 ? w * m.y() : -w * m.x();
    }
  }
  const Eigen::VectorXd solution = testing::inverse(A.transpose() * A) * (A.transpose() * b);
  transform << solution[2 * n], -solution[2 * n + 1], solution[2 * n + 1], solution[2 * n];
  return solution.head(2 * n).reshaped(2, n);
}

TEST(TurningOffsets, OfThePlaneAreLeastSquares) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const auto [system, start] = random_shape<2>(seed, 6, 2);
    Eigen::Matrix2d transform;
    const auto expected = least_squares(system, transform);
    Turning<2> turning;
    System<2>::Points x = start;
    const Summary summary = turning.solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_LT((x - expected).cwiseAbs().maxCoeff(), 1e-5) << seed;
    EXPECT_LT((turning.transform() - transform).norm(), 1e-6);
    EXPECT_LT(summary.iterations, 20) << summary;  // extrapolated: weak anchors alone would take hundreds
    EXPECT_LE(summary.final_energy, summary.initial_energy);
    // Whatever the start.
    Rng rng(seed);
    x = random_points<System<2>>(rng, 6, -100, 100);
    EXPECT_EQ(turning.solve(system, x).status, Status::Converged);
    EXPECT_LT((x - expected).cwiseAbs().maxCoeff(), 1e-5) << seed;
  }
}

// The energy as a function of x and T falls in no direction: by finite differences of both.
template <int Dim>
void expect_stationary(const System<Dim>& system, const typename System<Dim>::Points& x,
                       const Eigen::Matrix<double, Dim, Dim>& T, bool scales) {
  const auto at = [&](const auto& points, const Eigen::MatrixXd& transform) {
    System<Dim> turned = system;
    turned.rest_offset = transform * system.rest_offset;
    return energy(turned, points);
  };
  const double h = 1e-5, here = at(x, T), curvature = system.link_stiffness.sum() * 100;
  for (int c = 0; c < x.size(); ++c) {
    typename System<Dim>::Points ahead = x, behind = x;
    ahead.data()[c] += h, behind.data()[c] -= h;
    EXPECT_NEAR((at(ahead, T) - at(behind, T)) / (2 * h), 0, 1e-4);
  }
  for (int a = 0; a < Dim; ++a) {
    for (int b = a + 1; b < Dim; ++b) {
      Eigen::MatrixXd turn = Eigen::MatrixXd::Identity(Dim, Dim);
      turn(a, a) = turn(b, b) = std::cos(h), turn(b, a) = std::sin(h), turn(a, b) = -std::sin(h);
      EXPECT_NEAR((at(x, turn * T) - at(x, turn.transpose() * T)) / (2 * h), 0, 1e-6 * (here + curvature));
    }
  }
  if (scales) {
    EXPECT_NEAR((at(x, (1 + h) * T) - at(x, (1 - h) * T)) / (2 * h), 0, 1e-6 * (here + curvature));
  }
}

TEST(TurningOffsets, AreStationaryInBoth) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    for (const bool scales : {true, false}) {
      auto [system, start] = random_shape<3>(seed, 7, 2);
      if (seed % 2 == 0) system.rest_length.setConstant(1.5);  // a length from the end of the offset
      if (seed % 3 == 0) system.loads = System<3>::Points::Constant(3, 7, 0.1);
      Turning<3> turning;
      turning.options.scale = scales;
      System<3>::Points x = start;
      const Summary summary = turning.solve(system, x);
      EXPECT_EQ(summary.status, Status::Converged) << summary;
      expect_stationary<3>(system, x, turning.transform(), scales);
      const double scale = std::cbrt(turning.transform().determinant());
      EXPECT_GT(scale, 0);
      if (!scales) {
        EXPECT_NEAR(scale, 1, 1e-12);
      }
      EXPECT_LT((turning.transform().transpose() * turning.transform() -
                 scale * scale * Eigen::Matrix3d::Identity())
                    .norm(),
                1e-12 * scale * scale * 10);
    }
  }
}

// The least energy over x for a given T, in long double: x solves (diag(k_i) + Laplacian(k_ij)) x = ...
template <int Dim>
class Reduced {
 public:
  using Wide = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;

  Reduced(const System<Dim>& system, const Eigen::MatrixXd& start) : system_(system) {
    const int n = system.nodes();
    Wide A = system.anchor_stiffness.template cast<long double>().asDiagonal();
    right_ = A * system.anchors.transpose().template cast<long double>();
    if (system.has_loads()) right_ += system.loads.transpose().template cast<long double>();
    int l = 0;
    for (const Link& link : system.links()) {
      const long double k = system.link_stiffness[l++];
      A(link.i, link.i) += k, A(link.j, link.j) += k;
      A(link.i, link.j) -= k, A(link.j, link.i) -= k;
    }
    for (int i = 0; i < n; ++i) {
      if (!system.is_fixed(i)) continue;
      A.row(i).setZero();
      A(i, i) = 1;
      right_.row(i) = start.col(i).transpose().cast<long double>();
    }
    lu_.compute(A);
  }

  double operator()(const Eigen::MatrixXd& T) const {
    const Wide m = (T * system_.rest_offset).template cast<long double>();
    Wide right = right_;
    int l = 0;
    for (const Link& link : system_.links()) {
      const long double k = system_.link_stiffness[l];
      if (!system_.is_fixed(link.i)) right.row(link.i) += k * m.col(l).transpose();
      if (!system_.is_fixed(link.j)) right.row(link.j) -= k * m.col(l).transpose();
      ++l;
    }
    const Wide x = lu_.solve(right);
    long double sum = 0;
    for (int i = 0; i < system_.nodes(); ++i) {
      const Wide d = x.row(i) - system_.anchors.col(i).transpose().template cast<long double>();
      sum += system_.anchor_stiffness[i] * d.squaredNorm() / 2;
      if (system_.has_loads())
        sum -= x.row(i).dot(system_.loads.col(i).transpose().template cast<long double>());
    }
    l = 0;
    for (const Link& link : system_.links()) {
      sum += system_.link_stiffness[l] *
             (x.row(link.i) - x.row(link.j) - m.col(l).transpose()).squaredNorm() / 2;
      ++l;
    }
    return static_cast<double>(sum);
  }

 private:
  const System<Dim>& system_;
  Wide right_;
  Eigen::PartialPivLU<Wide> lu_;
};

// The least energy of all T, by a compass search from many rotations.
template <int Dim>
double least_energy(const Reduced<Dim>& energy, bool scales, std::uint64_t seed) {
  Rng rng(seed);
  double least = std::numeric_limits<double>::infinity();
  for (int start = 0; start < 12; ++start) {
    Eigen::MatrixXd T = random_rotation<Dim>(rng);
    double here = energy(T);
    for (double step = 0.5; step > 1e-12;) {
      bool falls = false;
      const auto attempt = [&](const Eigen::MatrixXd& next) {
        if (const double value = energy(next); value < here) here = value, T = next, falls = true;
      };
      for (const double s : {step, -step}) {
        for (int a = 0; a < Dim; ++a) {
          for (int b = a + 1; b < Dim; ++b) attempt(turn<Dim>(a, b, s) * T);
        }
        if (scales) attempt(std::exp(s) * T);
      }
      if (!falls) step /= 2;
    }
    least = std::min(least, here);
  }
  return least;
}

template <int Dim>
void expect_global_minimum(const System<Dim>& system, const typename System<Dim>::Points& start, bool scales,
                           std::uint64_t seed) {
  const double least = least_energy(Reduced<Dim>(system, start), scales, seed);
  const double size = system.anchor_stiffness.sum() * 400;  // shapes are 20 wide
  Turning<Dim> turning;
  turning.options.scale = scales;
  typename System<Dim>::Points x = start;
  const Summary summary = turning.solve(system, x);
  // With links 1e9 times as stiff as the anchors, a double may not resolve the default tolerance.
  EXPECT_TRUE(summary.status == Status::Converged ||
              (summary.status == Status::NoProgress && system.link_stiffness.maxCoeff() > 1e8))
      << summary;
  EXPECT_LE(summary.final_energy, least + 1e-6 * std::abs(least) + 1e-10 * size)
      << summary << " seed " << seed;
  EXPECT_EQ(summary.positive_definite, true);
  EXPECT_LT(summary.stationarity, 1e-6);
}

// Springs without rest length: the global minimum, whatever the start and however stiff the links.
template <int Dim>
void expect_global_minima(double stiffness) {
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    auto [system, start] = random_shape<Dim>(seed, 3 + static_cast<int>(seed % 4), seed % 2 == 0 ? 2 : 20);
    system.link_stiffness *= stiffness;
    if (seed % 3 == 0) start.setZero();
    if (seed % 3 == 1) start = -3 * start;
    if (seed % 4 == 3) {
      Rng rng(seed);
      system.loads = random_points<System<Dim>>(rng, system.nodes(), -0.1, 0.1);
    }
    if (seed % 5 == 0) system.fix(1);
    for (const bool scales : {true, false}) {
      SCOPED_TRACE(stiffness);
      expect_global_minimum<Dim>(system, start, scales, seed);
    }
  }
}

TEST(TurningOffsets, OfPlainSpringsAreGlobalMinima) {
  for (const double stiffness : {1e-3, 1., 1e3, 1e6, 1e9}) {
    expect_global_minima<2>(stiffness);
    expect_global_minima<3>(stiffness);
  }
}

// Two nodes that stiff links hold at their distance, and a start that says nothing of the turn.
TEST(TurningOffsets, OfTwoNodesTurnToTheAnchors) {
  for (const double angle : {0.3, 1.5, 2.23, 3.1, -3.0, -1.0}) {
    for (const double stiffness : {1., 1e4, 1e8}) {
      System<2> system(Topology<>::full(2));
      system.anchors.resize(2, 2);
      system.anchors << 0, -100 * std::cos(angle), 0, -100 * std::sin(angle);
      system.set_rest_offsets(System<2>::Points{{0, -100}, {0, 0}});
      system.anchor_stiffness.setOnes();
      system.link_stiffness.setConstant(stiffness);
      Turning<2> turning;
      turning.options.scale = false;
      turning.options.tolerance = 1e-12;
      System<2>::Points x = System<2>::Points::Zero(2, 2);
      const Summary summary = turning.solve(system, x);
      EXPECT_EQ(summary.status, Status::Converged) << summary;
      EXPECT_LT((turning.transform() - turn<2>(0, 1, angle)).norm(), 1e-9);
      EXPECT_LT((x - system.anchors).norm(), 1e-6) << summary;
    }
  }
}

// One point for all anchors holds no turn, and lengths leave the second derivatives by T unknown.
TEST(TurningOffsets, SayWhatIsStrict) {
  auto [system, start] = random_shape<2>(2, 5, 1);
  Turning<2> turning;
  const auto is_strict = [&, &system = system, &start = start](bool scales) {
    turning.options.scale = scales;
    System<2>::Points x = start;
    const Summary summary = turning.solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    return summary.positive_definite;
  };
  EXPECT_EQ(is_strict(true), true);
  EXPECT_EQ(is_strict(false), true);
  const System<2>::Points anchors = system.anchors;
  system.anchors.setConstant(1e3);
  EXPECT_EQ(is_strict(false), false);
  system.anchors = anchors;
  system.rest_length.setConstant(0.1);
  EXPECT_EQ(is_strict(true), std::nullopt);
  system.rest_length.setZero();
  system.anchor_stiffness.setZero();
  turning.options.hold_floating = true;
  EXPECT_EQ(is_strict(true), false);
  EXPECT_EQ(is_strict(false), false);
}

// A turned, scaled and moved problem has the turned, scaled and moved solution.
TEST(TurningOffsets, TurnWithTheAnchors) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const auto [system, start] = random_shape<3>(seed, 6, 1);
    Rng rng(seed + 100);
    const Eigen::Matrix3d R = random_rotation<3>(rng);
    System<3> other = system;
    other.anchors = 1.7 * R * system.anchors;
    Turning<3> turning;
    System<3>::Points x = start, y = other.anchors;
    EXPECT_EQ(turning.solve(system, x).status, Status::Converged);
    const Eigen::Matrix3d T = turning.transform();
    EXPECT_EQ(turning.solve(other, y).status, Status::Converged);
    EXPECT_LT((y - 1.7 * R * x).cwiseAbs().maxCoeff(), 1e-4) << seed;
    EXPECT_LT((turning.transform() - 1.7 * R * T).norm(), 1e-5) << seed;
  }
}

// A part that was not seen is where the others say.
TEST(TurningOffsets, FindThePartThatWasNotSeen) {
  auto [system, start] = random_shape<2>(3, 6, 0);
  const System<2>::Points truth = system.anchors;
  system.anchor_stiffness[2] = 0;
  system.anchors.col(2).setZero();
  System<2>::Points x = system.anchors;
  Turning<2> turning;
  EXPECT_EQ(turning.solve(system, x).status, Status::Converged);
  EXPECT_LT((x - truth).cwiseAbs().maxCoeff(), 1e-5);
}

TEST(TurningOffsets, RefuseWhatTheyCannotTake) {
  auto [system, start] = random_shape<2>(1, 4, 1);
  Turning<2> turning;
  const auto says = [&, &system = system, &start = start](const char* expected) {
    System<2>::Points x = start;
    const Summary summary = turning.solve(system, x);
    EXPECT_EQ(summary.status, Status::InvalidInput);
    EXPECT_EQ(std::string_view(summary.message), expected);
    EXPECT_EQ(x, start);
  };
  turning.options.gap = 1e-3;
  says("option gap: no lower bound is known for offsets that turn");
  turning.options.gap = 0;
  system.anchors(0, 1) = std::numeric_limits<double>::quiet_NaN();
  says("anchors: position of element 1 is not finite: nan");
  system.anchors = start;
  asterism::System terms = to_system(system);
  Eigen::MatrixXd& anchors = terms.term(0).values("position");
  EXPECT_EQ(std::string_view(solve_turning(terms, anchors, turning.T).message),
            "x shares memory with the system, such as its anchors: pass a copy");
  terms.add_areas(Eigen::Vector3i(0, 1, 2), terms.all(1), terms.all(1));
  Eigen::MatrixXd x = start;
  EXPECT_EQ(std::string_view(solve_turning(terms, x, turning.T).message),
            "areas: only anchors, loads and links can be beside offsets that turn");
  EXPECT_EQ(x, start);
  system.rest_offset.resize(2, 0);
  says("no link has an offset");
}

}  // namespace
}  // namespace asterism
