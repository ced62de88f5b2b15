#pragma once

#include <string>
#include <utility>
#include <vector>

#include "laboratory.hpp"

namespace asterism::bench {

struct GapTimes {
  double mean_seconds = 0;  // per solve, setup included
  double median_seconds = 0;
};

/// CPU time of a solver to a relative energy gap above its own minimum, over problems; a problem in which it
/// does not reach the gap counts as infinite.
GapTimes times_to_gap(const std::string& solver, const std::vector<Problem>& problems, double gap = 1e-6);

/// The same for two solvers, problem by problem, so that drifts of the machine's speed affect both alike.
std::pair<GapTimes, GapTimes> times_to_gap(const std::string& a, const std::string& b,
                                           const std::vector<Problem>& problems, double gap = 1e-6);

/// `count` problems of a kind, fully connected.
std::vector<Problem> problems(testing::Kind kind, int nodes, int count);

}  // namespace asterism::bench
