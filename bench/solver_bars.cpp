// The solver's bars: what it is measured by, against our own baseline and against Ceres, in one run on one
// thread.
//   asterism-solver-bars [--quick]
// One line a bar: its name, what was measured, the bar, and whether it is met. Ratios compare thread CPU time
// to the same relative energy gap above the minimum that each solver itself ends in.

#include <asterism/solver.hpp>

#ifdef ASTERISM_BENCH_CERES
#include <asterism/solver/ceres.hpp>
#endif

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "../tests/solver/random_system.hpp"

namespace {

using namespace asterism;
using asterism::testing::Kind;
using asterism::testing::RandomSystem;
using asterism::testing::Rng;

constexpr double kGap = 1e-6;

double cpu_seconds() {
  std::timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                   values.end());
  return values[values.size() / 2];
}

double percentile(std::vector<double> values, double p) {
  const auto at = static_cast<std::ptrdiff_t>(p * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + at, values.end());
  return values[static_cast<std::size_t>(at)];
}

template <typename System>
std::vector<RandomSystem<System>> samples(int count, const typename System::TopologyType& topology,
                                          Kind kind) {
  Rng rng(1);
  std::vector<RandomSystem<System>> result;
  for (int i = 0; i < count; ++i) result.push_back(testing::random_system<System>(rng, topology, kind));
  return result;
}

struct ToGap {
  double mean_seconds = 0;  // a solve, setup included
  double median_seconds = 0;
  double median_iterations = 0;
};

