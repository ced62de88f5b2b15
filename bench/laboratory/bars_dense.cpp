// Fully connected systems of 16 to 200 nodes, and the distance to general optimisers from 2 to 1000 nodes.
#include <algorithm>
#include <cstddef>
#include <iterator>
#include <limits>
#include <string>
#include <utility>
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

/// Solvers of other packages, compared at ascending sizes.
class Others {
 public:
  /// Those whose names start with one of `prefixes`.
  explicit Others(const std::vector<std::string>& prefixes) {
    std::copy_if(
        solvers().begin(), solvers().end(), std::back_inserter(entries_), [&](const SolverEntry& entry) {
          return std::any_of(prefixes.begin(), prefixes.end(),
                             [&](const std::string& prefix) { return entry.name.starts_with(prefix); });
        });
  }

  /// The one nearest to ours in time among those that reach the problems. From kPruned nodes on, where some
  /// take minutes, those that take more than kFarOff times as long as the nearest for the first problem are
  /// left out for the others, and at the sizes that follow.
  Other nearest(const std::string& ours, const std::vector<Problem>& problems) {
    if (problems.front().system.nodes() >= kPruned) {
      const std::vector<Other> others = measured(ours, {problems.front()});
      double least = std::numeric_limits<double>::infinity();
      for (const Other& other : others) least = std::min(least, other.ratio());
      std::erase_if(entries_, [&](const SolverEntry& entry) {
        return std::none_of(others.begin(), others.end(), [&](const Other& other) {
          return other.title == entry.title && other.ratio() <= kFarOff * least;
        });
      });
    }
    const std::vector<Other> others = measured(ours, problems);
    const auto best = std::min_element(others.begin(), others.end(),
                                       [](const Other& a, const Other& b) { return a.ratio() < b.ratio(); });
    return best == others.end() ? Other{"", 0, 0} : *best;
  }

 private:
  static constexpr int kPruned = 36;
  static constexpr double kFarOff = 4;

  std::vector<Other> measured(const std::string& ours, const std::vector<Problem>& problems) const {
    std::vector<Other> result;
    for (const SolverEntry& entry : entries_) {
      if (!entry.reaches(problems.front().system)) continue;
      const auto [our_times, times] = times_to_gap(ours, entry.name, problems);
      result.push_back({entry.title, times.median_seconds, our_times.median_seconds});
    }
    return result;
  }

  std::vector<SolverEntry> entries_;
};

std::vector<Problem> first(const std::vector<Problem>& all, std::size_t count) {
  return {all.begin(), all.begin() + static_cast<std::ptrdiff_t>(std::min(all.size(), count))};
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
  Others lbfgs_of_others({"liblbfgs"}), ceres({"ceres"});
  for (const Size& size : {Size{16, 200, 2}, {64, 40, 3}, {100, 20, 3}, {200, 10, 3.5}}) {
    if (bars.quick() && size.nodes > 64) break;
    const std::string name = format("N=%d LIT L-BFGS", size.nodes);
    const auto all = problems(testing::Kind::Lit, size.nodes, size.count);
    const auto [ida, lbfgs] = times_to_gap("ida", "lbfgs", all);
    against(bars, name, {"Ida", ida.median_seconds, lbfgs.median_seconds}, size.ida, size.ida);
    against(bars, name, lbfgs_of_others.nearest("lbfgs", all), 2.5, 3);
    if (bars.large() || size.nodes <= 64) against(bars, name, ceres.nearest("lbfgs", first(all, 5)), 35, 35);
  }

  Others general({"ncg", "liblbfgs", "ceres", "nlopt", "gsl", "eigen", "dlib"});
  for (const int nodes : {2, 4, 6, 9, 12, 16, 25, 36, 64, 100, 200, 400, 1000}) {
    if ((bars.quick() && nodes > 36) || (!bars.large() && nodes > 400)) break;
    const std::string ours = nodes <= 12 ? "newton" : "lbfgs";  // as Auto for these
    const auto some = problems(testing::Kind::Lit, nodes, std::clamp(100 / nodes, 2, 5));
    against(bars, format("N=%d LIT ", nodes) + ours, general.nearest(ours, some), 1, 3);
  }
}

}  // namespace asterism::bench
