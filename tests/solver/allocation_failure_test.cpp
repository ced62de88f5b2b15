// Every allocation of a solve fails once: a status or, in what surrounds the solver, std::bad_alloc, and x as
// it was.
#include <gtest/gtest.h>

#include <asterism/solver/json.hpp>
#include <memory>
#include <new>
#include <sstream>
#include <string>

#include "../../bench/laboratory.hpp"
#include "failing_allocator.hpp"

namespace asterism {
namespace {

TEST(AllocationFailure, IsAStatusOfEverySolverAndLeavesXAlone) {
  using Topology = bench::System::TopologyType;
  bench::Rng rng(1);
  const bench::Problem problem = bench::random_system<bench::System>(rng, Topology::full(9));
  for (const bench::SolverEntry& entry : bench::solvers()) {
    SCOPED_TRACE(entry.name);
    std::unique_ptr<bench::Runner> runner;
    bench::Points x = problem.start;
    Summary summary;
    bool thrown = false;
    int out_of_memory = 0;
    const auto renew = [&] {
      runner = entry.make(9);
      runner->load(problem);
      x = problem.start;
      thrown = false;
    };
    renew();
    const long allocations = testing::fail_each_allocation(
        [&] {
          try {
            summary = runner->solve({1e-8, 200}, x);
          } catch (const std::bad_alloc&) {
            thrown = true;
          }
        },
        [&](long k) {
          if (!thrown) {
            // A method may do with less: Auto takes another one then.
            EXPECT_TRUE(summary.status == Status::OutOfMemory || summary.usable()) << k << ": " << summary;
            out_of_memory += summary.status == Status::OutOfMemory;
          }
          if (thrown || summary.status == Status::OutOfMemory) EXPECT_EQ(x, problem.start) << k;
          if (thrown) EXPECT_EQ(k, 0) << "the runner's own copy of x alone";
          renew();
        });
    EXPECT_TRUE(summary.usable()) << summary;
    EXPECT_GT(allocations, 2);
    EXPECT_GT(out_of_memory, 0);
  }
}

TEST(AllocationFailure, NeverMakesSystemsInJsonFewer) {
  const std::string text = [] {
    bench::Rng rng(2);
    std::ostringstream out;
    for (int i = 0; i < 3; ++i) {
      const auto random = bench::random_system<bench::System>(rng, bench::System::TopologyType::full(4));
      write_system(out, random.system, random.start, "a name that is longer than what a string holds itself");
    }
    return out.str();
  }();
  std::size_t count = 0;
  const long allocations = testing::fail_each_allocation(
      [&] {
        count = 0;
        try {
          count = parse_systems(text).size();
        } catch (const std::bad_alloc&) {
          count = 3;
        }
      },
      [&](long k) { EXPECT_EQ(count, 3u) << k; });
  EXPECT_EQ(count, 3u);
  EXPECT_GT(allocations, 50);
}

}  // namespace
}  // namespace asterism
