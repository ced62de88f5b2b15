#include "to_gap.hpp"

#include <cstdint>
#include <limits>
#include <memory>
#include <numeric>

namespace asterism::bench {

namespace {

/// Collects a solver's times over problems.
class Stopwatch {
 public:
  Stopwatch(const std::string& solver, const Problem& first)
      : runner_(solvers_named(solver).front().make(first.system.nodes())) {}

  void measure(const Problem& problem, double gap) {
    runner_->load(problem);
    const ToGap result = to_gap(*runner_, gap);
    seconds_.push_back(result.iterations >= 0 ? result.seconds : std::numeric_limits<double>::infinity());
  }

  GapTimes times() const {
    const double sum = std::accumulate(seconds_.begin(), seconds_.end(), 0.0);
    return {sum / static_cast<double>(seconds_.size()), median(seconds_)};
  }

 private:
  std::unique_ptr<Runner> runner_;
  std::vector<double> seconds_;
};

}  // namespace

GapTimes times_to_gap(const std::string& solver, const std::vector<Problem>& problems, double gap) {
  Stopwatch watch(solver, problems.front());
  for (const Problem& problem : problems) watch.measure(problem, gap);
  return watch.times();
}

std::pair<GapTimes, GapTimes> times_to_gap(const std::string& a, const std::string& b,
                                           const std::vector<Problem>& problems, double gap) {
  Stopwatch first(a, problems.front()), second(b, problems.front());
  for (const Problem& problem : problems) {
    first.measure(problem, gap);
    second.measure(problem, gap);
  }
  return {first.times(), second.times()};
}

std::vector<Problem> problems(testing::Kind kind, int nodes, int count) {
  std::vector<Problem> result;
  for (int index = 0; index < count; ++index) {
    result.push_back(
        testing::numbered_system<System>(kind, Topology<>::full(nodes), static_cast<std::uint64_t>(index)));
  }
  return result;
}

}  // namespace asterism::bench
