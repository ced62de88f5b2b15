// Properties of any system, tested on random ones: 1000, or ASTERISM_PROPERTY_SYSTEMS, from number
// ASTERISM_PROPERTY_FIRST on. Energy and forces are implemented independently here, in long double;
// tolerances follow from rounding.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <asterism/solver/batch/batch_newton.hpp>
#include <asterism/solver/batch/spring_batch.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/hessian.hpp>
#include <asterism/solver/method/auto.hpp>
#include <asterism/solver/method/ida.hpp>
#include <asterism/solver/method/lbfgs.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/method/nonlinear_cg.hpp>
#include <asterism/solver/method/sparse_ida.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <initializer_list>
#include <limits>
#include <numeric>
#include <string>
#include <thread>
#include <tuple>
#include <utility>
#include <vector>

#ifdef ASTERISM_TEST_CHOLMOD
#include <asterism/solver/method/cholmod.hpp>
#endif

#include "by_terms.hpp"
#include "environment.hpp"
#include "test_systems.hpp"

namespace asterism {
namespace {

using testing::environment;
using testing::Rng;

constexpr double kEpsilon = std::numeric_limits<double>::epsilon();

// Calls check(index) for the numbers of the systems, or every `stride`-th of them, until one fails.
template <typename Check>
void for_each_index(Check&& check, int stride = 1) {
  const int first = environment("ASTERISM_PROPERTY_FIRST", 0);
  const int count = environment("ASTERISM_PROPERTY_SYSTEMS", 1000);
  for (int index = first; index < first + count && !::testing::Test::HasFailure(); ++index) {
    if (index % stride == 0) check(index);
  }
}

std::string reproduce(int index) {
  return "ASTERISM_PROPERTY_SYSTEMS=1 ASTERISM_PROPERTY_FIRST=" + std::to_string(index);
}

int integer(Rng& rng, int low, int high) {  // in [low, high]
  return std::min(high, low + static_cast<int>(rng.uniform(0, high - low + 1)));
}

// Connected, so that one anchor suffices: full, or a random tree with additional links.
template <typename Topology>
Topology random_topology(Rng& rng, int nodes) {
  if (rng.uniform(0, 1) < 0.3) return Topology::full(nodes);
  std::vector<Link> links;
  for (int i = 1; i < nodes; ++i) links.push_back({integer(rng, 0, i - 1), i});
  const int room = nodes * (nodes - 1) / 2 - (nodes - 1);
  for (int extra = integer(rng, 0, std::min(nodes, room)); extra > 0; --extra) {
    const int i = integer(rng, 0, nodes - 1), j = integer(rng, 0, nodes - 2);
    links.push_back({i, j < i ? j : j + 1});
  }
  return Topology::from_links(nodes, links);
}

bool is_wild(int index) { return index % 3 == 0; }

// Stiffness from 1e-12 to 1e12; for anchors also zero.
template <typename System>
void make_wild(Rng& rng, System& system) {
  const auto wild = [&rng] { return std::pow(10, rng.uniform(-12, 12)); };
  for (double& k : system.link_stiffness) k = wild();
  for (double& k : system.anchor_stiffness) k = rng.uniform(0, 1) < 0.3 ? 0 : wild();
  system.anchor_stiffness[0] = wild();
}

// A system of one of the generator's kinds; one in five has a fixed node, one in five is far from the origin.
template <typename System>
testing::RandomSystem<System> random_problem(Rng& rng, const typename System::TopologyType& topology,
                                             bool wild) {
  const testing::Kind kind = testing::kKinds[static_cast<std::size_t>(integer(rng, 0, 3))];
  auto problem = testing::random_system<System>(rng, topology, kind);
  System& system = problem.system;
  if (wild) make_wild(rng, system);
  if (rng.uniform(0, 1) < 0.2) system.fix(integer(rng, 0, system.nodes() - 1));
  if (rng.uniform(0, 1) < 0.2) {
    system.anchors.array() += 1e6;
    problem.start.array() += 1e6;
  }
  return problem;
}

template <typename System>
testing::RandomSystem<System> random_problem(int index) {
  Rng rng(static_cast<std::uint64_t>(index) + 1);
  const int nodes = System::kNodes == Eigen::Dynamic ? integer(rng, 2, 12) : System::kNodes;
  const auto topology = random_topology<typename System::TopologyType>(rng, nodes);
  return random_problem<System>(rng, topology, is_wild(index));
}

struct Value {
  long double energy = 0;
  std::vector<double> forces;  // norm per node

