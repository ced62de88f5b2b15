#pragma once

#include <string>
#include <utility>
#include <vector>

#include "laboratory.hpp"

namespace asterism::bench {

struct GapTimes {
  double mean_seconds = 0;  // a solve, setup included
  double median_seconds = 0;
};

/// CPU time of a solver to a relative energy gap above its own minimum, over problems; infinite where it does
/// not arrive at one of them.
GapTimes times_to_gap(const std::string& solver, const std::vector<Problem>& problems, double gap = 1e-6);

/// The same for two solvers, problem by problem, so that a machine whose speed drifts is as fast for both.
std::pair<GapTimes, GapTimes> times_to_gap(const std::string& a, const std::string& b,
                                           const std::vector<Problem>& problems, double gap = 1e-6);

/// `count` problems of a kind, fully connected.
std::vector<Problem> problems(testing::Kind kind, int nodes, int count);

}  // namespace asterism::bench
