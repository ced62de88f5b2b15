// Iterations and time against the number of parts: the paper's Figure 9.
#include <cmath>
#include <cstdio>
#include <optional>

#include "experiments.hpp"

namespace asterism::bench {

namespace {

constexpr double kGap = 1e-6;

// The iterations until one lowers the energy by less than 1 %, a stopping rule that a tracker may use.
int loose_iterations(Runner& runner) {
  Points x;
  double before = runner.solve({0, 0}, x).final_energy;
  for (int k = 1; k < 1000; ++k) {
    const double after = runner.solve({0, k}, x).final_energy;
    if (!(before - after >= 1e-2 * before)) return k;
    before = after;
  }
  return 1000;
}

Json measure(Runner& runner, const Chunk& chunk) {
  std::vector<int> loose, iterations;
  std::vector<double> seconds;
  for (int index = chunk.first; index < chunk.first + chunk.count; ++index) {
    runner.load(chunk.problem(index));
    loose.push_back(chunk.nodes <= 1000 ? loose_iterations(runner) : -1);
    const ToGap to = to_gap(runner, kGap);
    iterations.push_back(to.iterations);
    seconds.push_back(to.seconds);
  }
  return {{"nodes", chunk.nodes},
          {"gap", kGap},
          {"loose_iterations", loose},
          {"iterations", iterations},
          {"seconds", seconds}};
}

/// The results in the cells of one group and solver.
struct Figures {
  std::vector<double> loose, iterations, seconds;
  std::map<std::string, std::vector<double>> seconds_of_cell;  // negative if it did not reach the gap
  int failed = 0;

