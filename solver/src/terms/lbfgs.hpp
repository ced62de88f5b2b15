#pragma once

#include <Eigen/Core>
#include <asterism/solver/method/lbfgs_pairs.hpp>
#include <utility>

#include "run.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// The steps of L-BFGS; descend(g, result) makes `result` -M^-1 g.
template <typename Descend>
class LbfgsSteps {
 public:
  LbfgsSteps(SystemRun& run, Descend descend) : run_(run), descend_(std::move(descend)) {
    pairs_.clear(run_.x().size());
    descend_(run_.gradient(), descent_);
  }

  /// Moves the run to a lower energy; false where neither the pairs nor the metric lead to one.
  bool advance() {
    double slope = 0, step = 1;
    while (true) {
      slope = pairs_.direction(descent_, run_.gradient(), direction_);
      step = 1;
      if (slope < 0 && run_.search(direction_, step)) break;
      if (pairs_.empty()) return false;
      pairs_.clear(direction_.size());
    }
    descent_before_.swap(descent_);
    descend_(run_.gradient(), descent_);
    pairs_.add(step, direction_, slope, run_.gradient().cwiseProduct(direction_).sum(), run_.gradient(),
               run_.previous_gradient(), descent_, descent_before_);
    return true;
  }

 private:
  SystemRun& run_;
  Descend descend_;
  LbfgsPairs<double, Eigen::Dynamic, Eigen::Dynamic, 6, true> pairs_;
  Eigen::MatrixXd descent_, descent_before_, direction_;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
