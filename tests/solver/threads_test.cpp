// Large systems on several threads: the same bits for any number of them, sums over chunks of springs, and
// where a solve is asked to stop.
#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/solver.hpp>
#include <atomic>
#include <chrono>
#include <cmath>
#include <limits>
#include <new>
#include <random>
#include <string_view>
#include <thread>
#include <vector>

#include "by_terms.hpp"
#include "test_systems.hpp"

namespace asterism {
namespace {

using Plane = SpringSystem<double, 2>;
using Space = SpringSystem<double, 3>;
using Planef = SpringSystem<float, 2>;

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
  check(NewtonCg<Plane>());
  check(testing::SparseNewton<Plane>());
  check(Lbfgs<Plane, JacobiMetric<Plane>>());
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

}  // namespace
}  // namespace asterism
