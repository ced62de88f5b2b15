#include "solve.hpp"

#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/io/json.hpp>
#include <asterism/solver/run/summary.hpp>
#include <cstdio>
#include <limits>

namespace asterism::bench {

namespace {

void solve_one(const Problem& problem, const std::vector<SolverEntry>& entries, const Limits& limits) {
  struct Line {
    const SolverEntry* entry;
    Summary summary;
    double seconds;
  };
  std::vector<Line> lines;
  double lowest = std::numeric_limits<double>::infinity();
  for (const SolverEntry& entry : entries) {
    const auto runner = entry.make(problem.system.nodes());
    runner->load(problem);
    Points x;
    const Summary summary = runner->solve(limits, x);
    lines.push_back(
        {&entry, summary, summary.seconds > 0.1 ? summary.seconds : steady_seconds(*runner, limits)});
    if (summary.usable()) lowest = std::min(lowest, summary.final_energy);
  }
  std::printf("%-14s %-22s %22s %9s %10s %11s %12s %11s\n", "solver", "status", "energy", "above",
              "iterations", "evaluations", "stationarity", "time [us]");
  for (const auto& [entry, summary, seconds] : lines) {
    const double above = lowest > 0 ? summary.final_energy / lowest - 1 : summary.final_energy - lowest;
    std::printf("%-14s %-22s %22.15g %9.1e %10d %11d %12.1e %11.4g\n", entry->name.c_str(),
                std::string(to_string(summary.status)).c_str(), summary.final_energy, above,
                summary.iterations, summary.energy_evaluations, summary.stationarity, 1e6 * seconds);
  }
}

}  // namespace

std::vector<Problem> read_problems(const std::filesystem::path& path) {
  std::vector<Problem> problems;
  for (auto& stored : read_systems<System>(path)) {
    problems.push_back({std::move(stored.system), std::move(stored.start)});
  }
  return problems;
}

void solve_problem(const std::string& name, const Problem& problem, const std::vector<SolverEntry>& entries,
                   const Limits& limits) {
  std::printf("%s: %d nodes, %d links, energy at the start %.15g\n", name.c_str(), problem.system.nodes(),
              problem.system.link_count(), energy(problem.system, problem.start));
  std::vector<SolverEntry> able;
  for (const SolverEntry& entry : entries) {
    if (entry.reaches(problem.system)) able.push_back(entry);
  }
  solve_one(problem, able, limits);
}

void solve_file(const std::filesystem::path& path, const std::vector<SolverEntry>& entries,
                const Limits& limits) {
  const auto systems = read_systems<System>(path);
  if (systems.empty()) throw std::runtime_error(path.string() + ": no systems");
  for (std::size_t s = 0; s < systems.size(); ++s) {
    if (s > 0) std::printf("\n");
    solve_problem(systems[s].name.empty() ? "system " + std::to_string(s) : systems[s].name,
                  {systems[s].system, systems[s].start}, entries, limits);
  }
}

}  // namespace asterism::bench
