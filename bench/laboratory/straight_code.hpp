#pragma once

#include <utility>
#include <vector>

#include "to_gap.hpp"

namespace asterism::bench {

/// Times of `newton` and of a Levenberg-Marquardt method whose code a generator of derivatives could have
/// written for four fully linked nodes, by turns, to a relative gap of the energy.
std::pair<GapTimes, GapTimes> newton_and_straight_code(const std::vector<Problem>& problems,
                                                       double gap = 1e-6);

}  // namespace asterism::bench