  double force() const {
    return std::sqrt(std::inner_product(forces.begin(), forces.end(), forces.begin(), 0.0));
  }
};

template <typename System>
Value evaluate(const System& system, const typename System::Points& x) {
  constexpr int kDim = System::kDim;
  std::vector<long double> gradient(static_cast<std::size_t>(kDim * system.nodes()));
  const auto at = [&gradient](int d, int i) -> long double& {
    return gradient[static_cast<std::size_t>(kDim * i + d)];
  };
  Value value;
  for (int i = 0; i < system.nodes(); ++i) {
    for (int d = 0; d < kDim; ++d) {
      const long double difference = static_cast<long double>(x(d, i)) - system.anchors(d, i);
      value.energy += system.anchor_stiffness[i] * difference * difference / 2;
      at(d, i) += system.anchor_stiffness[i] * difference;
    }
  }
  for (int l = 0; const Link& link : system.links()) {
    long double difference[kDim], square = 0;
    for (int d = 0; d < kDim; ++d) {
      difference[d] = static_cast<long double>(x(d, link.i)) - x(d, link.j);
      square += difference[d] * difference[d];
    }
    const long double length = std::sqrt(square), stretch = length - system.rest_length[l];
    value.energy += system.link_stiffness[l] * stretch * stretch / 2;
    for (int d = 0; d < kDim && length > 0; ++d) {
      const long double force = system.link_stiffness[l] * stretch / length * difference[d];
      at(d, link.i) += force;
      at(d, link.j) -= force;
    }
    ++l;
  }
  for (int i = 0; i < system.nodes(); ++i) {
    long double square = 0;
    for (int d = 0; d < kDim && !system.is_fixed(i); ++d) square += at(d, i) * at(d, i);
    value.forces.push_back(static_cast<double>(std::sqrt(square)));
  }
  return value;
}

template <typename System>
double extent(const System& system, const typename System::Points& x) {
  return std::max(x.cwiseAbs().maxCoeff(), system.anchors.cwiseAbs().maxCoeff());
}

// The accuracy of energy and force if coordinates are rounded relative to the largest one.
struct Rounding {
  double energy, force;
};
template <typename System>
Rounding rounding(const System& system, const typename System::Points& x, long double energy) {
  const double step = 8 * kEpsilon * extent(system, x);
  const double stiffness = system.anchor_stiffness.sum() + 2 * system.link_stiffness.sum();
  const auto terms = static_cast<double>(system.nodes() + system.link_count());
  const auto e = static_cast<double>(energy);
  return {terms * kEpsilon * e + step * std::sqrt(2 * stiffness * e) + stiffness * step * step,
          stiffness * step};
}

// How much the energy may rise in a step of IDA, which has no line search: K_dyn^-1 applied to the rounding
// of the forces. No entry of that inverse is negative, so forces of one sign are the worst case.
template <typename System>
double rounding_of_step(const System& system, const typename System::Points& x) {
  using Matrix = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;
  Matrix stiffness = Matrix::Zero(system.nodes(), system.nodes());
  stiffness.diagonal() = system.anchor_stiffness.template cast<long double>();
  for (int l = 0; const Link& link : system.links()) {
    const long double k = system.link_stiffness[l];
    stiffness(link.i, link.i) += k;
    stiffness(link.j, link.j) += k;
    stiffness(link.i, link.j) -= k;
    stiffness(link.j, link.i) -= k;
    ++l;
  }
  Eigen::Matrix<long double, Eigen::Dynamic, 1> force =
      8 * kEpsilon * extent(system, x) * stiffness.diagonal();
  for (int i = 0; i < system.nodes(); ++i) {
    if (!system.is_fixed(i)) continue;
    stiffness.row(i).setZero();
    stiffness.col(i).setZero();
    stiffness(i, i) = 1;
    force[i] = 0;
  }
  return static_cast<double>(System::kDim * force.dot(stiffness.ldlt().solve(force)) / 2);
}

// Judges solves of one system from one start as the solver is given more and more iterations.
template <typename System>
class Judge {
 public:
  Judge(const testing::RandomSystem<System>& problem, bool wild, double tolerance = SolverOptions().tolerance)
      : system_(problem.system),
        start_(problem.start),
        wild_(wild),
        lowest_(evaluate(system_, start_).energy),
        length_(characteristic_length(system_, start_)),
        tolerance_(std::max(tolerance, 8 * kEpsilon * (1 + extent(system_, start_) / length_))),
        stiffness_(node_stiffness(system_)) {}

