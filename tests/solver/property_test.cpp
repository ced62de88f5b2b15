// What holds for any system, on random ones: a few thousand, or as many as ASTERISM_PROPERTY_SYSTEMS says.
// The yardsticks are written down here once more, in long double, and tolerances follow from the systems'
// conditioning.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <asterism/solver/ida.hpp>
#include <asterism/solver/newton.hpp>
#include <asterism/solver/stationarity.hpp>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <map>
#include <memory>
#include <numeric>
#include <string>
#include <vector>

#include "../../bench/laboratory.hpp"

namespace asterism {
namespace {

using bench::Points;
using bench::Problem;
using bench::Rng;
using bench::System;
using LongPoints = Eigen::Matrix<long double, 2, Eigen::Dynamic>;

constexpr double kEpsilon = std::numeric_limits<double>::epsilon();

int system_count() {
  const char* count = std::getenv("ASTERISM_PROPERTY_SYSTEMS");
  return count == nullptr ? 2000 : std::atoi(count);
}

int integer(Rng& rng, int low, int high) {  // in [low, high]
  return std::min(high, low + static_cast<int>(rng.uniform(0, high - low + 1)));
}

// Connected, so that one anchor suffices: full, or a random tree with further links.
System::TopologyType random_topology(Rng& rng, int nodes) {
  if (rng.uniform(0, 1) < 0.3) return System::TopologyType::full(nodes);
  std::vector<Link> links;
  for (int i = 1; i < nodes; ++i) links.push_back({integer(rng, 0, i - 1), i});
  for (int extra = integer(rng, 0, nodes); extra > 0 && nodes > 1; --extra) {
    const int i = integer(rng, 0, nodes - 1), j = integer(rng, 0, nodes - 2);
    links.push_back({i, j < i ? j : j + 1});
  }
  return System::TopologyType::from_links(nodes, links);
}

// The generator's kinds and, of one in three, stiffnesses from 1e-12 to 1e12 in one system.
Problem random_problem(int index) {
  Rng rng(static_cast<std::uint64_t>(index) + 1);
  const int nodes = integer(rng, 2, 12);
  const auto topology = random_topology(rng, nodes);
  const bench::Kind kind = bench::kKinds[static_cast<std::size_t>(integer(rng, 0, 3))];
  Problem problem = bench::random_system<System>(rng, topology, kind);
  System& system = problem.system;
  if (index % 3 == 0) {
    const auto wild = [&rng] { return std::pow(10, rng.uniform(-12, 12)); };
    for (double& k : system.link_stiffness) k = wild();
    for (double& k : system.anchor_stiffness) k = rng.uniform(0, 1) < 0.3 ? 0 : wild();
    system.anchor_stiffness[0] = wild();
  }
  if (rng.uniform(0, 1) < 0.2) system.fix(integer(rng, 0, nodes - 1));
  if (rng.uniform(0, 1) < 0.2) {
    system.anchors.array() += 1e6;
    problem.start.array() += 1e6;
  }
  return problem;
}

struct Value {
  long double energy = 0;
  LongPoints gradient;
};

Value evaluate(const System& system, const Points& at) {
  const LongPoints x = at.cast<long double>(), difference = x - system.anchors.cast<long double>();
  Value value;
  value.gradient.resize(2, system.nodes());
  for (int i = 0; i < system.nodes(); ++i) {
    value.energy += system.anchor_stiffness[i] * difference.col(i).squaredNorm() / 2;
    value.gradient.col(i) = system.anchor_stiffness[i] * difference.col(i);
  }
  for (int l = 0; l < system.link_count(); ++l) {
    const Link link = system.links()[static_cast<std::size_t>(l)];
    const Eigen::Matrix<long double, 2, 1> d = x.col(link.i) - x.col(link.j);
    const long double length = d.norm(), stretch = length - system.rest_length[l];
    value.energy += system.link_stiffness[l] * stretch * stretch / 2;
    if (length > 0) {
      value.gradient.col(link.i) += system.link_stiffness[l] * stretch / length * d;
      value.gradient.col(link.j) -= system.link_stiffness[l] * stretch / length * d;
    }
  }
  for (int i = 0; i < system.nodes(); ++i)
    if (system.is_fixed(i)) value.gradient.col(i).setZero();
  return value;
}

// Eigenvalues of the Hessian of the nodes that are free: the smallest is what holds the solution.
double smallest_curvature(const System& system, const Points& x) {
  Eigen::MatrixXd hessian = Eigen::MatrixXd::Zero(2 * system.nodes(), 2 * system.nodes());
  for (int i = 0; i < system.nodes(); ++i)
    hessian.block<2, 2>(2 * i, 2 * i).diagonal().setConstant(system.anchor_stiffness[i]);
  for (int l = 0; l < system.link_count(); ++l) {
    const Link link = system.links()[static_cast<std::size_t>(l)];
    const Eigen::Vector2d d = x.col(link.i) - x.col(link.j);
    const double ratio = system.rest_length[l] / d.norm();
    const Eigen::Matrix2d block =
        system.link_stiffness[l] *
        ((1 - ratio) * Eigen::Matrix2d::Identity() + ratio * d.normalized() * d.normalized().transpose());
    const int i = 2 * link.i, j = 2 * link.j;
    hessian.block<2, 2>(i, i) += block;
    hessian.block<2, 2>(j, j) += block;
    hessian.block<2, 2>(i, j) -= block;
    hessian.block<2, 2>(j, i) -= block;
  }
  std::vector<int> free;
  for (int i = 0; i < 2 * system.nodes(); ++i)
    if (!system.is_fixed(i / 2)) free.push_back(i);
  if (free.empty()) return std::numeric_limits<double>::infinity();
  const Eigen::MatrixXd reduced = hessian(free, free);
  return reduced.allFinite() ? Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(reduced, Eigen::EigenvaluesOnly)
                                   .eigenvalues()[0]
                             : -1;
}

double extent(const System& system, const Points& x) {
  return std::max(x.cwiseAbs().maxCoeff(), system.anchors.cwiseAbs().maxCoeff());
}

// What energy and gradient are known to where coordinates are rounded at their own magnitude.
struct Rounding {
  long double energy;
  double force;
};
Rounding rounding(const System& system, const Points& x, long double energy) {
  const double step = 8 * kEpsilon * extent(system, x);
  const double stiffness = system.anchor_stiffness.sum() + 2 * system.link_stiffness.sum();
  const auto terms = static_cast<long double>(system.nodes() + system.link_count());
  return {terms * kEpsilon * energy + step * std::sqrt(2 * stiffness * energy) + stiffness * step * step,
          stiffness * step};
}

/// The library's methods that reach a system of this size, with a workspace each.
class Methods {
 public:
  template <typename Visit>
  void for_each(const Problem& problem, Visit&& visit) {
    for (const bench::SolverEntry& entry : bench::solvers()) {
      const int nodes = problem.system.nodes();
      auto& runner = runners_[{entry.name, nodes == 4}];
      if (!runner) runner = entry.make(nodes);
      runner->load(problem);
      visit(entry, *runner);
    }
  }

