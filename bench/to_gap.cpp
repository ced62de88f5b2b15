#include "to_gap.hpp"

#include <cstdint>
#include <limits>
#include <numeric>

namespace asterism::bench {

GapTimes times_to_gap(const std::string& solver, const std::vector<Problem>& problems, double gap) {
  const auto runner = solvers_named(solver).front().make(problems.front().system.nodes());
  std::vector<double> seconds;
  for (const Problem& problem : problems) {
    runner->load(problem);
    const ToGap result = to_gap(*runner, gap);
    seconds.push_back(result.iterations >= 0 ? result.seconds : std::numeric_limits<double>::infinity());
  }
  const double sum = std::accumulate(seconds.begin(), seconds.end(), 0.0);
  return {sum / static_cast<double>(seconds.size()), median(seconds)};
}

std::vector<Problem> problems(Kind kind, int nodes, int count) {
  std::vector<Problem> result;
  for (int index = 0; index < count; ++index) {
    result.push_back(
        numbered_system<System>(kind, Topology<>::full(nodes), static_cast<std::uint64_t>(index)));
  }
  return result;
}

}  // namespace asterism::bench
