// Large systems of nodes that are linked to their six nearest, and a floppy cloth.
#include <sys/resource.h>

#include <algorithm>
#include <asterism/solver/terms/from_springs.hpp>
#include <asterism/testing/random_system.hpp>
#include <asterism/testing/sparse_system.hpp>
#include <chrono>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "bars.hpp"
#include "measure.hpp"
#include "to_gap.hpp"

#ifdef ASTERISM_BENCH_CHOLMOD
#include <asterism/solver/method/cholmod.hpp>
#endif

namespace asterism::bench {

namespace {

// The peak memory of this process so far.
double peak_bytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return 1024.0 * static_cast<double>(usage.ru_maxrss);
}

// A sheet of side x side nodes in space, linked to their four neighbours at distance 1, without resistance to
// bending. Anchors have `share` of the links' stiffness; they lie on the sheet scaled by `extent`, displaced
// by up to 0.3 on each axis.
testing::RandomSystem<SpringSystem<double, 3>> cloth(std::uint64_t seed, int side, double share,
                                                     double extent) {
  using Space = SpringSystem<double, 3>;
  std::vector<Link> links;
  Space::Points grid = Space::Points::Zero(3, side * side);
  for (int i = 0; i < side * side; ++i) {
    grid(0, i) = i % side;
    grid(1, i) = i / side;
    if (i % side > 0) links.push_back({i - 1, i});
    if (i >= side) links.push_back({i - side, i});
  }
  testing::Rng rng(seed);
  Space system(Topology<>::from_links(side * side, links));
  system.anchors = extent * grid + testing::random_points<Space>(rng, side * side, -0.3, 0.3);
  system.anchor_stiffness.setConstant(share);
  system.rest_length.setOnes();
  system.link_stiffness.setOnes();
  return {system, grid + testing::random_points<Space>(rng, side * side, -0.3, 0.3)};
}

// The longest CPU time that Newton of terms takes for a cloth, flat or crumpled, on weak or very weak
// anchors; infinity if it does not reach the default tolerance for one.
double cloth_seconds() {
  double slowest = 0;
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    for (const double share : {1e-4, 1e-8}) {
      for (const double extent : {0.8, 1.0, 1.2}) {
        auto [system, x] = cloth(seed, 60, share, extent);
        AnySolver<SpringSystem<double, 3>> solver = system_solver<SpringSystem<double, 3>>("newton");
        const double before = cpu_seconds();
        const Summary summary = solver.solve(system, x);
        if (summary.status != Status::Converged) return std::numeric_limits<double>::infinity();
        slowest = std::max(slowest, cpu_seconds() - before);
      }
    }
  }
  return slowest;
}

#ifdef ASTERISM_BENCH_CHOLMOD
// CPU seconds of Newton of terms with the library's factors and with CHOLMOD's, for nodes in space that are
// linked to their six nearest, on weak anchors: medians.
std::pair<double, double> seconds_by_factor() {
  using Space = SpringSystem<double, 3>;
  std::vector<double> seconds[2];
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    auto [system, start] = testing::sparse_system<Space>(seed, 4000);
    system.anchor_stiffness *= 0.01;
    AnySolver<Space> own = system_solver<Space>("newton");
    AnySolver<Space> cholmod(newton_by_cholmod(), detail::FromSprings<Space>());
    for (AnySolver<Space>* const solver : {&own, &cholmod}) {
      Space::Points x = start;
      const double before = cpu_seconds();
      solver->solve(system, x);
      seconds[solver == &own ? 0 : 1].push_back(cpu_seconds() - before);
    }
  }
  return {median(seconds[0]), median(seconds[1])};
}
#endif

// Seconds on the clock to stationarity 1e-6 by so many threads; infinity if that is not reached.
double seconds_of_threads(const Problem& problem, int threads) {
  AnySolver<System> solver = system_solver<System>("schwarz", {{"tolerance", 1e-6}, {"threads", threads}});
  System::Points x = problem.start;
  const auto begin = std::chrono::steady_clock::now();
  const Summary summary = solver.solve(problem.system, x);
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
  return summary.status == Status::Converged ? took.count() : std::numeric_limits<double>::infinity();
}

