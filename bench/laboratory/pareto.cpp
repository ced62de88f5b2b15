// Accuracy against time, as solvers can only be compared in speed at equal accuracy.
#include <cmath>
#include <cstdio>

#include "experiments.hpp"

namespace asterism::bench {

namespace {

const std::vector<double>& tolerances() {
  static const std::vector<double> result = {1,    0.3,  0.1,  3e-2, 1e-2, 3e-3, 1e-3,
                                             1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10};
  return result;
}

// For each tolerance, the time and the gap to the solver's own minimum.
Json measure(Runner& runner, const Chunk& chunk) {
  std::vector<std::vector<double>> seconds(tolerances().size()), gaps(tolerances().size());
  Points x;
  const int count = std::min(chunk.count, 20);  // the clock takes a millisecond for each
  for (int index = chunk.first; index < chunk.first + count; ++index) {
    runner.load(chunk.problem(index));
    const double minimum = runner.solve({1e-12, 100000}, x).final_energy;
    for (std::size_t t = 0; t < tolerances().size(); ++t) {
      const Limits limits{tolerances()[t], 100000};
      const Summary summary = runner.solve(limits, x);
      gaps[t].push_back(std::max(0.0, (summary.final_energy - minimum) / minimum));
      seconds[t].push_back(steady_seconds(runner, limits));
    }
  }
  return {{"nodes", chunk.nodes}, {"tolerances", tolerances()}, {"gaps", gaps}, {"seconds", seconds}};
}

}  // namespace

Experiment pareto(const Selection& selection) {
  const auto report = [selection](const Results& results) {
    for (const std::string& group : groups(selection)) {
      std::printf(
          "\n%s: median time [us] to a 90th percentile of the gap of at most 1e-2, 1e-4, 1e-6, 1e-8, 1e-10\n",
          group.c_str());
      for (const SolverEntry& solver : selection.solvers) {
        std::vector<std::vector<double>> gaps(tolerances().size()), seconds(tolerances().size());
        for (const Json* cell : cells_with(results, group, solver.name)) {
          for (std::size_t t = 0; t < tolerances().size(); ++t) {
            for (const double gap : (*cell)["gaps"][t]) gaps[t].push_back(gap);
            for (const double s : (*cell)["seconds"][t]) seconds[t].push_back(s);
          }
        }
        if (gaps[0].empty()) continue;
        std::printf("  %-14s", solver.name.c_str());
        for (const double gap : {1e-2, 1e-4, 1e-6, 1e-8, 1e-10}) {
          std::size_t t = 0;
          while (t < gaps.size() && percentile(gaps[t], 0.9) > gap) ++t;
          std::printf(t < gaps.size() ? " %10.3g" : "          -",
                      t < gaps.size() ? 1e6 * median(seconds[t]) : 0);
        }
        std::printf("\n");
      }
    }
  };
  return {"pareto", cells_of(selection, measure), report};
}

}  // namespace asterism::bench
