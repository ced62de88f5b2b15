// Random systems, many with a defect: no NaN, no energy increase, the tolerance kept, the same minimum as
// Ida.
#include <Eigen/Eigenvalues>
#include <asterism/solver.hpp>
#include <cmath>

#include "bars.hpp"

namespace asterism::bench {

void robustness_bars(Bars& bars) {
  if (!bars.wanted("robustness")) return;
  using System = SpringSystem<double, 2, 4>;
  const int count = bars.quick() ? 10000 : 1000000;
  testing::Rng rng(7);
  int bad = 0, converged = 0, plain = 0, same = 0, saddles = 0, polished = 0, within = 0;
  Newton<System> newton, polish;
  polish.options.tolerance = 0;
  polish.options.max_iterations = 50;
  Ida<System> ida;
  for (int i = 0; i < count; ++i) {
    auto [system, start] = testing::random_system<System>(
        rng, System::TopologyType::full(), i % 2 == 0 ? testing::Kind::Lit : testing::Kind::Track);
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
    if (summary.status == Status::Converged && defect != 16) {
      const Eigen::SelfAdjointEigenSolver<DenseHessian<System>> modes(hessian(system, x),
                                                                      Eigen::EigenvaluesOnly);
      saddles += modes.eigenvalues()[0] < -1e-6 * modes.eigenvalues().tail<1>()[0];
    }
    if (i % 7 == 0 && summary.status == Status::Converged) {  // the gap to the minimum that it approaches
      auto further = x;
      const double least = polish.solve(system, further).final_energy;
      ++polished;
      within += summary.final_energy - least <= newton.options.tolerance * summary.final_energy;
    }
    if (defect == 0 && plain < 10000) {
      auto by_ida = start;
      const double expected = ida.solve(system, by_ida).final_energy;
      ++plain;
      same += std::abs(summary.final_energy - expected) <= 1e-6 * expected;
    }
  }
  bars.at_most(format("%d systems: NaN or a rise of energy", count), "%g", bad, 0, 0);
  bars.at_least("converged to the tolerance", "%.4f %%", 100.0 * converged / count, 99.9, 100);
  bars.at_least("relative gap within the tolerance, 1e-8", "%.4f %%", 100.0 * within / polished, 99.9, 100);
  bars.at_most("saddles reported as converged", "%g", saddles, 0, 0);
  bars.at_least("the minimum of Ida (N=4 LIT)", "%.2f %%", 100.0 * same / plain, 99, 99.9);
}

}  // namespace asterism::bench