// The median of alternate solves on one thread and on two.
std::pair<double, double> seconds_by_threads(const Problem& problem) {
  std::vector<double> seconds[2];
  for (int repetition = 0; repetition < 3; ++repetition) {
    for (const int threads : {1, 2}) seconds[threads - 1].push_back(seconds_of_threads(problem, threads));
  }
  for (std::vector<double>& of : seconds) std::sort(of.begin(), of.end());
  return {seconds[0][1], seconds[1][1]};
}

void ten_million_nodes(Bars& bars) {
  const Problem problem = testing::sparse_system<System>(1, 10000000);
  const std::string name = "N=1e7, 6 nearest, ";
  bars.at_most(name + "Schwarz, two threads", "%.3g s", seconds_of_threads(problem, 2), 60, 30);
  bars.at_most(name + "peak memory, a link", "%.0f bytes", peak_bytes() / problem.system.link_count(), 260,
               130);
}

}  // namespace

void sparse_bars(Bars& bars) {
  if (!bars.wanted("sparse")) return;
  struct Size {
    int nodes;
    const char* name;
    double seconds, aim;
  };
  for (const Size& size :
       {Size{10000, "1e4", 0.15, 0.075}, {100000, "1e5", 4, 2}, {1000000, "1e6", 120, 60}}) {
    if (!bars.large() && size.nodes > 100000) break;
    const std::string name = format("N=%s, 6 nearest, ", size.name);
    const std::vector<Problem> systems = {testing::sparse_system<System>(1, size.nodes)};
    const GapTimes schwarz = times_to_gap("schwarz", systems);
    bars.at_most(name + "Schwarz", "%.3g s", schwarz.median_seconds, size.seconds, size.aim);
    if (size.nodes > 10000) {
      // Includes the memory to make the system. Sizes ascend, so the peak is that of this one.
      bars.at_most(name + "peak memory, a link", "%.0f bytes", peak_bytes() / systems[0].system.link_count(),
                   600, 300);
      const auto [one, two] = seconds_by_threads(systems[0]);
      bars.times_faster(name + "Schwarz, two threads against one", two, one, 1.7, 1.9);
      // With weak anchors, Newton's method for all nodes takes most of the time.
      if (bars.large() && size.nodes == 100000) {
        Problem weak = systems[0];
        weak.system.anchor_stiffness *= 1e-3;
        const auto [alone, both] = seconds_by_threads(weak);
        bars.times_faster(name + "anchors x 1e-3, two threads against one", both, alone, 1.7, 1.9);
      }
      continue;
    }
#ifdef ASTERISM_BENCH_CHOLMOD
    if (!bars.quick()) {
      bars.times_faster(name + "Schwarz against Ida, CHOLMOD", schwarz.median_seconds,
                        times_to_gap("ida-cholmod", systems).median_seconds, 10, 20);
    }
#endif
    auto weak = systems;
    weak[0].system.anchor_stiffness *= 1e-3;
    bars.at_most(name + "anchors x 1e-3, Schwarz", "%.3g s",
                 times_to_gap("schwarz-direct", weak).median_seconds, 0.76, 0.38);
  }
  if (bars.large()) ten_million_nodes(bars);
#ifdef ASTERISM_BENCH_CHOLMOD
  if (!bars.quick()) {
    const auto [own, cholmod] = seconds_by_factor();
    bars.times_faster("N=4000 in space, anchors x 1e-2, newton-sparse against CHOLMOD", own, cholmod, 1, 2);
  }
#endif
  bars.at_most("cloths of 60 x 60 nodes in space, newton-sparse, slowest", "%.3g s", cloth_seconds(), 1, 0.5);
}

}  // namespace asterism::bench
