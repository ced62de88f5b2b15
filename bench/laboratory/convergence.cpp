// Energy that remains after each iteration: the paper's Figure 7.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "experiments.hpp"

namespace asterism::bench {

namespace {

/// The iterations after which the energy is recorded: all of the first ten, then a tenth of a decade apart.
const std::vector<int>& looks() {
  static const std::vector<int> result = [] {
    std::vector<int> k = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10};
    while (k.back() < 10000)
      k.push_back(static_cast<int>(std::lround(std::pow(10, static_cast<double>(k.size()) / 10))));
    return k;
  }();
  return result;
}

/// Bins of the relative gap, each a twentieth of a decade; the first has all gaps up to 1e-16.
constexpr double kLeast = -16, kBinsPerDecade = 20;
int bin_of(double gap) {
  if (!(gap > 1e-16)) return 0;
  return 1 + static_cast<int>((std::log10(gap) - kLeast) * kBinsPerDecade);
}
double gap_of(int bin) { return bin == 0 ? 0 : std::pow(10, kLeast + (bin - 0.5) / kBinsPerDecade); }

/// Sums over systems at each look.
struct Curve {
  std::vector<double> remaining = std::vector<double>(looks().size());  // sum of E / E_0
  std::vector<std::map<int, long>> gaps = std::vector<std::map<int, long>>(looks().size());
  long systems = 0;

  void add(const Json& cell) {
    systems += cell["systems"].get<long>();
    for (std::size_t k = 0; k < looks().size(); ++k) {
      remaining[k] += cell["remaining"][k].get<double>();
      for (const auto& [bin, count] : cell["gaps"][k].items()) gaps[k][std::stoi(bin)] += count.get<long>();
    }
  }
  double mean(std::size_t k) const { return remaining[k] / static_cast<double>(systems); }
  double gap_percentile(std::size_t k, double p) const {
    long below = 0;
    for (const auto& [bin, count] : gaps[k]) {
      below += count;
      if (static_cast<double>(below) >= p * static_cast<double>(systems)) return gap_of(bin);
    }
    return gap_of(gaps[k].rbegin()->first);
  }
};

Json measure(Runner& runner, const Chunk& chunk) {
  std::vector<double> remaining(looks().size());
  std::vector<std::map<std::string, int>> gaps(looks().size());
  int arrived = 0;
  Points x;
  for (int index = chunk.first; index < chunk.first + chunk.count; ++index) {
    runner.load(chunk.problem(index));
    std::vector<double> energies;  // after each iteration; a number that is skipped has the energy before
    auto record = [&energies](const Iteration& at) {
      energies.resize(static_cast<std::size_t>(at.number) + 1,
                      energies.empty() ? at.energy : energies.back());
      energies.back() = at.energy;
      return true;
    };
    const Summary all = runner.solve({1e-10, 100000, record}, x);
    arrived += all.status == Status::Converged;
    for (std::size_t k = 0; k < looks().size(); ++k) {
      const auto look = static_cast<std::size_t>(looks()[k]);
      const double energy =
          look < energies.size() && looks()[k] < all.iterations ? energies[look] : all.final_energy;
      remaining[k] += energy / all.initial_energy;
      ++gaps[k][std::to_string(bin_of((energy - all.final_energy) / all.final_energy))];
    }
  }
  return {{"converged", arrived}, {"looks", looks()}, {"remaining", remaining}, {"gaps", gaps}};
}

}  // namespace

Experiment convergence(const Selection& selection) {
  const auto report = [selection](const Results& results) {
    for (const std::string& group : groups(selection)) {
      std::printf("\n%s: mean E/E_0 after 1, 3, 5, 10 iterations; median gap after 10, 32, 100, 316, 1000\n",
                  group.c_str());
      std::map<std::string, Curve> curves;
      for (const SolverEntry& solver : selection.solvers) {
        Curve curve;
        for (const Json* cell : cells_with(results, group, solver.name)) curve.add(*cell);
        if (curve.systems == 0) continue;
        std::printf("  %-14s", solver.name.c_str());
        for (const std::size_t k : {1u, 3u, 5u, 10u}) std::printf(" %.4f", curve.mean(k));
        std::printf("  ");
        for (const int iterations : {10, 32, 100, 316, 1000}) {
          const auto at = std::lower_bound(looks().begin(), looks().end(), iterations) - looks().begin();
          std::printf(" %8.1e", curve.gap_percentile(static_cast<std::size_t>(at), 0.5));
        }
        std::printf("  %ld systems\n", curve.systems);
        curves[solver.name] = std::move(curve);
      }
      if (!curves.contains("ida") || !curves.contains("ncg")) continue;
      const Curve& ida = curves["ida"];
      const Curve& ncg = curves["ncg"];
      claim("IDA's first steps lower the energy much faster than those of nonlinear CG",
            ida.mean(1) < 0.9 * ncg.mean(1) && ida.mean(3) < 0.9 * ncg.mean(3),
            format("E/E_0 after 1 and 3 iterations: IDA %.4f and %.4f, CG %.4f and %.4f", ida.mean(1),
                   ida.mean(3), ncg.mean(1), ncg.mean(3)));
      claim("both end with equivalent energies",
            std::abs(ida.mean(looks().size() - 1) / ncg.mean(looks().size() - 1) - 1) < 0.01,
            format("mean E/E_0 at the end: IDA %.6f, CG %.6f", ida.mean(looks().size() - 1),
                   ncg.mean(looks().size() - 1)));
      const auto to = [](const Curve& curve, double gap) {
        std::size_t k = 0;
        while (k + 1 < looks().size() && curve.gap_percentile(k, 0.5) > gap) ++k;
        return looks()[k];
      };
      claim("IDA needs fewer iterations than CG, at equal accuracy", to(ida, 1e-6) < to(ncg, 1e-6),
            format("median gap of 1e-6 by iteration %d of IDA, %d of CG; of 1e-2 by %d and %d", to(ida, 1e-6),
                   to(ncg, 1e-6), to(ida, 1e-2), to(ncg, 1e-2)));
    }
  };
  return {"convergence", cells_of(selection, measure), report};
}

}  // namespace asterism::bench
