#pragma once

#include <asterism/solver/base/finite.hpp>
#include <cstddef>
#include <deque>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// The last steps of a descent with the changes of the gradient: L-BFGS's two loops (Nocedal & Wright,
/// algorithm 7.4).
class LbfgsPairs {
 public:
  bool empty() const { return pairs_.empty(); }
  void clear() { pairs_.clear(); }

  /// Remembers a step, unless the slope along it has hardly changed; `slope` is that at its start.
  void add(const Eigen::MatrixXd& step, const Eigen::MatrixXd& change, double slope) {
    constexpr std::size_t kMemory = 6;
    constexpr double kCurvature = 1e-3;  // least change of the slope
    const double curvature = step.cwiseProduct(change).sum();
    if (!(curvature > kCurvature * -slope)) return;
    pairs_.push_back({step, change, 1 / curvature});
    if (pairs_.size() > kMemory) pairs_.pop_front();
  }

  /// The direction from a gradient; descent(v) is that of the metric, -M^-1 v.
  template <typename Descent>
  Eigen::MatrixXd direction(const Eigen::MatrixXd& gradient, Descent&& descent) const {
    Eigen::MatrixXd v = gradient;
    Eigen::VectorXd alpha(static_cast<Eigen::Index>(pairs_.size()));
    for (std::size_t i = pairs_.size(); i-- > 0;) {
      const double share = pairs_[i].inverse_curvature * pairs_[i].step.cwiseProduct(v).sum();
      alpha[static_cast<Eigen::Index>(i)] = share;
      v -= share * pairs_[i].change;
    }
    Eigen::MatrixXd result = descent(v);
    if (!pairs_.empty()) {
      const Pair& last = pairs_.back();
      const Eigen::MatrixXd changed = descent(last.change);
      const double gamma = -1 / (last.inverse_curvature * last.change.cwiseProduct(changed).sum());
      if (gamma > 0 && is_finite(gamma)) result *= gamma;
    }
    for (std::size_t i = 0; i < pairs_.size(); ++i) {
      const double beta = -pairs_[i].inverse_curvature * pairs_[i].change.cwiseProduct(result).sum();
      result += (beta - alpha[static_cast<Eigen::Index>(i)]) * pairs_[i].step;
    }
    return result;
  }

 private:
  struct Pair {
    Eigen::MatrixXd step, change;
    double inverse_curvature;
  };
  std::deque<Pair> pairs_;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
