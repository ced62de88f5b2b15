#pragma once

// The lowest energy that many starts find, a reference for the tests of proofs.

#include <algorithm>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/testing/random_system.hpp>
#include <cstdint>
#include <limits>

namespace asterism::testing {

/// The lowest energy that Newton finds from `starts` starts: `start`, the anchors, and then `start` with each
/// coordinate displaced by up to `spread` characteristic lengths. Fixed nodes stay at `start`.
template <typename System>
double lowest_energy(const System& system, const typename System::Points& start, int starts,
                     std::uint64_t seed, double spread = 0.5) {
  Rng rng(seed);
  Newton<System> newton;
  const auto length = static_cast<double>(characteristic_length(system, start));
  double lowest = std::numeric_limits<double>::infinity();
  for (int s = 0; s < starts; ++s) {
    typename System::Points x = start;
    for (int i = 0; s > 0 && i < system.nodes(); ++i) {
      if (system.is_fixed(i)) continue;
      if (s == 1) x.col(i) = system.anchors.col(i);
      for (int d = 0; s > 1 && d < System::kDim; ++d)
        x(d, i) += static_cast<typename System::Scalar>(length * rng.uniform(-spread, spread));
    }
    const Summary summary = newton.solve(system, x);
    if (summary.usable()) lowest = std::min(lowest, summary.final_energy);
  }
  return lowest;
}

}  // namespace asterism::testing