  // Expects that the energy has not risen, that the summary describes x, and that it reports convergence only
  // if forces are within the tolerance. True if the solver may continue.
  bool goes_on(const Summary& summary, const typename System::Points& x) {
    EXPECT_FALSE(summary.message.empty());
    if (!summary.usable()) {
      EXPECT_EQ(summary.status, Status::NumericalFailure) << summary;
      EXPECT_TRUE(wild_) << summary;
      EXPECT_EQ(x, start_);
      return false;
    }
    EXPECT_TRUE(x.allFinite());
    const Value value = evaluate(system_, x);
    const double known = rounding(system_, x, lowest_).energy;
    double rise = known;
    if (value.energy > lowest_ + known && summary.solver.starts_with("IDA"))
      rise += summary.iterations * rounding_of_step(system_, x);
    EXPECT_LE(value.energy, lowest_ + rise) << summary;
    EXPECT_NEAR(static_cast<double>(value.energy), summary.final_energy, known) << summary;
    lowest_ = std::min(lowest_, value.energy);
    if (summary.status != Status::Converged) return true;
    for (int i = 0; i < system_.nodes(); ++i) {
      EXPECT_LE(value.forces[static_cast<std::size_t>(i)],
                stiffness_[i] * (tolerance_ * length_ + 8 * kEpsilon * extent(system_, x)))
          << "node " << i << ": " << summary;
    }
    return false;
  }

