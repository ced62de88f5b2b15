#include "solve.hpp"

#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/io/json.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/solver/terms/registry.hpp>
#include <cstdio>
#include <limits>
#include <sstream>
#include <type_traits>
#include <variant>

namespace asterism::bench {

namespace {

struct Line {
  std::string solver;
  Summary summary;
  double seconds;
};

void print_table(const std::vector<Line>& lines) {
  double lowest = std::numeric_limits<double>::infinity();
  for (const Line& line : lines) {
    if (line.summary.usable()) lowest = std::min(lowest, line.summary.final_energy);
  }
  std::printf("%-14s %-22s %22s %9s %10s %11s %12s %11s\n", "solver", "status", "energy", "above",
              "iterations", "evaluations", "stationarity", "time [us]");
  for (const auto& [solver, summary, seconds] : lines) {
    const double above = lowest > 0 ? summary.final_energy / lowest - 1 : summary.final_energy - lowest;
    std::printf("%-14s %-22s %22.15g %9.1e %10d %11d %12.1e %11.4g\n", solver.c_str(),
                std::string(to_string(summary.status)).c_str(), summary.final_energy, above,
                summary.iterations, summary.energy_evaluations, summary.stationarity, 1e6 * seconds);
  }
}

// For a method that a system does not allow, the line says so: its term has not the curvature.
void solve_terms(const std::string& name, const StoredTerms& problem, const std::string& solvers,
                 const Limits& limits) {
  std::printf("%s: %d nodes, %d terms, energy at the start %.15g\n", name.c_str(), problem.system.nodes(),
              problem.system.term_count(), energy(problem.system, problem.start));
  const SolverRegistry<asterism::System> registry = system_solvers();
  std::vector<std::string> names = registry.names();
  if (solvers != "all") {
    names.clear();
    std::istringstream list(solvers);
    for (std::string each; std::getline(list, each, ',');) names.push_back(each);
  }
  std::vector<Line> lines;
  for (const std::string& each : names) {
    AnySolver<asterism::System> solver = registry.make(each);
    solver.options().tolerance = limits.tolerance;
    solver.options().max_iterations = limits.iterations;
    Line line{each, {}, std::numeric_limits<double>::infinity()};
    constexpr int kMostRounds = 20;
    double total = 0;
    for (int round = 0; round < kMostRounds && total < 0.1; ++round) {
      Eigen::MatrixXd x = problem.start;
      line.summary = solver.solve(problem.system, x);
      line.seconds = std::min(line.seconds, line.summary.seconds);
      total += line.summary.seconds;
    }
    lines.push_back(std::move(line));
  }
  print_table(lines);
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
  std::vector<Line> lines;
  for (const SolverEntry& entry : entries) {
    if (!entry.reaches(problem.system)) continue;
    const auto runner = entry.make(problem.system.nodes());
    runner->load(problem);
    Points x;
    const Summary summary = runner->solve(limits, x);
    lines.push_back(
        {entry.name, summary, summary.seconds > 0.1 ? summary.seconds : steady_seconds(*runner, limits)});
  }
  print_table(lines);
}

void solve_file(const std::filesystem::path& path, const std::string& solvers, const Limits& limits) {
  std::vector<std::variant<StoredSystem<System>, StoredTerms>> systems;
  const auto take = [&systems](auto&& stored) { systems.emplace_back(std::move(stored)); };
  detail::StoredVisitor visitor = detail::visitor_of<System>(take);
  visitor.terms = take;
  detail::for_each_stored(detail::read_text(path), path.string(), visitor);
  if (systems.empty()) throw std::runtime_error(path.string() + ": no systems");
  for (std::size_t s = 0; s < systems.size(); ++s) {
    if (s > 0) std::printf("\n");
    std::visit(
        [&]<typename Stored>(const Stored& stored) {
          const std::string name = stored.name.empty() ? "system " + std::to_string(s) : stored.name;
          if constexpr (std::is_same_v<Stored, StoredTerms>) {
            solve_terms(name, stored, solvers, limits);
          } else {
            solve_problem(name, {stored.system, stored.start}, solvers_named(solvers), limits);
          }
        },
        systems[s]);
  }
}

}  // namespace asterism::bench
