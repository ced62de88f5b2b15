// Levenberg-Marquardt of straight code, as a generator of derivatives (SymForce, wrenfold) would write it for
// four nodes: residuals, the normal equations and their factors without loops, indices or allocation.
#include "straight_code.hpp"

#include <algorithm>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/session.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <cmath>
#include <limits>
#include <memory>
#include <numeric>
#include <string_view>
#include <utility>
#include <vector>

#include "laboratory.hpp"

namespace asterism::bench {
namespace {

template <int k>
struct Index {
  constexpr operator int() const { return k; }
};

template <int kFrom, int kTo, typename F>
[[gnu::always_inline]] inline void unroll(F&& f) {
  if constexpr (kFrom < kTo) {
    f(Index<kFrom>());
    unroll<kFrom + 1, kTo>(f);
  }
}

class StraightCode {
 public:
  using Points = FourNodes::Points;

  SolverOptions options;

  static constexpr std::string_view name() { return "Levenberg-Marquardt, straight code"; }

  Summary solve(const FourNodes& given, Points& x) {
    return session_.run(name(), options, given, x, [&](const FourNodes& system, Summary& summary) {
      if (session_.done(x, session_.gradient(), 0)) return Status::Converged;
      if (options.max_iterations == 0) return Status::MaxIterations;
      if (system.link_count() != kLinks || system.fixed_count() > 0) return Status::InvalidInput;
      NormalEquations at_x, at_trial;
      linearise(system, x, at_x);
      ++summary.gradient_evaluations;
      // Nielsen's rule for the damping, as in TinySolver, relative to the diagonal.
      double damping = kFirstDamping, growth = 2;
      Points trial;
      for (int iteration = 1;; ++iteration) {
        const double promised = step(at_x, damping, x, trial);
        linearise(system, trial, at_trial);
        summary.iterations = iteration;
        ++summary.linear_solves;
        ++summary.gradient_evaluations;
        if (trial == x) return Status::NoProgress;
        const double fall = at_x.twice - at_trial.twice;
        if (fall > 0 && promised > 0) {
          const double excess = 2 * fall / promised - 1;
          damping *= std::max(1.0 / 3, 1 - excess * excess * excess);
          growth = 2;
          x = trial;
          std::swap(at_x, at_trial);
          if (session_.done(x, at_x.gradient, iteration)) return Status::Converged;
        } else {
          damping *= growth;
          growth *= 2;
        }
        if (iteration >= options.max_iterations) return Status::MaxIterations;
      }
    });
  }

 private:
  static constexpr int kNodes = FourNodes::kNodes;
  static constexpr int kSize = 2 * kNodes;
  static constexpr int kLinks = kNodes * (kNodes - 1) / 2;
  // Of 1e-6, 1e-4, 0.01, 0.1 and 1 the best for 200 random and 200 tracker-like systems together.
  static constexpr double kFirstDamping = 0.01;

  struct NormalEquations {
    double h[kSize][kSize];  // J^T J, on and below the diagonal
    Points gradient;
    double twice;  // the energy
  };