 private:
  std::map<std::pair<std::string, bool>, std::unique_ptr<bench::Runner>> runners_;
};

TEST(Property, EnergyNeverRisesAndTheSummaryIsTrue) {
  Methods methods;
  long converged = 0, all = 0;
  for (int index = 0; index < system_count(); ++index) {
    const Problem problem = random_problem(index);
    const System& system = problem.system;
    const long double start = evaluate(system, problem.start).energy;
    const double length = characteristic_length(system, problem.start);
    const auto stiffness = node_stiffness(system);
    methods.for_each(problem, [&](const bench::SolverEntry& entry, bench::Runner& runner) {
      SCOPED_TRACE(entry.name + ", system " + std::to_string(index));
      long double before = start;
      for (const int iterations : {1, 2, 3, 5, 8, 300}) {
        Points x;
        const Summary summary = runner.solve({1e-8, iterations}, x);
        ASSERT_FALSE(summary.message.empty());
        if (!summary.usable()) {
          EXPECT_EQ(summary.status, Status::NumericalFailure) << summary;
          EXPECT_EQ(x, problem.start);
          break;
        }
        ASSERT_TRUE(x.allFinite());
        const Value value = evaluate(system, x);
        const Rounding known = rounding(system, x, before);
        EXPECT_LE(value.energy, before + known.energy) << "after " << iterations << " iterations";
        EXPECT_NEAR(double(value.energy), summary.final_energy, double(known.energy)) << summary;
        before = std::min(before, value.energy);
        if (iterations == 300) {
          ++all;
          converged += summary.status == Status::Converged;
        }
        if (summary.status != Status::Converged) continue;
        const double tolerance = std::max(1e-8, 8 * kEpsilon * (1 + extent(system, problem.start) / length));
        for (int i = 0; i < system.nodes(); ++i) {
          EXPECT_LE(double(value.gradient.col(i).norm()),
                    tolerance * stiffness[i] * length + 8 * kEpsilon * stiffness[i] * extent(system, x))
              << "node " << i << ": " << summary;
        }
        break;
      }
    });
    if (::testing::Test::HasFailure()) return;  // one system tells enough
  }
  std::printf("%ld of %ld solves converged within 300 iterations\n", converged, all);
}

// Turns, moves, scales, relabels, and changes the unit of stiffness.
class Change {
 public:
  Change(Rng& rng, const Problem& problem) : labels_(static_cast<std::size_t>(problem.system.nodes())) {
    const double angle = rng.uniform(-3, 3);
    turn_ << std::cos(angle), -std::sin(angle), std::sin(angle), std::cos(angle);
    if (rng.uniform(0, 1) < 0.5) turn_.col(0) *= -1;  // and mirrors
    scale_ = std::pow(10, rng.uniform(-6, 6));
    stiffness_ = std::pow(10, rng.uniform(-6, 6));
    const double size = scale_ * problem.system.anchors.cwiseAbs().maxCoeff();
    shift_ = {rng.uniform(-size, size), rng.uniform(-size, size)};
    std::iota(labels_.begin(), labels_.end(), 0);
    for (std::size_t i = labels_.size(); i > 1; --i)
      std::swap(labels_[i - 1], labels_[static_cast<std::size_t>(integer(rng, 0, static_cast<int>(i) - 1))]);
  }

