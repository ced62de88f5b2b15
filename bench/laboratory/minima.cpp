// How often solvers and starts end in different minima: the energy is not convex.
#include <algorithm>
#include <array>
#include <asterism/solver/method/lbfgs.hpp>
#include <asterism/solver/method/make_solver.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/solver/terms/from_springs.hpp>
#include <cmath>
#include <cstdio>
#include <limits>

#include "experiments.hpp"

namespace asterism::bench {

namespace {

constexpr int kStarts = 60;
constexpr double kSame = 1e-6;  // minima whose energies differ by less, relatively, count as one

/// The known minima of a system.
struct Minima {
  std::vector<double> energies;  ///< of different minima, ascending
  bool is_proven = false;        ///< the first energy is proven to be the least, up to the share kSame
};

/// The minima found from the problem's own start, random starts, and by the staircase from the lowest.
Minima minima_of(const Problem& problem) {
  const System& system = problem.system;
  const int n = system.nodes();
  // Random starts are in the anchors' bounding box, enlarged by half.
  const Eigen::Vector2d low = system.anchors.rowwise().minCoeff();
  const Eigen::Vector2d size = system.anchors.rowwise().maxCoeff() - low;
  testing::Rng rng(static_cast<std::uint64_t>(n));
  Minima minima;
  auto& energies = minima.energies;
  Points lowest = problem.start;
  Newton<System> newton;
  Lbfgs<System> lbfgs;
  for (int s = 0; s < kStarts; ++s) {
    Points x = problem.start;
    if (s > 0) {
      for (int i = 0; i < n; ++i)
        for (int d = 0; d < 2; ++d) x(d, i) = low[d] + size[d] * rng.uniform(-0.25, 1.25);
    }
    newton.options.align = lbfgs.options.align = s == 0;  // random starts stay where they are
    const Summary summary = n <= 16 ? newton.solve(system, x) : lbfgs.solve(system, x);
    if (summary.status != Status::Converged) continue;
    if (energies.empty() || summary.final_energy < *std::min_element(energies.begin(), energies.end()))
      lowest = x;
    energies.push_back(summary.final_energy);
  }
  const Summary up = solve_staircase(system, lowest);
  if (up.status == Status::Converged) energies.push_back(up.final_energy);
  std::sort(energies.begin(), energies.end());
  const auto same = [](double a, double b) { return b - a <= kSame * b; };
  energies.erase(std::unique(energies.begin(), energies.end(), same), energies.end());
  minima.is_proven = !energies.empty() && Summary::is_within(kSame, energies.front(), up.lower_bound);
  return minima;
}

Json measure(Runner& runner, const Chunk& chunk, double weakness) {
  std::vector<double> ends, lowest;
  std::vector<int> counts;
  std::vector<bool> proven;
  Points x;
  Newton<System> polish;
  for (int index = chunk.first; index < chunk.first + chunk.count; ++index) {
    Problem problem = chunk.problem(index);
    problem.system.anchor_stiffness *= weakness;
    const Minima minima = minima_of(problem);
    counts.push_back(static_cast<int>(minima.energies.size()));
    lowest.push_back(minima.energies.empty() ? 0 : minima.energies.front());
    proven.push_back(minima.is_proven);
    runner.load(problem);
    runner.solve({1e-8, 100000}, x);
    // Polishing tells to which minimum the solver converges; with weak anchors it may stop far from it.
    polish.options.tolerance = 1e-12;
    polish.options.align = false;
    ends.push_back(polish.solve(problem.system, x).final_energy);
  }
  return {{"weakness", weakness}, {"starts", kStarts}, {"minima", counts},
          {"lowest", lowest},     {"proven", proven},  {"ends", ends}};
}

constexpr std::array kStartKinds = {"own", "anchors", "mirrored"};

Points start_of(const Problem& problem, std::size_t kind) {
  if (kind == 0) return problem.start;
  Points start = problem.system.anchors;
  if (kind == 2) start.row(0).array() = 2 * start.row(0).mean() - start.row(0).array();
  return start;
}

Json measure_starts(Runner& runner, const Chunk& chunk, double weakness) {
  std::vector<double> lowest;
  std::array<std::vector<double>, kStartKinds.size()> ends;
  Points x;
  for (int index = chunk.first; index < chunk.first + chunk.count; ++index) {
    Problem problem = chunk.problem(index);
    problem.system.anchor_stiffness *= weakness;
    const Minima minima = minima_of(problem);
    lowest.push_back(minima.energies.empty() ? std::numeric_limits<double>::infinity()
                                             : minima.energies.front());
    for (std::size_t kind = 0; kind < kStartKinds.size(); ++kind) {
      Problem from = problem;
      from.start = start_of(problem, kind);
      runner.load(from);
      ends[kind].push_back(runner.solve({1e-8, 100000}, x).final_energy);
    }
  }
  Json json{{"weakness", weakness}, {"starts", kStarts}, {"lowest", lowest}};
  for (std::size_t kind = 0; kind < kStartKinds.size(); ++kind) json[kStartKinds[kind]] = ends[kind];
  return json;
}

// A field of the results of a group, a solver and a weakness, over all systems in order.
std::vector<double> values_of(const Results& results, const std::string& group, const std::string& solver,
                              double weakness, const char* field) {
  std::vector<double> values;
  for (const Json* cell : cells_with(results, group, solver)) {
    if ((*cell)["weakness"] != weakness) continue;
    for (const Json& v : cell->at(field))
      values.push_back(v.is_boolean() ? double(v.get<bool>()) : v.get<double>());
  }
  return values;
}

}  // namespace

Experiment starts(const Selection& selection) {
  const std::vector<double> weaknesses = {1, 1e-2};
  const std::vector<Cell> cells = cells_by_weakness(selection, weaknesses, measure_starts);
  const auto report = [selection, weaknesses](const Results& results) {
    std::printf(
        "%% of systems that end above the lowest minimum known, by solver and start\n\n| system | anchors |");
    for (const SolverEntry& solver : selection.solvers)
      for (const char* kind : kStartKinds) std::printf(" %s, %s |", solver.name.c_str(), kind);
    std::printf("\n|---|---|");
    for (std::size_t c = 0; c < kStartKinds.size() * selection.solvers.size(); ++c) std::printf("---|");
    for (const std::string& group : groups(selection)) {
      for (const double weakness : weaknesses) {
        const auto collect = [&](const std::string& solver, const char* field) {
          return values_of(results, group, solver, weakness, field);
        };
        // The lowest known energies, including those that the solvers found.
        std::vector<double> lowest;
        const auto lower = [&lowest](const std::vector<double>& energies) {
          lowest.resize(std::max(lowest.size(), energies.size()), std::numeric_limits<double>::infinity());
          for (std::size_t s = 0; s < energies.size(); ++s) lowest[s] = std::min(lowest[s], energies[s]);
        };
        for (const SolverEntry& solver : selection.solvers) {
          lower(collect(solver.name, "lowest"));
          for (const char* kind : kStartKinds) lower(collect(solver.name, kind));
        }
        std::printf("\n| %s | x %g |", group.c_str(), weakness);
        for (const SolverEntry& solver : selection.solvers) {
          for (const char* kind : kStartKinds) {
            const auto ends = collect(solver.name, kind);
            int above = 0;
            for (std::size_t s = 0; s < ends.size(); ++s) above += ends[s] > lowest[s] * (1 + 1e-4);
            std::printf(" %.1f |", ends.empty() ? std::nan("") : 100.0 * above / double(ends.size()));
          }
        }
      }
    }
    std::printf("\n");
  };
  return {"starts", cells, report};
}

Experiment minima(const Selection& selection) {
  const std::vector<double> weaknesses = {1, 1e-2, 1e-4};
  const std::vector<Cell> cells = cells_by_weakness(selection, weaknesses, measure);
  const auto report = [selection, weaknesses](const Results& results) {
    double several = 0;
    for (const std::string& group : groups(selection)) {
      for (const double weakness : weaknesses) {
        const auto collect = [&](const std::string& solver, const char* field) {
          return values_of(results, group, solver, weakness, field);
        };
        const auto ida = collect("ida", "ends");
        bool first = true;
        for (const SolverEntry& solver : selection.solvers) {
          const auto counts = collect(solver.name, "minima");
          const auto lowest = collect(solver.name, "lowest");
          const auto proven = collect(solver.name, "proven");
          const auto ends = collect(solver.name, "ends");
          if (ends.empty()) continue;
          if (first) {
            const auto many = std::count_if(counts.begin(), counts.end(), [](double c) { return c > 1; });
            several = std::max(several, double(many) / double(counts.size()));
            std::printf(
                "\n%s, anchors x %g: %.1f %% of %zu systems have two minima or more (%d starts); the "
                "lowest is proven in %.1f %%\n",
                group.c_str(), weakness, 100.0 * double(many) / double(counts.size()), counts.size(), kStarts,
                100.0 * double(std::count(proven.begin(), proven.end(), 1.0)) / double(counts.size()));
            first = false;
          }
          int missed = 0, surely = 0, other = 0;
          std::vector<double> excess = {0};
          for (std::size_t s = 0; s < ends.size(); ++s) {
            const bool above = ends[s] > lowest[s] * (1 + 1e-4);
            missed += above;
            surely += above && proven[s] > 0;
            if (above) excess.push_back(ends[s] / lowest[s] - 1);
            if (s < ida.size()) other += std::abs(ends[s] - ida[s]) > 1e-4 * ida[s];
          }
          std::printf(
              "  %-14s misses the lowest in %5.1f %% (median excess %.0f %%), a proven one in %5.1f %%, not "
              "where IDA ends in %5.1f %%\n",
              solver.name.c_str(), 100.0 * missed / double(ends.size()), 100 * median(excess),
              100.0 * surely / double(ends.size()), 100.0 * other / double(ends.size()));
        }
      }
    }
    std::printf("\n");
    claim("the energy is convex", several == 0,
          format("up to %.0f %% of a kind's systems have two minima or more", 100 * several));
  };
  return {"minima", cells, report};
}

}  // namespace asterism::bench