  explicit Figures(const std::vector<const Json*>& cells) {
    for (const Json* cell : cells) {
      for (const double k : (*cell)["loose_iterations"]) {
        if (k >= 0) loose.push_back(k);  // not measured of large systems
      }
      for (std::size_t s = 0; s < (*cell)["iterations"].size(); ++s) {
        const double k = (*cell)["iterations"][s];
        std::string chunk = (*cell)["key"];
        chunk.erase(chunk.rfind('/'));
        seconds_of_cell[chunk].push_back(k < 0 ? -1 : (*cell)["seconds"][s].get<double>());
        if (k < 0) {
          ++failed;
          continue;
        }
        iterations.push_back(k);
        seconds.push_back((*cell)["seconds"][s]);
      }
    }
  }
  /// The ratio of this solver's time to another's, over all systems that both solve.
  MedianInterval ratio(const Figures& other) const {
    std::vector<double> ratios;
    for (const auto& [chunk, times] : seconds_of_cell) {
      const auto theirs = other.seconds_of_cell.find(chunk);
      if (theirs == other.seconds_of_cell.end()) continue;
      for (std::size_t s = 0; s < times.size(); ++s) {
        if (times[s] > 0 && theirs->second[s] > 0) ratios.push_back(times[s] / theirs->second[s]);
      }
    }
    return ratios.empty() ? MedianInterval{} : median_interval(ratios);
  }
  static double mean(const std::vector<double>& values) {
    double sum = 0;
    for (const double v : values) sum += v;
    return sum / static_cast<double>(values.size());
  }
  static double deviation(const std::vector<double>& values) {
    const double m = mean(values);
    double sum = 0;
    for (const double v : values) sum += (v - m) * (v - m);
    return std::sqrt(sum / static_cast<double>(values.size()));
  }
};

}  // namespace

Experiment scaling(const Selection& selection) {
  const auto report = [selection](const Results& results) {
    std::map<std::string, std::map<int, Figures>> dense;  // of the first kind, by solver
    for (const std::string& group : groups(selection)) {
      std::printf("\n%s: iterations until a step gains < 1 %%; iterations and time to a gap of %.0e\n",
                  group.c_str(), kGap);
      std::printf("  %-14s %-16s %-22s %-8s %10s %10s %10s  %-14s %s\n", "", "mean +- sd", "mean +- sd",
                  "median", "median", "5 %", "95 %", "did not arrive",
                  "time over the first's, its 95 % interval");
      std::optional<Figures> first;
      for (const SolverEntry& solver : selection.solvers) {
        const Figures f(cells_with(results, group, solver.name));
        if (f.iterations.empty()) {
          if (f.failed > 0)
            std::printf("  %-14s %d of %d did not arrive\n", solver.name.c_str(), f.failed, f.failed);
          continue;
        }
        if (!first) first = f;
        const MedianInterval ratio = f.ratio(*first);
        std::printf(
            "  %-14s %-16s %8.1f +- %-8.1f %6.0f %9.3g s %9.3g s %9.3g s  %4d of %-7zu %.3g, %.3g "
            "to %.3g\n",
            solver.name.c_str(),
            f.loose.empty()
                ? ""
                : format("%6.1f +- %.1f", Figures::mean(f.loose), Figures::deviation(f.loose)).c_str(),
            Figures::mean(f.iterations), Figures::deviation(f.iterations), median(f.iterations),
            median(f.seconds), percentile(f.seconds, 0.05), percentile(f.seconds, 0.95), f.failed,
            f.iterations.size() + static_cast<std::size_t>(f.failed), ratio.median, ratio.low, ratio.high);
        if (!selection.kinds.empty() && group.starts_with(std::string(to_string(selection.kinds[0])) + "/"))
          dense[solver.name].emplace(std::stoi(group.substr(group.find('/') + 1)), f);
      }
    }
    if (dense["ida"].size() < 2 || dense["ncg"].size() < 2) return;
    const auto& [fewest, ida_first] = *dense["ida"].begin();
    const auto& [most, ida_last] = *dense["ida"].rbegin();
    const Figures& ncg_first = dense["ncg"].begin()->second;
    const Figures& ncg_last = dense["ncg"].rbegin()->second;
    using F = Figures;
    std::printf("\n");
    claim("the iterations of IDA are about constant in the number of parts, to a loose stop",
          F::mean(ida_last.loose) < 2 * F::mean(ida_first.loose),
          format("%.1f at %d parts, %.1f at %d", F::mean(ida_first.loose), fewest, F::mean(ida_last.loose),
                 most));
    claim("so they are to an accurate one",
          F::mean(ida_last.iterations) < 1.5 * F::mean(ida_first.iterations),
          format("%.0f at %d parts, %.0f at %d, to a gap of 1e-6", F::mean(ida_first.iterations), fewest,
                 F::mean(ida_last.iterations), most));
    claim("those of nonlinear CG grow", F::mean(ncg_last.loose) > 1.5 * F::mean(ncg_first.loose),
          format("%.1f at %d parts, %.1f at %d, to a loose stop", F::mean(ncg_first.loose), fewest,
                 F::mean(ncg_last.loose), most));
    claim("IDA's iterations vary less than those of CG, at equal accuracy",
          F::deviation(ida_first.iterations) < F::deviation(ncg_first.iterations) &&
              F::deviation(ida_last.iterations) < F::deviation(ncg_last.iterations),
          format("standard deviation %.1f against %.1f at %d parts, %.1f against %.1f at %d",
                 F::deviation(ida_first.iterations), F::deviation(ncg_first.iterations), fewest,
                 F::deviation(ida_last.iterations), F::deviation(ncg_last.iterations), most));
    claim("IDA takes less time than CG",
          median(ida_first.seconds) < median(ncg_first.seconds) &&
              median(ida_last.seconds) < median(ncg_last.seconds),
          format("median %.3g against %.3g us at %d parts, %.3g against %.3g at %d",
                 1e6 * median(ida_first.seconds), 1e6 * median(ncg_first.seconds), fewest,
                 1e6 * median(ida_last.seconds), 1e6 * median(ncg_last.seconds), most));
  };
  return {"scaling", cells_of(selection, measure), report};
}

}  // namespace asterism::bench