 private:
  const System& system_;
  const typename System::Points& start_;
  bool wild_;
  long double lowest_;
  double length_, tolerance_;
  typename System::NodeVector stiffness_;
};

template <typename System>
using DenseSolvers = std::tuple<Ida<System>, Newton<System>, Lbfgs<System>, testing::NewtonCg<System>,
                                NonlinearCg<System>, Auto<System>>;
template <typename System>
using SparseSolvers = std::tuple<
#ifdef ASTERISM_TEST_CHOLMOD
    CholmodIda<System>, testing::CholmodNewton<System>,
#endif
    SparseIda<System>, testing::SparseNewton<System>, testing::Schwarz<System>,
    testing::DirectSchwarz<System>, testing::NewtonCg<System>, Lbfgs<System>>;

// Calls visit(solve) for each solver, where solve(max_iterations, x) runs it.
template <typename System, typename Solvers, typename Visit>
void for_each_solver(Solvers& solvers, const System& system, const AlignedOptions& options,
                     const Visit& visit) {
  const auto call = [&](auto& solver) {
    SCOPED_TRACE(solver.name());
    solver.options.tolerance = options.tolerance;
    if constexpr (requires { solver.options.align; }) solver.options.align = options.align;
    // Continuation lowers the energy of systems with stronger anchors, while that of the given system may
    // rise.
    if constexpr (requires { solver.options.continuation; }) solver.options.continuation = false;
    // One type for all solvers, so that visit is compiled once.
    visit(std::function<Summary(int, typename System::Points&)>(
        [&](int max_iterations, typename System::Points& x) {
          solver.options.max_iterations = max_iterations;
          return solver.solve(system, x);
        }));
  };
  std::apply([&](auto&... solver) { (call(solver), ...); }, solvers);
}

// Judges each solver after these numbers of iterations, and counts the converged solves.
struct Converged {
  long solves = 0, all = 0;
  template <typename System, typename Solvers>
  void judge(Solvers& solvers, const testing::RandomSystem<System>& problem, bool wild,
             std::initializer_list<int> iterations) {
    for_each_solver<System>(solvers, problem.system, AlignedOptions(), [&](const auto& solve) {
      ++all;
      Judge<System> judge(problem, wild);
      for (const int max_iterations : iterations) {
        SCOPED_TRACE(max_iterations);
        auto x = problem.start;
        const Summary summary = solve(max_iterations, x);
        const bool goes_on = judge.goes_on(summary, x);
        solves += summary.status == Status::Converged;
        if (!goes_on || ::testing::Test::HasFailure()) return;
      }
    });
  }
  ~Converged() { std::printf("%ld of %ld solves converged\n", solves, all); }
};

template <typename T>
class Property : public ::testing::Test {};
using Systems =
    ::testing::Types<SpringSystem<double, 2>, SpringSystem<double, 3>, SpringSystem<double, 2, 4>>;
TYPED_TEST_SUITE(Property, Systems);

TYPED_TEST(Property, EnergyNeverRisesAndTheSummaryIsTrue) {
  using System = TypeParam;
  DenseSolvers<System> solvers;
  Converged converged;
  for_each_index([&](int index) {
    SCOPED_TRACE(reproduce(index));
    converged.judge(solvers, random_problem<System>(index), is_wild(index), {1, 2, 3, 5, 8, 200});
  });
}

using Plane = SpringSystem<double, 2>;

TEST(SparseProperty, EnergyNeverRisesAndTheSummaryIsTrue) {
  SparseSolvers<Plane> solvers;
  Converged converged;
  for_each_index([&](int index) {
    SCOPED_TRACE(reproduce(index));
    converged.judge(solvers, random_problem<Plane>(index), is_wild(index), {1, 3, 200});
  });
}

// Large enough for Schwarz to have subdomains.
TEST(SparseProperty, EnergyNeverRisesInLargeSystems) {
  SparseSolvers<Plane> solvers;
  Converged converged;
  for_each_index(
      [&](int index) {
        SCOPED_TRACE(reproduce(index));
        Rng rng(static_cast<std::uint64_t>(index) + 1);
        auto problem =
            testing::sparse_system<Plane>(static_cast<std::uint64_t>(index), integer(rng, 350, 1500));
        const bool wild = rng.uniform(0, 1) < 0.3;
        if (wild) make_wild(rng, problem.system);
        for (int fixed = integer(rng, 0, 5); fixed > 0; --fixed)
          problem.system.fix(integer(rng, 0, problem.system.nodes() - 1));
        converged.judge(solvers, problem, wild, {1, 2, 10, 200});
      },
      200);
}

TEST(MultiStartProperty, NeverWorseThanItsMethodAndTheSameAgain) {
  AnySolver<Plane> method = system_solver<Plane>("auto");
  testing::MultiStart<Plane> solver;
  solver.options.starts = 5;
  solver.options.max_iterations = method.options().max_iterations = 200;
  for_each_index([&](int index) {
    SCOPED_TRACE(reproduce(index));
    const auto problem = random_problem<Plane>(index);
    auto once = problem.start, again = problem.start, by_method = problem.start;
    const Summary summary = solver.solve(problem.system, once);
    const Summary alone = method.solve(problem.system, by_method);
    Judge<Plane>(problem, is_wild(index)).goes_on(summary, once);
    EXPECT_GE(summary.usable(), alone.usable());
    if (alone.usable()) {
      EXPECT_LE(summary.final_energy, alone.final_energy);
    }
    solver.solve(problem.system, again);
    EXPECT_EQ(once, again);
  });
}

TEST(MultiStartProperty, KeepsTheLowestWhereItIsAskedToStop) {
  Rng rng(5);
  const auto problem = testing::random_system<Plane>(rng, Topology<>::full(6), testing::Kind::Orig);
  testing::MultiStart<Plane> solver;
  std::atomic<bool> stop{true};
  solver.options.stop = &stop;
  solver.options.starts = 1000000000;
  auto x = problem.start;
  EXPECT_EQ(solver.solve(problem.system, x).status, Status::Interrupted);
  stop = false;
  std::thread timer([&stop] {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    stop = true;
  });
  x = problem.start;
  const Summary summary = solver.solve(problem.system, x);
  timer.join();
  EXPECT_EQ(summary.status, Status::Interrupted) << summary;
  auto once = problem.start;
  EXPECT_LE(summary.final_energy, system_solver<Plane>("auto").solve(problem.system, once).final_energy);
  EXPECT_NEAR(energy(problem.system, x), summary.final_energy, 1e-12 * summary.final_energy);
}

TEST(BatchProperty, EnergyNeverRisesAndTheStatusIsTrue) {
  constexpr int kSystems = 32;
  long converged = 0, all = 0;
  for_each_index(
      [&](int index) {
        SCOPED_TRACE(reproduce(index));
        Rng rng(static_cast<std::uint64_t>(index) + 1);
        const auto topology = random_topology<Topology<>>(rng, integer(rng, 2, 12));
        SpringBatch<double, 2> batch(topology, kSystems);
        std::vector<testing::RandomSystem<Plane>> problems;
        for (int s = 0; s < kSystems; ++s) {
          problems.push_back(random_problem<Plane>(rng, topology, is_wild(s)));
          batch.set(s, problems.back().system, problems.back().start);
        }
        BatchNewton(batch).solve(batch);
        for (int s = 0; s < kSystems; ++s) {
          SCOPED_TRACE(s);
          const auto& problem = problems[static_cast<std::size_t>(s)];
          if (problem.system.fixed_count() > 0) {
            EXPECT_EQ(batch.status(s), Status::InvalidInput);
            continue;
          }
          Summary summary;
          summary.solver = "batch";
          summary.status = batch.status(s);
          summary.message = to_string(summary.status);
          summary.final_energy = batch.final_energy(s);
          Judge<Plane>(problem, is_wild(s)).goes_on(summary, batch.points(s));
          converged += summary.status == Status::Converged;
          ++all;
        }
      },
      kSystems);
  std::printf("%ld of %ld systems converged\n", converged, all);
}

// Rotates or reflects, translates, scales, relabels, and changes the unit of stiffness.
template <typename System>
class Change {
 public:
  using Points = typename System::Points;

