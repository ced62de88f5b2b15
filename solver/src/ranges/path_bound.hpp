#pragma once

// A lower bound of the least squares energy of a path: docs/locate.md.

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <vector>

#include "path_chain.hpp"
#include "path_descent.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {
namespace ranges {

/// Each step and each range, weight k and rest length r, is at least as large as a quadratic function of its
/// difference, which it touches at one length. If the sum of these functions has a minimum, that is a bound.
/// The lengths are those of the path in the plane, and then those of minima of the same energy with two
/// complex coordinates for each position, where the bound is larger (the relaxation of Burer and Monteiro).
class PathBound {
 public:
  PathBound(const PathTerms& terms, const PathChain<2>& minimum, double bound, const std::atomic<bool>* stop)
      : terms_(terms), quadratic_(terms), lifted_(terms), descent_(stop) {
    quadratic_.x = minimum.x;
    quadratic_.beacons = minimum.beacons;
    weights_.resize(terms.ranges.size());
    for (std::size_t i = 0; i < weights_.size(); ++i) {
      const PathRange& range = terms.ranges[i];
      const double e = minimum.difference(range).norm() - range.length;
      weights_[i] = range_slope(e, range.information, bound).weight;
      cost_ += range_energy(e, range.information, bound) - 0.5 * weights_[i] * range.information * e * e;
    }
  }

  /// is_free: no term sees a shift of everything.
  double run(bool is_free, double energy) {
    is_free_ = is_free;
    double best = std::max(0.0, cost_);
    const double enough = energy - 1e-6 * (1 + std::abs(energy));
    best = std::max(best, bound_at(quadratic_));
    if (best >= enough) return std::min(best, energy);
    lift();
    double last = -std::numeric_limits<double>::infinity();
    for (int round = 0; round < 5 && best < enough && !descent_.stopped(); ++round) {
      const bool is_minimum = descent_.run(lifted_, 0, 8);
      const double bound = bound_at(lifted_);
      best = std::max(best, bound);
      if (is_minimum || (round > 1 && bound < last + 0.01 * energy)) break;
      last = bound;
    }
    return std::min(best, energy);
  }
  int iterations() const { return descent_.iterations(); }

 private:
  /// The best bound of those at the chain's lengths, where weights are raised as little as it takes.
  template <int K>
  double bound_at(const PathChain<K>& chain) {
    lengths_.clear();
    for (std::size_t k = 0; k + 1 < chain.nodes(); ++k)
      lengths_.push_back((chain.x[k + 1] - chain.x[k]).norm());
    for (const PathRange& range : terms_.ranges) lengths_.push_back(chain.difference(range).norm());
    double low = 1e-10, high = 0, best = -std::numeric_limits<double>::infinity();
    for (double shift = 1e-9; shift < 0.1; shift *= 10) {
      const double bound = bound_with(shift);
      if (!std::isnan(bound)) {
        best = bound;
        high = shift;
        break;
      }
      low = shift;
    }
    for (int i = 0; i < 4 && high > 1e-9; ++i) {
      const double shift = std::sqrt(low * high), bound = bound_with(shift);
      if (std::isnan(bound)) {
        low = shift;
      } else {
        best = std::max(best, bound);
        high = shift;
      }
    }
    return best;
  }

  /// For every length |y|, k/2 (|y| - r)^2 >= b/2 |y|^2 - k r^2 b / (2 (k - b)), where b < k. They are equal
  /// at |y| = l if b = k (1 - r/l), to which `shift` k is added. Not a number where the sum of the quadratic
  /// functions has no minimum.
  double bound_with(double shift) {
    double sum = cost_;
    const auto slope = [&](double length, double rest, double weight) {
      if (!(weight > 0)) return 0.0;
      if (rest == 0) return weight;
      const double b = weight * std::min(1 - rest / std::max(length, 1e-9 * rest) + shift, 0.999);
      sum -= 0.5 * weight * rest * rest * b / (weight - b);
      return b;
    };
    const std::size_t steps = terms_.length.size();
    steps_.resize(steps);
    for (std::size_t k = 0; k < steps; ++k)
      steps_[k] = slope(lengths_[k], terms_.length[k], terms_.step_weight(k));
    of_ranges_.resize(weights_.size());
    for (std::size_t i = 0; i < weights_.size(); ++i)
      of_ranges_[i] =
          slope(lengths_[steps + i], terms_.ranges[i].length, weights_[i] * terms_.ranges[i].information);
    quadratic_.assemble_quadratic(steps_, of_ranges_);
    if (is_free_) quadratic_.hold_first_node();
    if (!quadratic_.factorize()) return std::numeric_limits<double>::quiet_NaN();
    const auto at = quadratic_.x, beacons = quadratic_.beacons;
    for (int polish = 0; polish < 2; ++polish) {
      if (polish > 0) quadratic_.assemble_quadratic(steps_, of_ranges_);  // the gradient there
      auto step = quadratic_.gradient;
      Eigen::VectorXd of_border = quadratic_.border_gradient;
      quadratic_.solve(step, of_border);
      quadratic_.move(step, of_border);
    }
    sum += quadratic_.quadratic_energy(steps_, of_ranges_);
    quadratic_.x = at;
    quadratic_.beacons = beacons;
    return std::isfinite(sum) ? sum : std::numeric_limits<double>::quiet_NaN();
  }

  /// The path with a second complex coordinate.
  void lift() {
    lifted_.x.clear();
    lifted_.beacons.clear();
    lifted_.held = weights_.data();
    double size = 0;  // half the mean range; less than a fifth of it is too little
    for (const PathRange& range : terms_.ranges)
      size += range.length / 2 / static_cast<double>(terms_.ranges.size());
    const auto raised = [&](const PathChain<2>::Point& p, std::size_t i) {
      PathChain<4>::Point q;
      const double t = static_cast<double>(i);
      q << p[0], p[1], size * std::sin(0.7 + t / 300), size * std::cos(0.3 + t / 700);
      return q;
    };
    for (std::size_t k = 0; k < quadratic_.x.size(); ++k) lifted_.x.push_back(raised(quadratic_.x[k], k));
    for (std::size_t j = 0; j < quadratic_.beacons.size(); ++j)
      lifted_.beacons.push_back(raised(quadratic_.beacons[j], 1000 * j));
  }

  const PathTerms& terms_;
  PathChain<2> quadratic_;
  PathChain<4> lifted_;
  PathDescent<4> descent_;
  std::vector<double> weights_, lengths_, steps_, of_ranges_;
  double cost_ = 0;
  bool is_free_ = false;
};

}  // namespace ranges
}  // namespace ASTERISM_ABI
}  // namespace asterism
