#pragma once

#include <asterism/solver/summary.hpp>
#include <cstddef>
#include <vector>

#include "bars.hpp"

namespace asterism::bench {

struct ToGap {
  double mean_seconds = 0;  // a solve, setup included
  double median_seconds = 0;
  double median_iterations = 0;
};

/// CPU time of a solver from the start of each system to a relative energy gap above its own minimum. The
/// number of iterations that this takes is found first, then exactly those are timed, `repeats` times.
template <typename Solver, typename System>
ToGap to_gap(const std::vector<RandomSystem<System>>& systems, int repeats, double gap = 1e-6) {
  Solver solver;
  std::vector<double> iterations, seconds;
  for (const auto& sample : systems) {
    const auto energy_after = [&](int count, double tolerance) {
      solver.options.max_iterations = count;
      solver.options.tolerance = tolerance;
      auto x = sample.start;
      return solver.solve(sample.system, x).final_energy;
    };
    const double target = (1 + gap) * energy_after(100000, 1e-10);
    int enough = 1, too_few = 0;
    while (energy_after(enough, 0) > target && enough < 100000) {
      too_few = enough;
      enough *= 2;
    }
    while (enough - too_few > 1) {
      const int middle = too_few + (enough - too_few) / 2;
      (energy_after(middle, 0) > target ? too_few : enough) = middle;
    }
    iterations.push_back(enough);
  }
  solver.options.tolerance = 0;
  ToGap result;
  for (std::size_t s = 0; s < systems.size(); ++s) {
    solver.options.max_iterations = static_cast<int>(iterations[s]);
    const double before = cpu_seconds();
    for (int r = 0; r < repeats; ++r) {
      auto x = systems[s].start;
      solver.solve(systems[s].system, x);
    }
    seconds.push_back((cpu_seconds() - before) / repeats);
  }
  for (const double t : seconds) result.mean_seconds += t / static_cast<double>(seconds.size());
  result.median_seconds = median(seconds);
  result.median_iterations = median(iterations);
  return result;
}

/// Mean CPU time of one solve with the solver's own stopping rule at `tolerance`.
template <typename Solver, typename System>
double seconds_to_tolerance(const std::vector<RandomSystem<System>>& systems, double tolerance, int repeats) {
  Solver solver;
  solver.options.tolerance = tolerance;
  const double before = cpu_seconds();
  for (int r = 0; r < repeats; ++r) {
    for (const auto& sample : systems) {
      auto x = sample.start;
      solver.solve(sample.system, x);
    }
  }
  return (cpu_seconds() - before) / (repeats * static_cast<double>(systems.size()));
}

}  // namespace asterism::bench