  [[gnu::always_inline]] static void linearise(const FourNodes& system, const Points& x, NormalEquations& n) {
    const double* p = x.data();
    const double* a = system.anchors.data();
    double* g = n.gradient.data();
    double twice = 0;
    unroll<0, kNodes>([&](auto i) {
      const double k = system.anchor_stiffness[i];
      const double dx = p[2 * i] - a[2 * i], dy = p[2 * i + 1] - a[2 * i + 1];
      g[2 * i] = k * dx;
      g[2 * i + 1] = k * dy;
      twice += k * (dx * dx + dy * dy);
      n.h[2 * i][2 * i] = n.h[2 * i + 1][2 * i + 1] = k;
      n.h[2 * i + 1][2 * i] = 0;
    });
    unroll<0, kNodes>([&](auto i) {
      unroll<i + 1, kNodes>([&](auto j) {
        constexpr int l = i * kNodes - i * (i + 1) / 2 + j - i - 1;
        const double k = system.link_stiffness[l], mu = system.rest_length[l];
        const double dx = p[2 * i] - p[2 * j], dy = p[2 * i + 1] - p[2 * j + 1];
        const double r = std::sqrt(dx * dx + dy * dy);
        const double inverse = r > 0 ? 1 / r : 0;
        const double ux = dx * inverse, uy = dy * inverse;
        const double pull = k * (r - mu);
        twice += pull * (r - mu);
        g[2 * i] += pull * ux;
        g[2 * i + 1] += pull * uy;
        g[2 * j] -= pull * ux;
        g[2 * j + 1] -= pull * uy;
        const double xx = k * ux * ux, xy = k * ux * uy, yy = k * uy * uy;
        n.h[2 * i][2 * i] += xx;
        n.h[2 * i + 1][2 * i] += xy;
        n.h[2 * i + 1][2 * i + 1] += yy;
        n.h[2 * j][2 * j] += xx;
        n.h[2 * j + 1][2 * j] += xy;
        n.h[2 * j + 1][2 * j + 1] += yy;
        n.h[2 * j][2 * i] = -xx;
        n.h[2 * j + 1][2 * i] = n.h[2 * j][2 * i + 1] = -xy;
        n.h[2 * j + 1][2 * i + 1] = -yy;
      });
    });
    n.twice = twice;
  }

  /// trial = x - (J^T J + damping D)^-1 g with the diagonal D of J^T J. Returns twice the fall of the energy
  /// that the linear model promises.
  [[gnu::always_inline]] static double step(const NormalEquations& n, double damping, const Points& x,
                                            Points& trial) {
    double f[kSize][kSize], inverse[kSize], y[kSize], diagonal[kSize];
    unroll<0, kSize>([&](auto c) {
      y[c] = n.gradient.data()[c];
      unroll<0, c>([&](auto d) { f[c][d] = n.h[c][d]; });
      diagonal[c] = n.h[c][c];
      f[c][c] = diagonal[c] * (1 + damping);
    });
    unroll<0, kSize>([&](auto c) {
      inverse[c] = 1 / f[c][c];
      unroll<c + 1, kSize>([&](auto j) {
        const double factor = f[j][c] * inverse[c];
        unroll<j, kSize>([&](auto i) { f[i][j] -= factor * f[i][c]; });
        y[j] -= factor * y[c];
        f[c][j] = factor;
      });
    });
    double promised = 0;
    unroll<0, kSize>([&](auto back) {
      constexpr int c = kSize - 1 - back;
      double value = y[c] * inverse[c];
      unroll<c + 1, kSize>([&](auto i) { value -= f[c][i] * y[i]; });
      y[c] = value;
      // p^T (g + damping D p), which is what the model promises
      promised += value * (n.gradient.data()[c] + damping * diagonal[c] * value);
      trial.data()[c] = x.data()[c] - value;
    });
    return promised;
  }

  Session<FourNodes> session_;
};

}  // namespace

std::pair<GapTimes, GapTimes> newton_and_straight_code(const std::vector<Problem>& problems, double gap) {
  const std::unique_ptr<Runner> newton = solvers_named("newton").front().make(FourNodes::kNodes);
  RunnerOf<FourNodes> straight(AnySolver<FourNodes>(std::in_place_type<StraightCode>));
  std::vector<double> seconds[2];
  for (const Problem& problem : problems) {
    for (const int which : {0, 1}) {
      Runner& runner = which == 0 ? *newton : straight;
      runner.load(problem);
      const ToGap result = to_gap(runner, gap);
      seconds[which].push_back(result.iterations >= 0 ? result.seconds
                                                      : std::numeric_limits<double>::infinity());
    }
  }
  const auto times = [](const std::vector<double>& of) {
    const double sum = std::accumulate(of.begin(), of.end(), 0.0);
    return GapTimes{sum / static_cast<double>(of.size()), median(of)};
  };
  return {times(seconds[0]), times(seconds[1])};
}

}  // namespace asterism::bench
