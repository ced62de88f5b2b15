#pragma once

// Newton's method, damped where it has to be, for the energy of a path.

#include <atomic>

#include "path_chain.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {
namespace ranges {

template <int K>
class PathDescent {
 public:
  /// Ends once *stop is true, if it is given.
  explicit PathDescent(const std::atomic<bool>* stop = nullptr) : stop_(stop) {}

  bool stopped() const { return stop_ != nullptr && stop_->load(std::memory_order_relaxed); }
  /// Minimises the chain's energy from where it is. Returns whether it has converged.
  bool run(PathChain<K>& chain, double bound, int max_iterations) {
    damping_ = 0;
    PathCurvature curvature = PathCurvature::Convex;
    double energy = chain.energy(bound);
    for (int i = 0; i < max_iterations && std::isfinite(energy) && !stopped(); ++i) {
      const double decrement = step(chain, bound, curvature, energy);
      if (decrement < 0) continue;  // no step; damping has grown
      if (decrement < 1e-3 * (1 + energy)) curvature = PathCurvature::True;
      if (damping_ == 0 && used_ == PathCurvature::True && decrement < 1e-13 * (1 + energy)) {
        finish(chain, bound);
        return true;
      }
      if (used_ == PathCurvature::Convex && curvature == PathCurvature::True &&
          decrement < 1e-20 * (1 + energy))
        return true;
      if (damping_ > 1e12) return decrement < 1e-9 * (1 + energy);
    }
    return false;
  }

  /// From least squares to the loss of the bound, a step at each stage (Blake and Zisserman's graduated
  /// non-convexity, with the stages of Yang et al., IEEE Robotics and Automation Letters 5(2), 2020).
  void graduate(PathChain<K>& chain, const PathTerms& terms, double bound) {
    if (bound == std::numeric_limits<double>::infinity()) return;
    double largest = 0;
    for (std::size_t i = 0, count = chain.range_count(); i < count; ++i) {
      const double e = chain.difference(terms.ranges[i]).norm() - terms.ranges[i].length;
      largest = std::max(largest, terms.ranges[i].information * e * e);
    }
    damping_ = 0;
    for (double stage = 2 * largest; stage > bound && std::isfinite(stage) && !stopped(); stage /= 2) {
      double energy = chain.energy(stage);
      for (int tries = 0; tries < 5 && step(chain, stage, PathCurvature::Convex, energy) < 0; ++tries) {
      }
    }
  }

  int iterations() const { return iterations_; }

 private:
  /// Half the slope along the step, or -1 if none was taken.
  double step(PathChain<K>& chain, double bound, PathCurvature curvature, double& energy) {
    if (!factorize(chain, bound, curvature)) return -1;
    const double decrement = direction(chain);
    old_ = chain.x;
    old_beacons_ = chain.beacons;
    const double old_scale = chain.scale;
    chain.move(step_, border_step_);
    const double next = chain.energy(bound);
    if (next <= energy + 1e-12 * (1 + std::abs(energy))) {
      energy = next;
      damping_ = damping_ < 1e-8 ? 0 : damping_ / 10;
      return decrement;
    }
    chain.x = old_;
    chain.beacons = old_beacons_;
    chain.scale = old_scale;
    damping_ = std::max(1e-7, 10 * damping_);
    return -1;
  }

  bool factorize(PathChain<K>& chain, double bound, PathCurvature curvature) {
    for (;;) {
      ++iterations_;
      used_ = curvature;
      chain.assemble(curvature, bound);
      if (damping_ > 0) chain.damp(damping_);
      if (chain.factorize()) return true;
      if (curvature == PathCurvature::Convex) break;
      curvature = PathCurvature::Convex;
    }
    damping_ = std::max(1e-10, 10 * damping_);
    return false;
  }

  double direction(PathChain<K>& chain) {
    step_ = chain.gradient;
    border_step_ = chain.border_gradient;
    chain.solve(step_, border_step_);
    double slope = chain.border_gradient.dot(border_step_);
    for (std::size_t k = 0; k < chain.nodes(); ++k) slope += chain.gradient[k].dot(step_[k]);
    return slope / 2;
  }
  /// Where the energy's digits are used up, a last step by the gradient's.
  void finish(PathChain<K>& chain, double bound) {
    if (!factorize(chain, bound, PathCurvature::True) || used_ != PathCurvature::True) return;
    direction(chain);
    chain.move(step_, border_step_);
  }

  const std::atomic<bool>* stop_;
  std::vector<typename PathChain<K>::Point> step_, old_, old_beacons_;
  Eigen::VectorXd border_step_;
  PathCurvature used_ = PathCurvature::Convex;
  double damping_ = 0;
  int iterations_ = 0;
};

}  // namespace ranges
}  // namespace ASTERISM_ABI
}  // namespace asterism