/// CPU time of a solver from the start of each system to kGap above its own minimum. The number of iterations
/// that this takes is found first, then exactly those are timed.
template <typename Solver, typename System>
ToGap to_gap(const std::vector<RandomSystem<System>>& systems, int repeats) {
  Solver solver;
  std::vector<double> iterations, seconds;
  for (const RandomSystem<System>& sample : systems) {
    const auto energy_after = [&](int count, double tolerance) {
      solver.options.max_iterations = count;
      solver.options.tolerance = tolerance;
      auto x = sample.start;
      return solver.solve(sample.system, x).final_energy;
    };
    const double target = (1 + kGap) * energy_after(100000, 1e-10);
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

int g_missed = 0;

void bar(const std::string& name, const std::string& measured, const std::string& wanted, bool met) {
  std::printf("%-44s %-40s %-26s %s\n", name.c_str(), measured.c_str(), wanted.c_str(),
              met ? "met" : "NOT MET");
  std::fflush(stdout);
  g_missed += !met;
}

std::string format(const char* pattern, auto... values) {
  char text[160];
  std::snprintf(text, sizeof text, pattern, values...);
  return text;
}

/// `times` faster than the baseline.
void ratio_bar(const std::string& name, double ours, double baseline, double times) {
  bar(name, format("%.1f x (%.3g us against %.3g us)", baseline / ours, 1e6 * ours, 1e6 * baseline),
      format(">= %g x", times), baseline / ours >= times);
}

void small_systems(bool quick) {
  using System = SpringSystem<double, 2, 4>;
  const int count = quick ? 200 : 2000;
  for (const Kind kind : {Kind::Lit, Kind::Track}) {
    const std::string name = kind == Kind::Lit ? "N=4 LIT" : "N=4 TRACK";
    const auto systems = samples<System>(count, System::TopologyType::full(), kind);
    const ToGap newton = to_gap<Newton<System>>(systems, 20), ida = to_gap<Ida<System>>(systems, 20);
    bar(name + " Newton", format("%.3g us mean", 1e6 * newton.mean_seconds),
        kind == Kind::Lit ? "about 0.9 us" : "about 0.5 us",
        newton.mean_seconds < (kind == Kind::Lit ? 1.0e-6 : 0.55e-6));
    ratio_bar(name + " Newton against Ida", newton.mean_seconds, ida.mean_seconds,
              kind == Kind::Lit ? 3 : 10);
#ifdef ASTERISM_BENCH_CERES
    using Ceres = reference::Ceres<System, reference::CeresMethod::LevenbergMarquardtDense>;
    const std::vector<RandomSystem<System>> few(systems.begin(), systems.begin() + 100);
    ratio_bar(name + " Newton against Ceres, dense LM", newton.median_seconds,
              to_gap<Ceres>(few, 3).median_seconds, kind == Kind::Lit ? 45 : 25);
#endif
  }
}

void dense_systems(bool quick) {
  using System = SpringSystem<double, 2>;
  struct Size {
    int nodes, count;
    double ida;
  };
  for (const Size& size : {Size{16, 60, 2}, {64, 10, 3}, {100, 6, 3}, {200, 3, 3.5}}) {
    if (quick && size.nodes > 64) break;
    const std::string name = format("N=%d LIT", size.nodes);
    const auto systems = samples<System>(size.count, System::TopologyType::full(size.nodes), Kind::Lit);
    const ToGap lbfgs = to_gap<Lbfgs<System>>(systems, 3), ida = to_gap<Ida<System>>(systems, 1);
    ratio_bar(name + " L-BFGS against Ida", lbfgs.median_seconds, ida.median_seconds, size.ida);
#ifdef ASTERISM_BENCH_CERES
    if (size.nodes > 64) continue;  // minutes a system
    using reference::CeresMethod;
    const std::vector<RandomSystem<System>> few(systems.begin(), systems.begin() + std::min(size.count, 5));
    const double best = std::min(
        {to_gap<reference::Ceres<System, CeresMethod::LevenbergMarquardtDense>>(few, 1).median_seconds,
         to_gap<reference::Ceres<System, CeresMethod::LevenbergMarquardtSparse>>(few, 1).median_seconds,
         to_gap<reference::Ceres<System, CeresMethod::NonlinearCg>>(few, 1).median_seconds});
    ratio_bar(name + " L-BFGS against the best of Ceres", lbfgs.median_seconds, best, 35);
#endif
  }
}

void weak_anchors(bool quick) {
  using System = SpringSystem<double, 2, 4>;
  for (const double weakness : {1e-4, 1e-8, 1e-12}) {
    auto systems = samples<System>(quick ? 200 : 1000, System::TopologyType::full(), Kind::Lit);
    std::vector<double> evaluations, gaps;
    for (auto& [system, start] : systems) {
      system.anchor_stiffness *= weakness;
      Newton<System> solver;
      auto x = start;
      const Summary summary = solver.solve(system, x);
      evaluations.push_back(summary.gradient_evaluations);
      solver.options.tolerance = 0;
      solver.options.max_iterations = 200;
      auto best = x;
      const double least = solver.solve(system, best).final_energy;
      gaps.push_back((summary.final_energy - least) / std::max(least, std::numeric_limits<double>::min()));
    }
    bar(format("N=4 LIT, anchors x %g, evaluations", weakness),
        format("median %.0f, 95 %% %.0f", median(evaluations), percentile(evaluations, 0.95)),
        "median <= 10, 95 % <= 30", median(evaluations) <= 10 && percentile(evaluations, 0.95) <= 30);
    bar(format("N=4 LIT, anchors x %g, relative gap", weakness), format("99 %% %.1e", percentile(gaps, 0.99)),
        "<= 1e-12", percentile(gaps, 0.99) <= 1e-12);
  }
}

/// Random systems with a defect each: no NaN, no energy increase, the tolerance kept; the same minimum as
/// Ida.
void robustness(bool quick) {
  using System = SpringSystem<double, 2, 4>;
  const int count = quick ? 10000 : 1000000;
  Rng rng(7);
  int bad = 0, converged = 0, plain = 0, same = 0;
  Newton<System> newton;
  Ida<System> ida;
  for (int i = 0; i < count; ++i) {
    auto [system, start] = testing::random_system<System>(rng, System::TopologyType::full(),
                                                          i % 2 == 0 ? Kind::Lit : Kind::Track);
    const int defect = i % 20;
    if (defect == 2) start.col(1) = start.col(0);
    if (defect == 4) system.anchors.col(1) = system.anchors.col(0);
    if (defect == 6) system.rest_length.setZero();
    if (defect == 8) start.row(1).setZero(), system.anchors.row(1).setZero();
    if (defect == 10) system.link_stiffness[0] = 1e14;
    if (defect == 12) system.anchor_stiffness *= 1e-12;
    if (defect == 14) system.link_stiffness.setZero();
    if (defect == 16) start.setZero(), system.anchors.setZero();
    auto x = start;
    const Summary summary = newton.solve(system, x);
    bad += !summary.usable() || !x.allFinite() ||
           !(summary.final_energy <= summary.initial_energy * (1 + 1e-12));
    converged += summary.status == Status::Converged;
    if (defect == 0 && plain < 10000) {
      auto by_ida = start;
      const double expected = ida.solve(system, by_ida).final_energy;
      ++plain;
      same += std::abs(summary.final_energy - expected) <= 1e-6 * expected;
    }
  }
  bar(format("%d random and degenerate systems", count), format("%d with NaN or a rise of energy", bad), "0",
      bad == 0);
  bar("converged to the tolerance", format("%.3f %%", 100.0 * converged / count), ">= 99.9 %",
      converged >= 0.999 * count);
  bar("the minimum of Ida (N=4 LIT)", format("%.2f %% of %d", 100.0 * same / plain, plain), ">= 99 %",
      same >= 0.99 * plain);
}

}  // namespace

int main(int argc, char** argv) {
  const bool quick = argc > 1 && std::strcmp(argv[1], "--quick") == 0;
  if (argc > 2 || (argc > 1 && !quick)) {
    std::fprintf(stderr, "usage: asterism-solver-bars [--quick]\n");
    return 2;
  }
  std::printf("%-44s %-40s %s\n", "bar", "measured", "wanted");
  small_systems(quick);
  dense_systems(quick);
  weak_anchors(quick);
  robustness(quick);
  std::printf("%d not met\n", g_missed);
  return 0;
}