  Change(Rng& rng, const System& system) : labels_(static_cast<std::size_t>(system.nodes())) {
    turn_.setIdentity();
    for (int reflections = integer(rng, 1, 2); reflections > 0; --reflections) {
      typename System::Point normal;
      for (double& coordinate : normal) coordinate = rng.normal();
      normal.normalize();
      turn_ -= 2 * normal * (normal.transpose() * turn_).eval();
    }
    scale_ = std::pow(10, rng.uniform(-6, 6));
    stiffness_ = std::pow(10, rng.uniform(-6, 6));
    const double size = scale_ * system.anchors.cwiseAbs().maxCoeff();
    for (double& coordinate : shift_) coordinate = rng.uniform(-size, size);
    std::iota(labels_.begin(), labels_.end(), 0);
    for (int i = system.nodes(); i > 1; --i)
      std::swap(labels_[static_cast<std::size_t>(i - 1)],
                labels_[static_cast<std::size_t>(integer(rng, 0, i - 1))]);
  }

  double scale() const { return scale_; }
  double stiffness() const { return stiffness_; }

  Points operator()(const Points& x) const {
    Points result = x;
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

  Eigen::Matrix<double, System::kDim, System::kDim> turn_;
  double scale_, stiffness_;
  typename System::Point shift_;
  std::vector<int> labels_;
};

// A minimum, and a start from which every descent ends there.
template <typename System>
struct Basin {
  typename System::Points minimum, start;
  double curvature = 0;  // a lower bound at the minimum
};

// Whether all eigenvalues are above `least`: then the pivots of Cholesky are positive.
bool has_curvature(Eigen::MatrixXd matrix, double least) {
  const Eigen::Index n = matrix.rows();
  for (Eigen::Index k = 0; k < n; ++k) matrix(k, k) -= least;
  for (Eigen::Index k = 0; k < n; ++k) {
    if (!(matrix(k, k) > 0)) return false;
    for (Eigen::Index i = k + 1; i < n; ++i) {
      const double factor = matrix(i, k) / matrix(k, k);
      for (Eigen::Index j = k + 1; j < n; ++j) matrix(i, j) -= factor * matrix(k, j);
    }
  }
  return true;
}

// Within a radius the curvature stays above half of that at the minimum, as a spring's curvature changes by
// about k mu / r^2 per pixel, and the start's energy is too low to leave it. False if there is no such
// minimum, or the radius is not well above rounding.
template <typename System>
bool find_basin(Rng& rng, const testing::RandomSystem<System>& problem, Basin<System>& basin) {
  const System& system = problem.system;
  basin.minimum = problem.start;
  Newton<System> newton;
  newton.options.tolerance = 1e-13;
  if (!newton.solve(system, basin.minimum).usable()) return false;
  const double stiffness = node_stiffness(system).maxCoeff();
  const Eigen::MatrixXd at_minimum = hessian(system, basin.minimum);
  for (basin.curvature = stiffness; !has_curvature(at_minimum, basin.curvature); basin.curvature /= 2) {
    if (!(basin.curvature > 1e-6 * stiffness)) return false;
  }
  double change = 0;  // of the curvature per pixel
  for (int l = 0; const Link& link : system.links()) {
    const double square = (basin.minimum.col(link.i) - basin.minimum.col(link.j)).squaredNorm();
    change += 4 * system.link_stiffness[l] * system.rest_length[l] / square;
    ++l;
  }
  const double radius =
      std::min(0.1 * basin.curvature / change, 0.1 * characteristic_length(system, basin.minimum));
  const double step = 0.5 * radius * std::sqrt(basin.curvature / (stiffness * System::kDim * system.nodes()));
  if (!(step > 1e4 * kEpsilon * extent(system, basin.minimum))) return false;
  basin.start = basin.minimum + testing::random_points<System>(rng, system.nodes(), -step, step);
  for (int i = 0; i < system.nodes(); ++i) {
    if (system.is_fixed(i)) basin.start.col(i) = basin.minimum.col(i);
  }
  return true;
}

TYPED_TEST(Property, SolutionsMoveWithTheSystem) {
  using System = TypeParam;
  DenseSolvers<System> solvers;
  AlignedOptions options;
  options.tolerance = 1e-10;
  options.align = false;  // alignment may leave the basin
  int tried = 0, all = 0;
  for_each_index([&](int index) {
    SCOPED_TRACE(reproduce(index));
    ++all;
    const auto problem = random_problem<System>(index);
    Rng rng(static_cast<std::uint64_t>(index) + 77);
    Basin<System> basin;
    if (!find_basin(rng, problem, basin)) return;
    ++tried;
    const Change<System> change(rng, problem.system);
    const System changed = change(problem.system);
    const auto expected = change(basin.minimum);
    const double unit = change.scale() * change.stiffness();  // unit of the forces
    // Remaining forces at either end, including those from the rounding of the changed numbers.
    const double force = unit * (evaluate(problem.system, basin.minimum).force() +
                                 rounding(problem.system, basin.minimum, 0).force) +
                         rounding(changed, expected, 0).force;
    for_each_solver<System>(solvers, changed, options, [&](const auto& solve) {
      auto x = change(basin.start);
      const Summary summary = solve(500, x);
      ASSERT_TRUE(summary.usable()) << summary;
      EXPECT_LE((x - expected).norm(),
                2 * (evaluate(changed, x).force() + force) / (change.stiffness() * basin.curvature) +
                    8 * kEpsilon * expected.norm())
          << summary;
    });
  });
  EXPECT_GE(8 * tried, all == 1 ? 0 : all);
  std::printf("%d of %d systems\n", tried, all);
}

template <typename Solver, typename Float, typename System>
void expect_agreement(const System& system, const Basin<System>& basin, int& tried) {
  Float in_float(Float::TopologyType::from_links(system.nodes(), system.links()));
  in_float.anchors = system.anchors.template cast<float>();
  in_float.anchor_stiffness = system.anchor_stiffness.template cast<float>();
  in_float.rest_length = system.rest_length.template cast<float>();
  in_float.link_stiffness = system.link_stiffness.template cast<float>();
  for (int i = 0; i < system.nodes(); ++i) {
    if (system.is_fixed(i)) in_float.fix(i);
  }
  // Forces caused by rounding to float; if these leave the basin, there is nothing to compare.
  const double stiffness = system.anchor_stiffness.sum() + 2 * system.link_stiffness.sum();
  const double rounded = 8 * static_cast<double>(std::numeric_limits<float>::epsilon()) * stiffness *
                         (extent(system, basin.minimum) + system.rest_length.maxCoeff());
  if (!(rounded / basin.curvature < 0.5 * (basin.start - basin.minimum).norm())) return;
  ++tried;
  Solver solver;
  solver.options.align = false;
  typename Float::Points x = basin.start.template cast<float>();
  const Summary summary = solver.solve(in_float, x);
  ASSERT_TRUE(summary.usable()) << summary;
  const typename System::Points in_double = x.template cast<double>();
  const double force = evaluate(system, in_double).force();
  EXPECT_LE(force, summary.gradient_norm + rounded) << summary;
  EXPECT_LE((in_double - basin.minimum).norm(), 2 * (force + rounded) / basin.curvature) << summary;
}

TEST(FloatAndDouble, Agree) {
  using System = SpringSystem<double, 2>;
  using Float = SpringSystem<float, 2>;
  int tried = 0;
  for_each_index([&](int index) {
    SCOPED_TRACE(reproduce(index));
    const auto problem = random_problem<System>(index);
    Rng rng(static_cast<std::uint64_t>(index) + 99);
    Basin<System> basin;
    if (!find_basin(rng, problem, basin)) return;
    expect_agreement<Ida<Float>, Float>(problem.system, basin, tried);
    expect_agreement<Newton<Float>, Float>(problem.system, basin, tried);
  });
  std::printf("%d solves\n", tried);
}

}  // namespace
}  // namespace asterism
