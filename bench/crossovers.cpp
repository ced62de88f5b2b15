// Which solver when: the time of the candidates of Auto against size, linking and strength of the anchors.
#include "crossovers.hpp"

#include <algorithm>
#include <asterism/solver.hpp>
#include <cstdio>
#include <string>
#include <vector>

#include "bars.hpp"
#include "comparison_solvers.hpp"
#include "laboratory.hpp"
#include "sparse_system.hpp"

namespace asterism::bench {

namespace {

using Systems = std::vector<Problem>;

constexpr double kTolerance = 1e-6;

/// Median CPU time of a solve [s], and its mean energy.
struct Cost {
  double seconds;
  double energy;
};

template <typename Solver>
Cost cost(const Systems& systems) {
  Solver solver;
  solver.options.tolerance = kTolerance;
  solver.options.max_iterations = 20000;
  std::vector<double> seconds;
  double energy = 0;
  for (const auto& [system, start] : systems) {
    double least = 0;
    for (int repeat = 0; repeat < 3; ++repeat) {
      auto x = start;
      const double before = cpu_seconds();
      const Summary summary = solver.solve(system, x);
      const double time = cpu_seconds() - before;
      least = repeat == 0 ? time : std::min(least, time);
      if (repeat == 0) energy += summary.final_energy / static_cast<double>(systems.size());
      if (time > 0.1) break;
    }
    seconds.push_back(least);
  }
  return {median(seconds), energy};
}

template <typename... Solvers>
void row(const std::string& name, const Systems& systems, const Cost& chosen) {
  const Cost costs[] = {cost<Solvers>(systems)...};
  const auto fastest = std::min_element(std::begin(costs), std::end(costs),
                                        [](const Cost& a, const Cost& b) { return a.seconds < b.seconds; });
  std::printf("%-26s", name.c_str());
  for (const Cost& c : costs) {
    std::printf(" %9.3g%s", 1e6 * c.seconds, &c == &*fastest ? "*" : " ");
  }
  std::printf(" %9.3g  %.6g\n", 1e6 * chosen.seconds, fastest->energy);
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
  for (const Kind kind : {Kind::Lit, Kind::Track}) {
    for (const double weakness : {1.0, 1e-4}) {
      for (const int n : {4, 6, 9, 12, 16, 20, 25, 36, 64, 100}) {
        const int count = std::max(5, 400 / n);
        const auto systems = weakened(samples<System>(count, Topology<>::full(n), kind), weakness);
        const std::string name = kind == Kind::Lit ? "LIT" : "TRACK";
        row<Newton<System>, Lbfgs<System>, NewtonCg<System, DenseCholesky<System>>, Ida<System>,
            AndersonIda<System>, ChebyshevIda<System>>(name + format(", anchors x %g, N=%d", weakness, n),
                                                       systems, cost<Auto<System>>(systems));
      }
    }
  }
}

void sparse_crossovers(bool quick) {
  std::printf("\n%-26s %9s  %9s  %9s  %9s  %9s  %9s  %s\n", "six nearest", "LB Jacobi", "LB chol.",
              "CG Jacobi", "Schwarz", "Sch.+LDL", "Auto", "energy");
  for (const double weakness : {1.0, 1e-2, 1e-4, 1e-6}) {
    for (const int n : {30, 100, 300, 1000, 10000, 100000}) {
      if (quick && n > 10000) break;
      Systems systems;
      for (std::uint64_t seed = 1; seed <= (n <= 1000 ? 5 : 1); ++seed) {
        systems.push_back(sparse_system<System>(seed, n));
      }
      systems = weakened(std::move(systems), weakness);
      row<Lbfgs<System, JacobiMetric<System>>, Lbfgs<System, SparseCholesky<System>>, NewtonCg<System>,
          Schwarz<System>, Schwarz<System, SparseNewton<System>>>(format("anchors x %g, N=%d", weakness, n),
                                                                  systems, cost<Auto<System>>(systems));
    }
  }
}

}  // namespace asterism::bench
