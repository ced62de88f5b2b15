// Large systems of nodes that are linked to their six nearest.
#include <sys/resource.h>

#include <asterism/testing/sparse_system.hpp>
#include <string>
#include <vector>

#include "bars.hpp"
#include "to_gap.hpp"

namespace asterism::bench {

namespace {

// The most memory that this process has had so far.
double peak_bytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return 1024.0 * static_cast<double>(usage.ru_maxrss);
}

}  // namespace

void sparse_bars(Bars& bars) {
  if (!bars.wanted("sparse")) return;
  struct Size {
    int nodes;
    const char* name;
    double seconds, aim;
  };
  for (const Size& size :
       {Size{10000, "1e4", 0.15, 0.075}, {100000, "1e5", 4, 2}, {1000000, "1e6", 120, 60}}) {
    if (bars.quick() && size.nodes > 100000) break;
    const std::string name = format("N=%s, 6 nearest, ", size.name);
    const std::vector<Problem> systems = {testing::sparse_system<System>(1, size.nodes)};
    const GapTimes schwarz = times_to_gap("schwarz", systems);
    bars.at_most(name + "Schwarz", "%.3g s", schwarz.median_seconds, size.seconds, size.aim);
    if (size.nodes > 10000) {
      // That of making the system included. Sizes ascend, so the peak is this one's.
      bars.at_most(name + "peak memory, a link", "%.0f bytes", peak_bytes() / systems[0].system.link_count(),
                   600, 300);
      continue;
    }
#ifdef ASTERISM_BENCH_CHOLMOD
    if (!bars.quick()) {
      bars.times_faster(name + "Schwarz against Ida, CHOLMOD", schwarz.median_seconds,
                        times_to_gap("ida-cholmod", systems).median_seconds, 10, 20);
    }
#endif
    auto weak = systems;
    weak[0].system.anchor_stiffness *= 1e-3;
    bars.at_most(name + "anchors x 1e-3, Schwarz", "%.3g s",
                 times_to_gap("schwarz-direct", weak).median_seconds, 0.76, 0.38);
  }
}

}  // namespace asterism::bench
