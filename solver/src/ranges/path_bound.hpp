#pragma once

// A lower bound of the least squares energy of a path: docs/locate.md.

#include "path_chain.hpp"
#include "path_descent.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {
namespace ranges {

class PathBound {
 public:
  PathBound(const PathTerms& terms, const PathChain<2>& minimum, double bound)
      : terms_(terms), quadratic_(terms), lifted_(terms) {
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
    for (int round = 0; round < 6 && best < enough; ++round) {
      descent_.run(lifted_, 0, 8);
      best = std::max(best, bound_at(lifted_));
    }
    return std::min(best, energy);
  }
  int iterations() const { return descent_.iterations(); }

 private:
  /// For every length l, k/2 (|y| - r)^2 >= b/2 |y|^2 + c with b = k (1 - r/l) + shift, c = -k r^2 b / (2 (k - b)).
  template <int K>
  double bound_at(const PathChain<K>& chain) {
    double best = 0;
    for (double shift : {1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2}) {
      double sum = cost_;
      const auto slope = [&](double length, double rest, double weight) {
        if (!(weight > 0)) return 0.0;
        if (rest == 0) return weight;
        const double b = weight * std::min(1 - rest / std::max(length, 1e-9 * rest) + shift, 0.999);
        sum -= 0.5 * weight * rest * rest * b / (weight - b);
        return b;
      };
      steps_.resize(terms_.length.size());
      for (std::size_t k = 0; k < steps_.size(); ++k)
        steps_[k] = slope((chain.x[k + 1] - chain.x[k]).norm(), terms_.length[k], terms_.step_weight(k));
      of_ranges_.resize(weights_.size());
      for (std::size_t i = 0; i < weights_.size(); ++i)
        of_ranges_[i] = slope(chain.difference(terms_.ranges[i]).norm(), terms_.ranges[i].length,
                              weights_[i] * terms_.ranges[i].information);
      quadratic_.assemble_quadratic(steps_, of_ranges_);
      if (is_free_) quadratic_.hold_first_node();
      if (!quadratic_.factorize()) continue;
      // At the quadratic function's minimum.
      const auto at = quadratic_.x, beacons = quadratic_.beacons;
      for (int polish = 0; polish < 2; ++polish) {
        if (polish > 0) {
          quadratic_.assemble_quadratic(steps_, of_ranges_);
          if (is_free_) quadratic_.hold_first_node();
          if (!quadratic_.factorize()) break;
        }
        auto step = quadratic_.gradient;
        Eigen::VectorXd of_beacons = quadratic_.beacon_gradient;
        quadratic_.solve(step, of_beacons);
        for (std::size_t k = 0; k < step.size(); ++k) quadratic_.x[k] -= step[k];
        for (std::size_t j = 0; j < quadratic_.beacons.size(); ++j)
          quadratic_.beacons[j] -= of_beacons.segment<2>(static_cast<Eigen::Index>(2 * j));
      }
      sum += quadratic_.quadratic_energy(steps_, of_ranges_);
      quadratic_.x = at;
      quadratic_.beacons = beacons;
      if (std::isfinite(sum)) best = std::max(best, sum);
      if (getenv("PB")) fprintf(stderr, "K %d shift %g bound %g\n", K, shift, sum);
      break;
    }
    return best;
  }

  /// The path with a second complex coordinate, a little off.
  void lift() {
    lifted_.x.clear();
    lifted_.beacons.clear();
    lifted_.held = weights_.data();
    double size = 0;
    for (const double l : terms_.length) size = std::max(size, l);
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
  std::vector<double> weights_, steps_, of_ranges_;
  double cost_ = 0;
  bool is_free_ = false;
};

}  // namespace ranges
}  // namespace ASTERISM_ABI
}  // namespace asterism
