// Draws millions of samples: a separate source file, compiled with more optimisation.
#include "covariance_samples.hpp"

#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/testing/random_system.hpp>
#include <cmath>

namespace asterism::testing {

using Fixed2 = SpringSystem<double, 2, 4>;

Samples sample(const Fixed2& system, const Fixed2::Points& start, std::uint64_t seed, int count) {
  Rng rng(seed);
  const Eigen::Vector4d scale = 2.38 / std::sqrt(8.0) * node_stiffness(system).cwiseSqrt().cwiseInverse();
  Fixed2::Points x = start;
  double here = energy(system, x);
  Fixed2::Points sum = Fixed2::Points::Zero();
  Fixed2::Points squares = Fixed2::Points::Zero();
  int accepted = 0;
  for (int s = -count / 20; s < count; ++s) {  // burn-in first
    Fixed2::Points proposal = x;
    for (int i = 0; i < 4; ++i) {
      for (int d = 0; d < 2; ++d) {
        const double step = rng.normal();
        proposal(d, i) += scale[i] * step;
      }
    }
    const double there = energy(system, proposal);
    if (rng.uniform(0, 1) < std::exp(here - there)) {
      x = proposal;
      here = there;
      ++accepted;
    }
    if (s < 0) continue;
    sum += x - start;
    squares += (x - start).cwiseAbs2();
  }
  const Fixed2::Points variance = squares / count - (sum / count).cwiseAbs2();
  return {variance.colwise().sum().cwiseSqrt().transpose(), static_cast<double>(accepted) / count};
}

}  // namespace asterism::testing
