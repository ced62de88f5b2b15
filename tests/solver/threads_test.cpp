// Large systems on several threads: the same bits for any number of them, and where a solve is asked to stop.
#include <gtest/gtest.h>

#include <asterism/solver.hpp>
#include <atomic>
#include <chrono>
#include <new>
#include <string_view>
#include <thread>
#include <vector>

#include "by_terms.hpp"
#include "test_systems.hpp"

namespace asterism {
namespace {

using Plane = SpringSystem<double, 2>;

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
  check(testing::NewtonCg<Plane>());
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

// A sheet of nodes, row by row, some of them fixed.
testing::RandomSystem<Plane> sheet(int rows, int columns) {
  const int n = rows * columns;
  Plane::Points grid = Plane::Points::Zero(2, n);
  std::vector<Link> links;
  for (int i = 0; i < n; ++i) {
    grid.col(i) << i % columns, i / columns;
    if (i % columns + 1 < columns) links.push_back({i + 1, i});
    if (i + columns < n) links.push_back({i, i + columns});
    if (i + columns + 1 < n) links.push_back({i, i + columns + 1});
  }
  testing::Rng rng(9);
  Plane system(Plane::TopologyType::from_links(n, links));
  system.anchors = grid + testing::random_points<Plane>(rng, n, -0.3, 0.3);
  system.anchor_stiffness.setConstant(0.01);
  system.set_rest_lengths(grid);
  system.link_stiffness.setOnes();
  for (int i = 0; i < n; i += 1000) system.fix(i);
  return {system, grid + testing::random_points<Plane>(rng, n, -0.3, 0.3)};
}

TEST(LargeSystems, AnyNumberOfThreadsGivesTheSameBits) {
  const auto [system, start] = sheet(220, 200);
  Auto<Plane> solver;
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
