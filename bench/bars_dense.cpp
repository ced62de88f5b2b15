// Fully connected systems of 16 to 200 nodes.
#include <asterism/solver.hpp>

#ifdef ASTERISM_BENCH_CERES
#include <asterism/solver/ceres.hpp>
#endif

#include <algorithm>
#include <string>
#include <vector>

#include "bars.hpp"
#include "to_gap.hpp"

namespace asterism::bench {

void dense_bars(Bars& bars) {
  if (!bars.wanted("dense")) return;
  using System = SpringSystem<double, 2>;
  struct Size {
    int nodes, count;
    double ida;
  };
  for (const Size& size : {Size{16, 60, 2}, {64, 10, 3}, {100, 6, 3}, {200, 3, 3.5}}) {
    if (bars.quick() && size.nodes > 64) break;
    const std::string name = format("N=%d LIT L-BFGS", size.nodes);
    const auto systems =
        samples<System>(size.count, System::TopologyType::full(size.nodes), testing::Kind::Lit);
    const ToGap lbfgs = to_gap<Lbfgs<System>>(systems, 3), ida = to_gap<Ida<System>>(systems, 1);
    bars.times_faster(name + " against Ida", lbfgs.median_seconds, ida.median_seconds, size.ida, size.ida);
#ifdef ASTERISM_BENCH_CERES
    if (size.nodes > 64) continue;  // minutes a system
    using reference::CeresMethod;
    const std::vector few(systems.begin(), systems.begin() + std::min(size.count, 5));
    const double best = std::min(
        {to_gap<reference::Ceres<System, CeresMethod::LevenbergMarquardtDense>>(few, 1).median_seconds,
         to_gap<reference::Ceres<System, CeresMethod::LevenbergMarquardtSparse>>(few, 1).median_seconds,
         to_gap<reference::Ceres<System, CeresMethod::NonlinearCg>>(few, 1).median_seconds});
    bars.times_faster(name + " against the best of Ceres", lbfgs.median_seconds, best, 35, 35);
#endif
  }
}

}  // namespace asterism::bench
