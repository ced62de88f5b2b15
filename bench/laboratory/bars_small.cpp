// One small system: four nodes in the plane, fixed size, double.

#include <algorithm>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/run/summary.hpp>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "bars.hpp"
#include "straight_code.hpp"
#include "to_gap.hpp"

namespace asterism::bench {

namespace {

// Ratios for information alone.
void without_targets(Bars& bars, const std::string& name, const std::vector<Problem>& all) {
  const auto ratio = [&](const std::string& against, const std::pair<GapTimes, GapTimes>& times) {
    bars.information(name + " against " + against + ", mean",
                     format("%.3g x", times.second.mean_seconds / times.first.mean_seconds));
  };
  ratio("Ida", times_to_gap("newton", "ida", all));
  ratio("straight code, LM", newton_and_straight_code(all));
#ifdef ASTERISM_BENCH_CERES_TINY
  ratio("Ceres TinySolver", times_to_gap("newton", "ceres-tiny", all));
#endif
}

void speed(Bars& bars) {
  for (const testing::Kind kind : {testing::Kind::Lit, testing::Kind::Track}) {
    const bool lit = kind == testing::Kind::Lit;
    const std::string name = lit ? "N=4 LIT Newton" : "N=4 TRACK Newton";
    const auto all = problems(kind, 4, bars.quick() ? 200 : 2000);
    const auto [newton, ida] = times_to_gap("newton", "ida", all);
    bars.information(name + ", to a gap of 1e-6, mean", format("%.3g us", 1e6 * newton.mean_seconds));
    bars.times_faster(name + " against Ida, mean", newton.mean_seconds, ida.mean_seconds, lit ? 3 : 10,
                      lit ? 3 : 10);
    const auto [alone, straight] = newton_and_straight_code(all);
    bars.times_faster(name + " against straight code, LM, mean", alone.mean_seconds, straight.mean_seconds, 1,
                      2);
#ifdef ASTERISM_BENCH_CERES
    const std::vector few(all.begin(), all.begin() + 100);
    bars.times_faster(name + " against Ceres dense LM, median", newton.median_seconds,
                      times_to_gap("ceres-dense", few).median_seconds, lit ? 45 : 25, lit ? 45 : 25);
#endif
#ifdef ASTERISM_BENCH_CERES_TINY
    const auto [ours, tiny] = times_to_gap("newton", "ceres-tiny", all);
    bars.times_faster(name + " against Ceres TinySolver, mean", ours.mean_seconds, tiny.mean_seconds,
                      lit ? 18 : 6, lit ? 25 : 10);
#endif
  }
  without_targets(bars, "N=4 ORIG Newton", problems(testing::Kind::Orig, 4, bars.quick() ? 200 : 2000));
}

template <typename System>
void weak_anchors(Bars& bars, const std::string& name, int nodes, bool is_bar) {
  for (const double weakness : {1e-4, 1e-6, 1e-8, 1e-10, 1e-12}) {
    auto systems =
        samples<System>(bars.quick() ? 200 : 1000, System::TopologyType::full(nodes), testing::Kind::Lit);
    std::vector<double> evaluations, gaps;
    for (auto& [system, start] : systems) {
      system.anchor_stiffness *= weakness;
      Newton<System> solver;
      solver.options.tolerance = 1e-12;
      auto x = start;
      const Summary summary = solver.solve(system, x);
      evaluations.push_back(summary.gradient_evaluations);
      solver.options.tolerance = 0;
      solver.options.max_iterations = 200;
      auto best = x;
      const double least = solver.solve(system, best).final_energy;
      gaps.push_back((summary.final_energy - least) / std::max(least, std::numeric_limits<double>::min()));
    }
    const double half = median(evaluations), tail = percentile(evaluations, 0.95);
    const double gap = percentile(gaps, 0.99);
    const auto verdict = [&](const std::string& what, const std::string& measured, const std::string& wanted,
                             bool met) {
      bars.line(name + format(", anchors x %g, ", weakness) + what, measured, is_bar ? wanted : "-",
                is_bar ? "-" : wanted, met || !is_bar, met);
    };
    verdict("evaluations", format("median %.0f, 95 %% %.0f", half, tail), "10, 30", half <= 10 && tail <= 30);
    verdict("gap", format("99 %% %.1e", gap), "<= 1e-12", gap <= 1e-12);
  }
}

}  // namespace

void small_bars(Bars& bars) {
  if (!bars.wanted("small")) return;
  speed(bars);
  weak_anchors<SpringSystem<double, 2, 4>>(bars, "N=4", 4, true);
  weak_anchors<SpringSystem<double, 2>>(bars, "N=16", 16, false);
  weak_anchors<SpringSystem<double, 3, 4>>(bars, "N=4, 3-D", 4, false);
}

}  // namespace asterism::bench
