// Fully connected systems of 16 to 200 nodes, and no general optimiser near from 2 to 1000.
#include <asterism/solver.hpp>

#ifdef ASTERISM_BENCH_CERES
#include <asterism/solver/ceres.hpp>
#endif
#ifdef ASTERISM_BENCH_LBFGS
#include <asterism/solver/liblbfgs.hpp>
#endif

#include <algorithm>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "bars.hpp"
#include "to_gap.hpp"

namespace asterism::bench {

namespace {

using System = SpringSystem<double, 2>;
using Samples = std::vector<RandomSystem<System>>;

Samples first(const Samples& systems, std::size_t count) {
  return {systems.begin(), systems.begin() + static_cast<std::ptrdiff_t>(std::min(systems.size(), count))};
}

/// Someone else's solver, its time, and that of ours on the same systems.
struct Other {
  std::string name;
  double seconds;
  double ours;
};

#ifdef ASTERISM_BENCH_CERES
/// The fastest configuration of Ceres; each takes up to minutes a system.
template <typename Ours>
Other best_of_ceres(const Samples& systems) {
  using reference::CeresMethod;
  const Samples few = first(systems, 5);
  const double ours = to_gap<Ours>(few, 5).median_seconds;
  std::vector<std::pair<double, std::string>> times;
  const auto add = [&](auto solver) {
    times.emplace_back(to_gap<decltype(solver)>(few, 1).median_seconds, solver.name());
  };
  if (systems.front().system.nodes() <= 64) {  // dense Jacobians of 20000 x 400 are not for them
    add(reference::Ceres<System, CeresMethod::LevenbergMarquardtDense>());
  }
  add(reference::Ceres<System, CeresMethod::LevenbergMarquardtSparse>());
  add(reference::Ceres<System, CeresMethod::Lbfgs>());
  add(reference::Ceres<System, CeresMethod::NonlinearCg>());
  const auto best = *std::min_element(times.begin(), times.end());
  return {best.second, best.first, ours};
}
#endif

/// L-BFGS, nonlinear CG and, where they are there, liblbfgs and Ceres against the library's own choice.
template <typename Ours>
void general_bar(Bars& bars, int nodes, int count) {
  const Samples systems = samples<System>(count, Topology<>::full(nodes), Kind::Lit);
  const int repeats = std::max(1, 2000 / (nodes * nodes));
  const double ours = to_gap<Ours>(systems, repeats).median_seconds;
  std::vector<Other> others;
  const auto add = [&](auto solver) {
    others.push_back(
        {std::string(solver.name()), to_gap<decltype(solver)>(systems, repeats).median_seconds, ours});
  };
  add(NonlinearCg<System>());
#ifdef ASTERISM_BENCH_LBFGS
  add(reference::Liblbfgs<System>());
#endif
#ifdef ASTERISM_BENCH_CERES
  if (nodes <= 16) others.push_back(best_of_ceres<Ours>(systems));
#endif
  const Other& best = *std::min_element(others.begin(), others.end(), [](const Other& a, const Other& b) {
    return a.seconds / a.ours < b.seconds / b.ours;
  });
  bars.times_faster(format("N=%d LIT ", nodes) + std::string(Ours::name()) + " against " + best.name,
                    best.ours, best.seconds, 1, 3);
}

}  // namespace

void dense_bars(Bars& bars) {
  if (!bars.wanted("dense")) return;
  using Ours = Lbfgs<System>;
  struct Size {
    int nodes, count;
    double ida;
  };
  for (const Size& size : {Size{16, 60, 2}, {64, 10, 3}, {100, 6, 3}, {200, 3, 3.5}}) {
    if (bars.quick() && size.nodes > 64) break;
    const std::string name = format("N=%d LIT L-BFGS", size.nodes);
    const Samples systems = samples<System>(size.count, Topology<>::full(size.nodes), Kind::Lit);
    const double ours = to_gap<Ours>(systems, 5).median_seconds;
    bars.times_faster(name + " against Ida", ours, to_gap<Ida<System>>(systems, 1).median_seconds, size.ida,
                      size.ida);
#ifdef ASTERISM_BENCH_LBFGS
    bars.times_faster(name + " against liblbfgs", ours,
                      to_gap<reference::Liblbfgs<System>>(systems, 3).median_seconds, 2.5, 3);
#endif
#ifdef ASTERISM_BENCH_CERES
    const Other ceres = best_of_ceres<Ours>(systems);
    bars.times_faster(name + " against " + ceres.name, ceres.ours, ceres.seconds, 35, 35);
#endif
  }

  for (const int nodes : {2, 4, 6, 9}) general_bar<Newton<System>>(bars, nodes, 100);
  for (const int nodes : {12, 16, 25, 36}) general_bar<Ours>(bars, nodes, 40);
  if (bars.quick()) return;
  for (const int nodes : {64, 100, 200}) general_bar<Ours>(bars, nodes, 10);
  for (const int nodes : {400, 1000}) general_bar<Ours>(bars, nodes, 2);
}

}  // namespace asterism::bench