  double scale() const { return scale_; }
  double stiffness() const { return stiffness_; }

  Points operator()(const Points& x) const {
    Points result(2, x.cols());
    for (int i = 0; i < x.cols(); ++i) result.col(label(i)) = scale_ * (turn_ * x.col(i)) + shift_;
    return result;
  }
  System operator()(const System& system) const {
    std::vector<Link> links;
    for (const Link& link : system.links()) links.push_back({label(link.i), label(link.j)});
    System result(System::TopologyType::from_links(system.nodes(), links));
    result.anchors = (*this)(system.anchors);
    result.rest_length = scale_ * system.rest_length;
    result.link_stiffness = stiffness_ * system.link_stiffness;
    for (int i = 0; i < system.nodes(); ++i) {
      result.anchor_stiffness[label(i)] = stiffness_ * system.anchor_stiffness[i];
      if (system.is_fixed(i)) result.fix(label(i));
    }
    return result;
  }

 private:
  int label(int i) const { return labels_[static_cast<std::size_t>(i)]; }

  Eigen::Matrix2d turn_;
  double scale_, stiffness_;
  Eigen::Vector2d shift_;
  std::vector<int> labels_;
};

// A minimum, and a start from which each way downhill ends there: within the radius in which the curvature
// stays above half of what it is at the minimum (a spring's changes by some k / mu a pixel).
struct Basin {
  Points minimum, start;
  double curvature = 0;
};

bool find_basin(Rng& rng, const Problem& problem, Basin& basin) {
  const System& system = problem.system;
  basin.minimum = problem.start;
  Newton<System> newton;
  newton.options.tolerance = 1e-13;
  if (!newton.solve(system, basin.minimum).usable()) return false;
  basin.curvature = smallest_curvature(system, basin.minimum);
  const double stiffness = node_stiffness(system).maxCoeff();
  if (!(basin.curvature > 1e-6 * stiffness)) return false;
  double change = 0;  // of the curvature, a pixel
  for (int l = 0; l < system.link_count(); ++l) {
    const Link link = system.links()[static_cast<std::size_t>(l)];
    const double length = (basin.minimum.col(link.i) - basin.minimum.col(link.j)).norm();
    change += 4 * system.link_stiffness[l] * system.rest_length[l] / (length * length);
  }
  const double radius = 0.1 * basin.curvature / std::max(change, 1e-300);
  const double step = std::min(radius, 0.1 * characteristic_length(system, basin.minimum)) *
                      std::sqrt(basin.curvature / (stiffness * 2 * system.nodes()));
  if (!(step > 1e4 * kEpsilon * extent(system, basin.minimum))) return false;
  basin.start = basin.minimum + bench::random_points<System>(rng, system.nodes(), -step, step);
  for (int i = 0; i < system.nodes(); ++i)
    if (system.is_fixed(i)) basin.start.col(i) = basin.minimum.col(i);
  return true;
}

// How far apart two points are whose gradients have these norms, near a minimum of that curvature.
double apart(double a, double b, double rounding_of_force, double curvature) {
  return 2 * (a + b + rounding_of_force) / curvature;
}

TEST(Property, SolutionsMoveWithTheSystem) {
  Methods methods;
  int tried = 0;
  for (int index = 0; index < system_count(); ++index) {
    Problem problem = random_problem(index);
    Rng rng(static_cast<std::uint64_t>(index) + 77);
    Basin basin;
    if (!find_basin(rng, problem, basin)) continue;
    ++tried;
    const Change change(rng, problem);
    const Problem changed{change(problem.system), change(basin.start)};
    const Points expected = change(basin.minimum);
    const double force = double(evaluate(problem.system, basin.minimum).gradient.norm());
    const double unit = change.scale() * change.stiffness();  // of forces
    // Numbers are rounded on their way there, too.
    const double rounded =
        rounding(changed.system, expected, 0).force + unit * rounding(problem.system, basin.minimum, 0).force;
    methods.for_each(changed, [&](const bench::SolverEntry& entry, bench::Runner& runner) {
      SCOPED_TRACE(entry.name + ", system " + std::to_string(index));
      Points x;
      const Summary summary = runner.solve({1e-10, 20000}, x);
      ASSERT_TRUE(summary.usable()) << summary;
      const double left = double(evaluate(changed.system, x).gradient.norm());
      EXPECT_LE((x - expected).norm(),
                apart(left, unit * force, rounded, change.stiffness() * basin.curvature) +
                    8 * kEpsilon * expected.norm())
          << summary;
    });
    if (::testing::Test::HasFailure()) return;
  }
  EXPECT_GT(tried, system_count() / 4);
  std::printf("%d systems\n", tried);
}

template <typename Solver, typename Float>
void expect_agreement(const System& system, const Basin& basin, int index, int& tried) {
  Float in_float(Float::TopologyType::from_links(system.nodes(), system.links()));
  in_float.anchors = system.anchors.template cast<float>();
  in_float.anchor_stiffness = system.anchor_stiffness.template cast<float>();
  in_float.rest_length = system.rest_length.template cast<float>();
  in_float.link_stiffness = system.link_stiffness.template cast<float>();
  for (int i = 0; i < system.nodes(); ++i)
    if (system.is_fixed(i)) in_float.fix(i);
  // What rounding to float does to forces; where that leaves the basin, there is nothing to compare.
  const double stiffness = system.anchor_stiffness.sum() + 2 * system.link_stiffness.sum();
  const double rounded = 8 * double(std::numeric_limits<float>::epsilon()) * stiffness *
                         (extent(system, basin.minimum) + system.rest_length.maxCoeff());
  if (!(rounded / basin.curvature < 0.5 * (basin.start - basin.minimum).norm())) return;
  ++tried;
  typename Float::Points x = basin.start.template cast<float>();
  const Summary summary = Solver().solve(in_float, x);
  ASSERT_TRUE(summary.usable()) << summary;
  const Points in_double = x.template cast<double>();
  const double left = double(evaluate(system, in_double).gradient.norm());
  // The method's own verdict, and how well it could know.
  EXPECT_LE(left, summary.gradient_norm + rounded) << summary << ", system " << index;
  EXPECT_LE((in_double - basin.minimum).norm(), apart(left, 0, rounded, basin.curvature))
      << summary << ", system " << index;
}

TEST(Property, FloatAndDoubleAgree) {
  using Float = SpringSystem<float, 2>;
  int tried = 0;
  for (int index = 0; index < system_count(); ++index) {
    const Problem problem = random_problem(index);
    Rng rng(static_cast<std::uint64_t>(index) + 99);
    Basin basin;
    if (!find_basin(rng, problem, basin)) continue;
    expect_agreement<Ida<Float>, Float>(problem.system, basin, index, tried);
    expect_agreement<Newton<Float>, Float>(problem.system, basin, index, tried);
    if (::testing::Test::HasFailure()) return;
  }
  EXPECT_GT(tried, system_count() / 10);
  std::printf("%d solves\n", tried);
}

}  // namespace
}  // namespace asterism
