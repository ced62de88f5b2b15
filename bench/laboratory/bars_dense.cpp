// Fully connected systems of 16 to 200 nodes, and the distance to general optimisers from 2 to 1000 nodes.
#include <algorithm>
#include <cstddef>
#include <string>
#include <vector>

#include "bars.hpp"
#include "to_gap.hpp"

namespace asterism::bench {

namespace {

/// A solver of another package, its time, and that of ours on the same systems.
struct Other {
  std::string title;
  double seconds;
  double ours;
  double ratio() const { return seconds / ours; }
};

/// The solver nearest to ours in time among those that reach the problems and whose names start with one of
/// `prefixes`. Measured on `count` problems only, as some take minutes each.
Other nearest(const std::string& ours, const std::vector<std::string>& prefixes,
              const std::vector<Problem>& all, std::size_t count) {
  const std::vector<Problem> few(all.begin(),
                                 all.begin() + static_cast<std::ptrdiff_t>(std::min(all.size(), count)));
  Other best{"", 0, 0};
  for (const SolverEntry& entry : solvers()) {
    const bool wanted = std::any_of(prefixes.begin(), prefixes.end(), [&](const std::string& prefix) {
      return entry.name.starts_with(prefix);
    });
    if (!wanted || !entry.reaches(few.front().system)) continue;
    const auto [our_times, times] = times_to_gap(ours, entry.name, few);
    const Other other{entry.title, times.median_seconds, our_times.median_seconds};
    if (best.title.empty() || other.ratio() < best.ratio()) best = other;
  }
  return best;
}

void against(Bars& bars, const std::string& name, const Other& other, double bar, double aim) {
  if (!other.title.empty())
    bars.times_faster(name + " against " + other.title, other.ours, other.seconds, bar, aim);
}

}  // namespace

void dense_bars(Bars& bars) {
  if (!bars.wanted("dense")) return;
  struct Size {
    int nodes, count;
    double ida;
  };
  for (const Size& size : {Size{16, 200, 2}, {64, 40, 3}, {100, 20, 3}, {200, 10, 3.5}}) {
    if (bars.quick() && size.nodes > 64) break;
    const std::string name = format("N=%d LIT L-BFGS", size.nodes);
    const auto all = problems(testing::Kind::Lit, size.nodes, size.count);
    const auto [ida, lbfgs] = times_to_gap("ida", "lbfgs", all);
    against(bars, name, {"Ida", ida.median_seconds, lbfgs.median_seconds}, size.ida, size.ida);
    against(bars, name, nearest("lbfgs", {"liblbfgs"}, all, all.size()), 2.5, 3);
    against(bars, name, nearest("lbfgs", {"ceres"}, all, 5), 35, 35);
  }

  const std::vector<std::string> general = {"ncg", "liblbfgs", "ceres", "nlopt", "gsl", "eigen", "dlib"};
  for (const int nodes : {2, 4, 6, 9, 12, 16, 25, 36, 64, 100, 200, 400, 1000}) {
    if (bars.quick() && nodes > 36) break;
    const std::string ours = nodes <= 8 ? "newton" : "lbfgs";  // as Auto for these
    const auto all = problems(testing::Kind::Lit, nodes, std::max(2, 100 / nodes));
    against(bars, format("N=%d LIT ", nodes) + ours, nearest(ours, general, all, 5), 1, 3);
  }
}

}  // namespace asterism::bench
