// Time of the solvers between which Auto chooses, against size, linking and strength of the anchors.
#include "crossovers.hpp"

#include <algorithm>
#include <asterism/testing/sparse_system.hpp>
#include <cstdio>
#include <string>
#include <vector>

#include "bars.hpp"
#include "laboratory.hpp"

namespace asterism::bench {

namespace {

using Systems = std::vector<Problem>;

constexpr double kTolerance = 1e-6;

/// Median CPU time of a solve [s], and its mean energy.
struct Cost {
  double seconds;
  double energy;
};

// Compiled for any number of nodes, the case that Auto's choice is made for.
Cost cost(const SolverEntry& entry, const Systems& systems) {
  const auto runner = entry.make(Eigen::Dynamic);
  const Limits limits{kTolerance, 20000};
  std::vector<double> seconds;
  double energy = 0;
  Points x;
  for (const Problem& problem : systems) {
    runner->load(problem);
    energy += runner->solve(limits, x).final_energy / static_cast<double>(systems.size());
    double least = runner->seconds(limits, 1);
    for (int repeat = 0; repeat < 2 && least < 0.1; ++repeat) {
      least = std::min(least, runner->seconds(limits, 1));
    }
    seconds.push_back(least);
  }
  return {median(seconds), energy};
}

/// Prints a line of a table: each candidate's time, and then Auto's.
void row(const std::string& name, const Systems& systems, const std::vector<SolverEntry>& candidates) {
  std::vector<Cost> costs;
  for (const SolverEntry& candidate : candidates) costs.push_back(cost(candidate, systems));
  const auto fastest = std::min_element(costs.begin(), costs.end(),
                                        [](const Cost& a, const Cost& b) { return a.seconds < b.seconds; });
  std::printf("%-26s", name.c_str());
  for (const Cost& c : costs) std::printf(" %9.3g%s", 1e6 * c.seconds, &c == &*fastest ? "*" : " ");
  std::printf(" %9.3g  %.6g\n", 1e6 * cost(solvers_named("auto").front(), systems).seconds, fastest->energy);
  std::fflush(stdout);
}

Systems weakened(Systems systems, double factor) {
  for (auto& sample : systems) sample.system.anchor_stiffness *= factor;
  return systems;
}

}  // namespace

void dense_crossovers() {
  std::printf("CPU time of a solve to stationarity %g [us], median; * the fastest\n\n", kTolerance);
  std::printf("%-26s %9s  %9s  %9s  %9s  %9s  %9s  %9s  %s\n", "fully connected", "Newton", "L-BFGS",
              "Newton-CG", "Ida", "Anderson", "Chebyshev", "Auto", "energy");
  const auto candidates = solvers_named("newton,lbfgs,newton-cg,ida,ida-anderson,ida-chebyshev");
  for (const testing::Kind kind : {testing::Kind::Lit, testing::Kind::Orig, testing::Kind::Track}) {
    for (const double weakness : {1.0, 1e-4}) {
      for (const int n : {4, 6, 9, 12, 16, 20, 25, 36, 64, 100}) {
        const int count = std::max(5, 400 / n);
        const auto systems = weakened(samples<System>(count, Topology<>::full(n), kind), weakness);
        const std::string name = kind == testing::Kind::Lit    ? "LIT"
                                 : kind == testing::Kind::Orig ? "ORIG"
                                                               : "TRACK";
        row(name + format(", anchors x %g, N=%d", weakness, n), systems, candidates);
      }
    }
  }
}

void sparse_crossovers(bool quick) {
  std::printf("\n%-26s %9s  %9s  %9s  %9s  %9s  %9s  %s\n", "six nearest", "LB Jacobi", "LB chol.",
              "CG Jacobi", "Schwarz", "Sch.+LDL", "Auto", "energy");
  const auto candidates = solvers_named("lbfgs-jacobi,lbfgs-cholesky,newton-cg,schwarz,schwarz-direct");
  for (const double weakness : {1.0, 1e-2, 1e-4, 1e-6}) {
    for (const int n : {30, 100, 300, 1000, 10000, 100000}) {
      if (quick && n > 10000) break;
      Systems systems;
      for (std::uint64_t seed = 1; seed <= (n <= 1000 ? 5 : 1); ++seed) {
        systems.push_back(testing::sparse_system<System>(seed, n));
      }
      systems = weakened(std::move(systems), weakness);
      row(format("anchors x %g, N=%d", weakness, n), systems, candidates);
    }
  }
}

}  // namespace asterism::bench
