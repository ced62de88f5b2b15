// How often a solution is proven to be the global minimum, how wide the interval of the least energy is if
// not, and how long a certificate takes compared with the solve.
#include <algorithm>
#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/run/summary.hpp>
#include <cstdio>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "experiments.hpp"
#include "measure.hpp"

namespace asterism::bench {

namespace {

constexpr double kClose = 1e-6;

Json measure(Runner& runner, const Chunk& chunk, double weakness) {
  std::vector<double> energies, bounds, solve_seconds, certify_seconds;
  std::vector<bool> certified;
  Certifier<System> certifier;
  Points x;
  for (int index = chunk.first; index < chunk.first + chunk.count; ++index) {
    Problem problem = chunk.problem(index);
    problem.system.anchor_stiffness *= weakness;
    runner.load(problem);
    const double begin = cpu_seconds();
    const Summary summary = runner.solve({1e-8, 100000}, x);
    const double solved = cpu_seconds();
    const Certificate certificate = certifier.certify(problem.system, x);
    const double end = cpu_seconds();
    energies.push_back(summary.final_energy);
    bounds.push_back(std::max(summary.lower_bound, certificate.lower_bound));
    certified.push_back(certificate.certified());
    solve_seconds.push_back(solved - begin);
    certify_seconds.push_back(end - solved);
  }
  return {{"weakness", weakness},   {"energies", energies},           {"bounds", bounds},
          {"certified", certified}, {"solve_seconds", solve_seconds}, {"certify_seconds", certify_seconds}};
}

// The results of a group, a solver and a weakness, in the order of the systems.
struct Proofs {
  std::vector<double> energies, bounds, solve_seconds, certify_seconds;
  int certified = 0;

  Proofs(const Results& results, const std::string& group, const std::string& solver, double weakness) {
    for (const Json* cell : cells_with(results, group, solver)) {
      if ((*cell)["weakness"] != weakness) continue;
      const auto append = [cell](std::vector<double>& to, const char* field) {
        for (const double value : (*cell)[field]) to.push_back(value);
      };
      append(energies, "energies");
      append(bounds, "bounds");
      append(solve_seconds, "solve_seconds");
      append(certify_seconds, "certify_seconds");
      for (const bool is_certified : (*cell)["certified"]) certified += is_certified ? 1 : 0;
    }
  }

  double percent(double count) const { return 100.0 * count / static_cast<double>(energies.size()); }
};

void print_row(const std::string& group, double weakness, const std::string& solver, const Proofs& proofs,
               const std::vector<double>& lowest) {
  int is_lowest = 0, is_proven = 0;
  std::vector<double> widths;
  for (std::size_t s = 0; s < proofs.energies.size(); ++s) {
    const double energy = proofs.energies[s];
    is_lowest += energy <= (1 + kClose) * lowest[s] ? 1 : 0;
    const double width = energy > 0 ? (energy - proofs.bounds[s]) / energy : 0;
    if (width <= kClose) {
      ++is_proven;
    } else {
      widths.push_back(width);
    }
  }
  std::printf("| %s | x %g | %s | %.1f | %.1f | %.1f |", group.c_str(), weakness, solver.c_str(),
              proofs.percent(is_lowest), proofs.percent(proofs.certified), proofs.percent(is_proven));
  if (widths.empty()) {
    std::printf(" - | - |");
  } else {
    std::printf(" %.2g | %.2g |", median(widths), *std::max_element(widths.begin(), widths.end()));
  }
  std::printf(" %.3g | %.3g |\n", 1e6 * median(proofs.solve_seconds), 1e6 * median(proofs.certify_seconds));
}

}  // namespace

Experiment proof(const Selection& selection) {
  const std::vector<double> weaknesses = {1, 1e-2};
  const auto report = [selection, weaknesses](const Results& results) {
    std::printf(
        "%% of systems whose solution is the lowest of all solvers', is certified, has an energy within 1e-6 "
        "of its\nproven lower bound; of the rest the relative width of the interval, median and widest; CPU "
        "time of a solve and\nof a certificate, median [us]\n\n"
        "| system | anchors | solver | lowest | certified | within 1e-6 | rest | widest | solve | certify |\n"
        "|---|---|---|---|---|---|---|---|---|---|\n");
    for (const std::string& group : groups(selection)) {
      for (const double weakness : weaknesses) {
        std::vector<double> lowest;
        std::vector<std::pair<std::string, Proofs>> all;
        for (const SolverEntry& solver : selection.solvers) {
          Proofs proofs(results, group, solver.name, weakness);
          lowest.resize(std::max(lowest.size(), proofs.energies.size()),
                        std::numeric_limits<double>::infinity());
          for (std::size_t s = 0; s < proofs.energies.size(); ++s)
            lowest[s] = std::min(lowest[s], proofs.energies[s]);
          if (!proofs.energies.empty()) all.emplace_back(solver.name, std::move(proofs));
        }
        for (const auto& [name, proofs] : all) print_row(group, weakness, name, proofs, lowest);
      }
    }
  };
  return {"proof", cells_by_weakness(selection, weaknesses, measure), report};
}

}  // namespace asterism::bench
