// Alternating minimisation over subdomains: the partition of the nodes, and the minima it finds.
#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/solver.hpp>
#include <asterism/solver/method/schwarz.hpp>
#include <asterism/solver/method/sparse_newton.hpp>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <ctime>
#include <limits>
#include <new>
#include <random>
#include <string_view>
#include <thread>
#include <vector>

#include "solver_fixture.hpp"
#include "test_systems.hpp"

namespace asterism {
namespace {

using Plane = SpringSystem<double, 2>;
using Space = SpringSystem<double, 3>;
using Planef = SpringSystem<float, 2>;

TEST(Partition, ConnectedSubdomainsOfTheSizeWanted) {
  for (const int size : {1, 20, 100, 5000}) {
    const auto [system, start] = testing::sparse_system<Plane>(1, 2000);
    const detail::Neighbours neighbours(2000, system.links());
    const detail::Partition partition(2000, neighbours, size);
    detail::Indexed<int> sorted = partition.order;
    std::sort(sorted.begin(), sorted.end());
    for (int i = 0; i < 2000; ++i) ASSERT_EQ(sorted[i], i);  // each node once
    EXPECT_EQ(partition.first.back(), 2000);
    EXPECT_LE(partition.count(), 4 * 2000 / size + 1);
    detail::Indexed<int> owner(2000);
    for (int s = 0; s < partition.count(); ++s) {
      EXPECT_LT(partition.first[s], partition.first[s + 1]);
      for (int k = partition.first[s]; k < partition.first[s + 1]; ++k) owner[partition.order[k]] = s;
    }
    for (int s = 0; s < partition.count(); ++s) {
      detail::Indexed<int> reached = {partition.order[partition.first[s]]};
      detail::Indexed<char> seen(2000, false);
      seen[reached[0]] = true;
      for (std::size_t next = 0; next < reached.size(); ++next) {
        for (const auto [node, link] : neighbours.of(reached[next])) {
          if (owner[node] == s && !seen[node]) seen[node] = true, reached.push_back(node);
        }
      }
      EXPECT_EQ(static_cast<int>(reached.size()), partition.first[s + 1] - partition.first[s]);
    }
  }
}

TEST(LargeSystems, AreLeftWhereAskedToStop) {
  const auto problem = testing::sparse_system<Plane>(1, 30000);
  const auto check = [&](auto solver) {
    SCOPED_TRACE(solver.name());
    std::atomic<bool> stop{false};
    solver.options.stop = &stop;
    Plane::Points x = problem.start;
    std::thread timer([&stop] {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      stop = true;
    });
    const Summary summary = solver.solve(problem.system, x);
    timer.join();
    EXPECT_EQ(summary.status, Status::Interrupted) << summary;
    EXPECT_LE(summary.final_energy, summary.initial_energy);
    EXPECT_TRUE(x.allFinite());
  };
  check(Schwarz<Plane>());
  check(Schwarz<Plane, SparseNewton<Plane>>());
  check(NewtonCg<Plane>());
  check(SparseNewton<Plane>());
  check(Lbfgs<Plane, JacobiMetric<Plane>>());
}

TEST(Decomposition, RenumbersAndRestores) {
  detail::Decomposition<Plane> decomposition;
  for (const int n : {8, 50, 700, 300}) {
    auto [system, start] = testing::sparse_system<Plane>(2, n);
    for (const double weakness : {1.0, 0.1}) {
      system.anchor_stiffness *= weakness;
      decomposition.set(system, 40);
      const auto x = decomposition.renumbered(start);
      EXPECT_NEAR(energy(decomposition.system(), x), energy(system, start), 1e-12 * energy(system, start));
      Plane::Points back(2, n);
      decomposition.restore(x, back);
      EXPECT_EQ(back, start);
    }
  }
}

TEST(Decomposition, ASubdomainLowersTheEnergyOfAll) {
  const auto [system, start] = testing::sparse_system<Plane>(3, 500);
  detail::Decomposition<Plane> decomposition;
  decomposition.set(system, 50);
  auto x = decomposition.renumbered(start);
  NewtonCg<Plane> solver;
  detail::Decomposition<Plane>::Scratch scratch;
  scratch.set(system.nodes());
  double last = energy(system, start);
  for (int s = 0; s < decomposition.count(); ++s) {
    const Summary summary = decomposition.solve(s, solver, scratch, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    const double now = energy(decomposition.system(), x);
    EXPECT_NEAR(last - now, summary.initial_energy - summary.final_energy, 1e-9 * last);
    EXPECT_LE(now, last);
    last = now;
  }
}

// All nodes linked to their nearest, some of them to a hub as well, or to the first node alone.
std::vector<testing::RandomSystem<Plane>> systems_to_color() {
  std::vector<testing::RandomSystem<Plane>> systems = {testing::sparse_system<Plane>(4, 2000)};
  std::vector<Link> hub(systems[0].system.links().begin(), systems[0].system.links().end());
  std::vector<Link> star;
  for (int i = 1; i < 2000; ++i) {
    if (i % 3 == 0) hub.push_back({0, i});
    star.push_back({0, i});
  }
  testing::Rng rng(5);
  for (const std::vector<Link>& links : {hub, star})
    systems.push_back(testing::random_system<Plane>(rng, Topology<>::from_links(2000, links)));
  return systems;
}

TEST(Decomposition, SubdomainsOfAColorDoNotDependOnEachOther) {
  for (const auto& [system, start] : systems_to_color()) {
    detail::Decomposition<Plane> decomposition;
    decomposition.set(system, 40);
    detail::Indexed<int> sorted;
    for (int color = 0; color < decomposition.colors(); ++color) {
      const auto subdomains = decomposition.of_color(color);
      EXPECT_FALSE(subdomains.empty());
      sorted.insert(sorted.end(), subdomains.begin(), subdomains.end());
    }
    std::sort(sorted.begin(), sorted.end());
    ASSERT_EQ(static_cast<int>(sorted.size()), decomposition.count());
    for (int s = 0; s < decomposition.count(); ++s) EXPECT_EQ(sorted[s], s);

    NewtonCg<Plane> solver;
    solver.options.tolerance = 1e-2;
    detail::Decomposition<Plane>::Scratch scratch;
    scratch.set(system.nodes());
    Plane::Points forwards = decomposition.renumbered(start);
    Plane::Points backwards = forwards;
    for (int color = 0; color < decomposition.colors(); ++color) {
      const auto subdomains = decomposition.of_color(color);
      for (auto s = subdomains.begin(); s != subdomains.end(); ++s)
        decomposition.solve(*s, solver, scratch, forwards);
      for (auto s = subdomains.rbegin(); s != subdomains.rend(); ++s)
        decomposition.solve(*s, solver, scratch, backwards);
      ASSERT_EQ(forwards, backwards) << "color " << color;
    }
  }
}

TEST(Decomposition, NeighboursInAPlaneHaveFewColors) {
  const auto [system, start] = testing::sparse_system<Plane>(1, 30000);
  detail::Decomposition<Plane> decomposition;
  decomposition.set(system, 300);
  EXPECT_LE(decomposition.colors(), 12);
  EXPECT_GT(decomposition.colors(), 2);
}

TEST(ForEachTask, CallsEachOnceAndPassesAnExceptionOn) {
  for (const int workers : {1, 2, 5}) {
    std::vector<std::atomic<int>> calls(100);
    std::vector<std::atomic<bool>> busy(5);
    detail::for_each_task(workers, 100, [&](int worker, int task) {
      EXPECT_FALSE(busy[static_cast<std::size_t>(worker)].exchange(true));
      ++calls[static_cast<std::size_t>(task)];
      busy[static_cast<std::size_t>(worker)] = false;
    });
    for (const std::atomic<int>& count : calls) EXPECT_EQ(count, 1);
    const auto fails = [&] {
      detail::for_each_task(workers, 100, [](int, int task) {
        if (task >= 50) throw std::bad_alloc();
      });
    };
    EXPECT_THROW(fails(), std::bad_alloc);
  }
}

template <typename System_, template <typename> typename Global>
struct Case {
  using System = System_;
  using Solver = Schwarz<System, Global<System>>;
};
template <typename System>
using JacobiNewtonCg = NewtonCg<System>;
template <typename System>
using LdltNewton = SparseNewton<System>;

using Cases = ::testing::Types<Case<Plane, JacobiNewtonCg>, Case<Plane, LdltNewton>,
                               Case<Space, JacobiNewtonCg>, Case<Planef, JacobiNewtonCg>>;

template <typename C>
class SchwarzTest : public SolverFixture<C> {};
TYPED_TEST_SUITE(SchwarzTest, Cases);

TYPED_TEST(SchwarzTest, FindsNewtonsMinimumFromItsBasin) {
  ASTERISM_USE_FIXTURE;
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    auto [system, start] = testing::sparse_system<System>(seed, 1500);
    EXPECT_TRUE(SparseNewton<System>().solve(system, start).usable());
    const Points minimum = start;
    testing::Rng rng(seed);
    start += testing::random_points<System>(rng, system.nodes(), -0.003, 0.003);
    const Summary summary = Solver().solve(system, start);
    this->expect_converged(summary);
    const double least = double(energy(system, minimum));
    EXPECT_NEAR(summary.final_energy, least, (TestFixture::kDouble ? 1e-9 : 1e-3) * least);
  }
}

TYPED_TEST(SchwarzTest, ConvergesFromFarInFewSteps) {
  ASTERISM_USE_FIXTURE;
  const auto [system, start] = testing::sparse_system<System>(4, 3000);
  Points x = start;
  const Summary summary = Solver().solve(system, x);
  this->expect_converged(summary);
  if (!TestFixture::kDouble) return;
  EXPECT_LT(stationarity(system, x), 1.0001e-8);
  Points all_at_once = start;
  const Summary newton = NewtonCg<System>().solve(system, all_at_once);
  EXPECT_LT(2 * summary.iterations, newton.iterations);
  EXPECT_LT(2 * summary.energy_evaluations, newton.energy_evaluations);
  EXPECT_NEAR(summary.final_energy, newton.final_energy, 0.01 * newton.final_energy);
}

TYPED_TEST(SchwarzTest, EnergyNeverRises) {
  ASTERISM_USE_FIXTURE;
  const auto [system, start] = testing::sparse_system<System>(5, 1200);
  Solver solver;
  double last = std::numeric_limits<double>::max();
  for (int iterations = 0; iterations <= 20; ++iterations) {
    solver.options.max_iterations = iterations;
    Points x = start;
    const Summary summary = solver.solve(system, x);
    EXPECT_LE(summary.iterations, iterations);
    EXPECT_LE(summary.final_energy,
              last + double(detail::rounding_of_energy(system, x, static_cast<Scalar>(last))));
    last = std::min(last, summary.final_energy);
    if (summary.status == Status::Converged) break;
  }
}

TYPED_TEST(SchwarzTest, WeakAnchors) {
  ASTERISM_USE_FIXTURE;
  for (const double ratio : {1e-2, 1e-4, 1e-8}) {
    if (!TestFixture::kDouble && ratio < 1e-3) break;
    auto [system, start] = testing::sparse_system<System>(6, 800);
    system.anchor_stiffness *= static_cast<Scalar>(ratio);
    const Summary summary = Solver().solve(system, start);
    this->expect_converged(summary);
  }
}

TYPED_TEST(SchwarzTest, SameResultsWhenReused) {
  ASTERISM_USE_FIXTURE;
  Solver solver;
  for (const int n : {900, 900, 700}) {
    for (std::uint64_t seed = 1; seed <= 2; ++seed) {
      auto [system, start] = testing::sparse_system<System>(seed, n);
      for (const Scalar change : {Scalar(1), Scalar(0.3)}) {
        system.anchor_stiffness *= change;
        Points x = start;
        Points fresh = start;
        const Summary summary = solver.solve(system, x);
        Solver().solve(system, fresh);
        this->expect_converged(summary);
        EXPECT_EQ(x, fresh);
      }
    }
  }
}

TYPED_TEST(SchwarzTest, AnyNumberOfThreadsGivesTheSameBits) {
  ASTERISM_USE_FIXTURE;
  const auto [system, start] = testing::sparse_system<System>(8, 4000);
  Points alone = start;
  const Summary expected = Solver().solve(system, alone);
  for (const int threads : {2, 3, 0, 64}) {
    Solver solver;
    solver.options.threads = threads;
    Points x = start;
    const Summary summary = solver.solve(system, x);
    EXPECT_EQ(x, alone) << threads << " threads";
    EXPECT_EQ(summary.iterations, expected.iterations);
    EXPECT_EQ(summary.final_energy, expected.final_energy);
  }
}

// A sheet with as many nodes as several chunks, row by row or `shuffled`, some of them fixed.
template <typename System>
testing::RandomSystem<System> sheet(int rows, int columns, bool shuffled = false) {
  using Scalar = typename System::Scalar;
  const int n = rows * columns;
  std::vector<int> number(static_cast<std::size_t>(n));
  for (int i = 0; i < n; ++i) number[static_cast<std::size_t>(i)] = i;
  std::minstd_rand random(3);
  if (shuffled) std::shuffle(number.begin(), number.end(), random);
  typename System::Points grid = System::Points::Zero(System::kDim, n);
  std::vector<Link> links;
  for (int i = 0; i < n; ++i) {
    const auto at = [&](int k) { return number[static_cast<std::size_t>(k)]; };
    grid(0, at(i)) = static_cast<Scalar>(i % columns);
    grid(1, at(i)) = static_cast<Scalar>(i / columns);
    if (i % columns + 1 < columns) links.push_back({at(i + 1), at(i)});
    if (i + columns < n) links.push_back({at(i), at(i + columns)});
    if (i + columns + 1 < n) links.push_back({at(i), at(i + columns + 1)});
  }
  testing::Rng rng(9);
  System system(System::TopologyType::from_links(n, links));
  system.anchors = grid + testing::random_points<System>(rng, n, -0.3, 0.3);
  system.anchor_stiffness.setConstant(Scalar(0.1));
  system.set_rest_lengths(grid);
  system.link_stiffness.setOnes();
  for (int i = 0; i < n; i += 1000) system.fix(i);
  return {system, grid + testing::random_points<System>(rng, n, -0.3, 0.3)};
}

using ChunkTypes =
    ::testing::Types<Plane, Space, Planef,
                     SpringSystem<double, 2, Eigen::Dynamic, Eigen::Dynamic, Model<Hooke, Huber>>>;
template <typename System>
class SpringChunks : public ::testing::Test {};
TYPED_TEST_SUITE(SpringChunks, ChunkTypes);

// Against the sums over all springs in turn.
TYPED_TEST(SpringChunks, SumsAreThoseOfAllSprings) {
  using System = TypeParam;
  using Points = typename System::Points;
  const auto [system, x] = sheet<System>(220, 200);
  detail::SpringChunks<System> chunks;
  chunks.set(system, 2);
  ASSERT_GT(chunks.count(), 4);
  const double epsilon = double(std::numeric_limits<typename System::Scalar>::epsilon());
  Points expected_gradient;
  const double expected = double(energy_and_gradient(system, x, expected_gradient));
  EXPECT_NEAR(double(chunks.energy(system, x)) / expected, 1, 1e4 * epsilon);
  Points gradient;
  EXPECT_NEAR(double(chunks.energy_and_gradient(system, x, gradient)) / expected, 1, 1e4 * epsilon);
  EXPECT_LE(double((gradient - expected_gradient).cwiseAbs().maxCoeff()), 100 * epsilon);
  EXPECT_NEAR(double(chunks.dot(x, gradient)), double(x.cwiseProduct(gradient).sum()),
              1e4 * epsilon * double(x.cwiseProduct(gradient).cwiseAbs().sum()));

  detail::HessianOperator<System> hessian;
  JacobiPreconditioner<System> jacobi;
  jacobi.update(system, x, hessian, chunks);
  detail::HessianOperator<System> plain;
  plain.set(system, x);
  Points product, expected_product;
  hessian.apply(system, x, product, chunks);
  plain.apply(system, x, expected_product);
  EXPECT_LE(double((product - expected_product).cwiseAbs().maxCoeff()), 1e4 * epsilon);

  using Block = Eigen::Matrix<typename System::Scalar, System::kDim, System::kDim>;
  std::vector<Block> blocks(static_cast<std::size_t>(system.nodes()));
  const auto at = [&](int i) -> Block& { return blocks[static_cast<std::size_t>(i)]; };
  detail::for_each_curvature(
      system, x, true, [&](int i, const auto& curvature) { at(i) = curvature; },
      [&](int l, const Link& link, auto force, const auto& spring) {
        force.along = std::max(force.along, typename System::Scalar(1e-3) * system.link_stiffness[l]);
        at(link.i) += detail::link_curvature(force, spring);
        at(link.j) += detail::link_curvature(force, spring);
      });
  Points descent(System::kDim, system.nodes());
  jacobi.descend(gradient, descent, 0, system.nodes());
  for (int i = 0; i < system.nodes(); ++i) {
    const Block block = at(i) + typename System::Scalar(1e-3) * at(i).trace() * Block::Identity();
    ASSERT_LE(double((block * descent.col(i) + gradient.col(i)).cwiseAbs().maxCoeff()), 1e3 * epsilon) << i;
  }
}

TEST(SpringChunksOf, AreOneWhereNodesAreNotInOrder) {
  detail::SpringChunks<Plane> chunks;
  chunks.set(sheet<Plane>(200, 220).system, 3);
  EXPECT_GT(chunks.count(), 1);
  chunks.set(sheet<Plane>(200, 220, true).system, 3);
  EXPECT_EQ(chunks.count(), 1);
  chunks.set(sheet<Plane>(20, 220).system, 3);
  EXPECT_EQ(chunks.count(), 1);
}

TEST(LargeSystems, AnyNumberOfThreadsGivesTheSameBits) {
  auto [system, start] = sheet<Plane>(220, 200);
  system.anchor_stiffness *= 0.1;
  const auto check = [&, &start = start, &system = system](auto solver) {
    SCOPED_TRACE(solver.name());
    solver.options.tolerance = 1e-6;
    Plane::Points expected;
    for (const int threads : {1, 2, 3, 0}) {
      solver.options.threads = threads;
      Plane::Points x = start;
      const Summary summary = solver.solve(system, x);
      EXPECT_EQ(summary.status, Status::Converged) << summary;
      EXPECT_GT(summary.linear_solves, 10);  // of all nodes
      if (threads == 1) {
        expected = x;
      } else {
        EXPECT_EQ(x, expected) << threads << " threads";
      }
    }
  };
  check(NewtonCg<Plane>());
  check(Schwarz<Plane>());
  check(Auto<Plane>());
}

TEST(LargeSystems, AutoRefusesANegativeNumberOfThreads) {
  for (const int n : {4, 20, 2000}) {
    const auto [system, start] = testing::sparse_system<Plane>(1, n);
    Auto<Plane> solver;
    solver.options.threads = -1;
    Plane::Points x = start;
    const Summary summary = solver.solve(system, x);
    EXPECT_EQ(summary.status, Status::InvalidInput);
    EXPECT_EQ(std::string_view(summary.message), "option threads is negative");
    EXPECT_EQ(x, start);
  }
}

// Two separate constellations, nodes without links, fixed nodes, and one node that is linked to all others.
TYPED_TEST(SchwarzTest, AnyTopology) {
  ASTERISM_USE_FIXTURE;
  const auto solved = [&](int n, const std::vector<Link>& links, bool fix) {
    testing::Rng rng(7);
    auto [system, start] = testing::random_system<System>(rng, System::TopologyType::from_links(n, links));
    system.link_stiffness = system.link_stiffness.cwiseMin(Scalar(1e5));
    system.anchor_stiffness.setConstant(Scalar(1e3));
    if (fix) {
      system.fix(0);
      system.fix(n - 1);
    }
    Points x = start;
    this->expect_converged(Solver().solve(system, x));
    if (fix) {
      EXPECT_EQ(x.col(0), start.col(0));
      EXPECT_EQ(x.col(n - 1), start.col(n - 1));
    }
  };
  solved(1, {}, false);
  solved(700, {}, true);
  std::vector<Link> chains;
  for (int i = 1; i < 900; ++i) {
    if (i != 400 && i != 401) chains.push_back({i, i - 1});
  }
  solved(900, chains, false);
  solved(900, chains, true);
  std::vector<Link> star;
  for (int i = 0; i < 800; ++i) {
    if (i != 500) star.push_back({i, 500});
  }
  solved(800, star, false);
  solved(800, star, true);
}

TYPED_TEST(SchwarzTest, BadInputIsRefused) {
  ASTERISM_USE_FIXTURE;
  auto [system, start] = testing::sparse_system<System>(3, 20);
  system.link_stiffness[3] = -1;
  const Points before = start;
  EXPECT_EQ(Solver().solve(system, start).status, Status::InvalidInput);
  system.link_stiffness[3] = 1;
  Solver solver;
  solver.options.threads = -1;
  const Summary summary = solver.solve(system, start);
  EXPECT_EQ(summary.status, Status::InvalidInput);
  EXPECT_EQ(std::string_view(summary.message), "option threads is negative");
  EXPECT_EQ(start, before);
}

TEST(Schwarz, TakesManyNodes) {
  const auto [system, start] = testing::sparse_system<Plane>(1, 100000);
  Schwarz<Plane> solver;
  solver.options.max_iterations = 2;
  auto x = start;
  const Summary summary = solver.solve(system, x);
  EXPECT_EQ(summary.status, Status::MaxIterations) << summary;
  EXPECT_LT(summary.final_energy, 0.1 * summary.initial_energy);
}

// A node that is linked to all others borders on every subdomain, but its neighbours must not be included in
// them: four times the nodes must take about four times as long, not sixteen.
TEST(Schwarz, HubsCostNoMoreThanTheirLinks) {
  const auto seconds = [](int n) {
    std::vector<Link> links;
    for (int i = 1; i < n; ++i) {
      links.push_back({0, i});
      if (i + 1 < n) links.push_back({i, i + 1});
      if (i + 2 < n) links.push_back({i, i + 2});
    }
    Plane system(Topology<>::from_links(n, links));
    for (int i = 0; i < n; ++i) system.anchors.col(i) << i % 317, i / 317;
    system.anchor_stiffness.setConstant(0.1);
    system.link_stiffness.setOnes();
    system.set_rest_lengths(system.anchors);
    system.rest_length *= 0.97;
    Plane::Points x = system.anchors;
    Schwarz<Plane> solver;
    solver.options.tolerance = 1e-6;
    const auto begin = std::clock();
    EXPECT_EQ(solver.solve(system, x).status, Status::Converged);
    return double(std::clock() - begin) / CLOCKS_PER_SEC;
  };
  EXPECT_LT(seconds(60000), 9 * seconds(15000) + 0.1);
}

}  // namespace
}  // namespace asterism
