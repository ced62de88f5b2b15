// Many small systems at once, on one thread.
#include <algorithm>
#include <asterism/solver/batch/batch_newton.hpp>
#include <asterism/solver/batch/simd.hpp>
#include <asterism/solver/batch/spring_batch.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <atomic>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "bars.hpp"

namespace asterism::bench {

namespace {

using Reference = SpringSystem<double, 2, 4>;
using Samples = std::vector<testing::RandomSystem<Reference>>;

// Guarantees the gap of the bars: at a minimum whose Hessian is positive definite, half of the squared Newton
// decrement is below this share of the energy.
constexpr double kTolerance = 1e-6;

constexpr double kNone = std::numeric_limits<double>::infinity();

/// How many times as fast as one solve after another a batch should be, with the instructions of a machine.
struct Goal {
  double bar = 0;  // 0: none
  double aim = 0;
};

Goal goal(Simd simd, bool is_double) {
  if (simd == Simd::Avx2 && is_double) return {2, 3};
  if (simd == Simd::Avx512 && is_double) return {2.75, 8};
  return {};
}

/// The relative excess of each energy over that of the nearest minimum, computed in double.
template <typename Batch>
std::vector<double> gaps(const Batch& batch, const Samples& systems) {
  Newton<Reference> newton;
  newton.options.tolerance = 1e-12;
  newton.options.align = false;  // to stay near this minimum, even if another is lower
  std::vector<double> result;
  for (int s = 0; s < batch.size(); ++s) {
    const Reference& system = systems[static_cast<std::size_t>(s)].system;
    Reference::Points x = batch.points(s);
    const double reached = energy(system, x);
    newton.solve(system, x);
    const double least = energy(system, x);
    result.push_back((reached - least) / std::max(least, std::numeric_limits<double>::min()));
  }
  return result;
}

template <typename Scalar>
void measure(Bars& bars, const Samples& systems, bool lit) {
  using Batch = SpringBatch<Scalar, 2, 4>;
  constexpr bool kDouble = std::is_same_v<Scalar, double>;
  Batch given(Topology<4>::full(), static_cast<int>(systems.size()));
  for (int s = 0; s < given.size(); ++s) {
    const auto& [system, start] = systems[static_cast<std::size_t>(s)];
    given.set(s, system, start);
  }
  double portable = kNone;
  for (const Simd simd : available_simd()) {
    BatchNewton<Batch> solver;
    solver.options.tolerance = kTolerance;
    solver.simd = simd;
    Batch batch = given;
    BatchSummary summary;
    double seconds = kNone, one_by_one = kNone;
    Newton<Reference> newton;
    newton.options.tolerance = kTolerance;
    // By the instructions of a machine that has no wider lanes: a solve that may be stopped has no others.
    const std::atomic<bool> stop = false;
    if (simd != Simd::Avx512) newton.options.stop = &stop;
    for (int repeat = 0; repeat < 7; ++repeat) {
      batch = given;
      const double before = cpu_seconds();
      summary = solver.solve(batch);
      seconds = std::min(seconds, cpu_seconds() - before);
      const double begin = cpu_seconds();
      for (const auto& [system, start] : systems) {
        auto x = start;
        newton.solve(system, x);
      }
      one_by_one = std::min(one_by_one, cpu_seconds() - begin);
    }
    const std::vector<double> gap = gaps(batch, systems);
    const std::string name = std::string("N=4 ") + (lit ? "LIT" : "TRACK") + " batch, " +
                             std::string(to_string(simd)) + (kDouble ? ", double" : ", float");
    bars.information(name, format("%.3g ns a system", 1e9 * seconds / batch.size()));
    const std::string ratio_name = "  against Newton one by one, double";
    const auto [bar, aim] = goal(simd, kDouble);
    if (bar > 0) {
      bars.times_faster(ratio_name, seconds / batch.size(), one_by_one / batch.size(), bar, aim);
    } else {
      bars.information(ratio_name, format("%.3g x", one_by_one / seconds));
    }
    if (simd == Simd::Portable) portable = seconds;
    if (simd == Simd::Avx512 && kDouble) {
      bars.times_faster("  against the portable lanes", seconds / batch.size(), portable / batch.size(), 2.25,
                        5);
    }
    const double most = percentile(gap, 0.999);
    bars.line("  gap, scalar, converged",
              format("99.9 %% %.1e, worst %.1e; %d; %.3f %%", most, *std::max_element(gap.begin(), gap.end()),
                     summary.by_scalar, 100.0 * summary.converged / batch.size()),
              "99.9 % <= 1e-6", "-", most <= 1e-6, most <= 1e-6);
  }
}

// Systems 1e6 px from the origin, where neighbouring floats are 0.06 px apart, against the same systems at
// the origin.
void far_from_the_origin(Bars& bars, const Samples& systems) {
  using Batch = SpringBatch<float, 2, 4>;
  constexpr double kOffset = 1e6;
  const auto count = static_cast<int>(systems.size());
  Batch near(Topology<4>::full(), count), far(Topology<4>::full(), count);
  for (int s = 0; s < count; ++s) {
    auto [system, start] = systems[static_cast<std::size_t>(s)];
    near.set(s, system, start);
    system.anchors.array() += kOffset;
    start.array() += kOffset;
    far.set(s, system, start);
  }
  BatchNewton<Batch> solver;
  solver.solve(near);
  solver.solve(far);
  double worst = 0;
  for (int s = 0; s < count; ++s) {
    worst = std::max(worst, (far.points(s).array() - kOffset - near.points(s).array()).abs().maxCoeff());
  }
  bars.at_most("N=4 TRACK batch, float, offset by 1e6 px, worst", "%.1e px", worst, 1e-5, 1e-5);
}

}  // namespace

void batch_bars(Bars& bars) {
  if (!bars.wanted("batch")) return;
  for (const testing::Kind kind : {testing::Kind::Lit, testing::Kind::Track}) {
    const auto systems = samples<Reference>(bars.quick() ? 10000 : 100000, Topology<4>::full(), kind);
    measure<double>(bars, systems, kind == testing::Kind::Lit);
    measure<float>(bars, systems, kind == testing::Kind::Lit);
    if (kind == testing::Kind::Track) far_from_the_origin(bars, systems);
  }
}

}  // namespace asterism::bench
