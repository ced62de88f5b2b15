#pragma once

#include <Eigen/Core>
#include <array>
#include <asterism/solver/base/finite.hpp>
#include <utility>

#include "run.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// The last steps of a descent with the changes of the gradient, and the direction H g of L-BFGS that follows
/// from them and a metric M, in the compact form of Byrd, Nocedal and Schnabel (1994, Eq. 3.1):
///
///     H = gamma M^-1 + [S, gamma W] [R^-T (D + gamma Y^T W) R^-1, -R^-T; -R^-1, 0] [S, gamma W]^T
///
/// where S and Y have the steps and changes of the gradient as columns, W = M^-1 Y, R is the upper triangle
/// of S^T Y and D its diagonal. A gradient takes one solve with M, and two passes over S and W.
class LbfgsPairs {
 public:
  using Points = Eigen::MatrixXd;

  bool empty() const { return used_ == 0; }

  /// Forgets all pairs, of points with so many coordinates.
  void clear(Eigen::Index size) {
    used_ = 0;
    next_ = 0;
    steps_.setZero(size, kMemory);
    changes_.setZero(size, kMemory);
    steps_gradient_ = changes_gradient_ = {};
  }

  /// -H g for the gradient g of the last `add`; `descent` is -M^-1 g.
  void direction(const Points& descent, Points& result) const {
    result = descent;
    if (used_ == 0) return;
    Numbers u{}, top{};
    for (int i = used_ - 1; i >= 0; --i) {  // u = R^-1 S^T g
      const std::size_t at = slot(i);
      double rest = steps_gradient_[at];
      for (int j = i + 1; j < used_; ++j) rest -= steps_changes_[at][slot(j)] * u[slot(j)];
      u[at] = rest * inverse_curvatures_[at];
    }
    for (int i = 0; i < used_; ++i) {  // top = R^-T ((D + gamma Y^T W) u - gamma W^T g)
      const std::size_t at = slot(i);
      double changed = -changes_gradient_[at];
      for (int j = 0; j < used_; ++j) changed += changes_changes_[at][slot(j)] * u[slot(j)];
      double rest = steps_changes_[at][at] * u[at] + gamma_ * changed;
      for (int j = 0; j < i; ++j) rest -= steps_changes_[slot(j)][at] * top[slot(j)];
      top[at] = rest * inverse_curvatures_[at];
    }
    const Eigen::Index size = result.size();
    double* const to = result.data();
    Eigen::Index i = 0;
    for (; i + kWidth <= size; i += kWidth) {
      Pack sum = ConstPack(to + i);
      for (std::size_t c = 0; c < kMemory; ++c) sum += u[c] * change(c, i);
      sum *= gamma_;
      for (std::size_t c = 0; c < kMemory; ++c) sum -= top[c] * step(c, i);
      Eigen::Map<Pack>(to + i) = sum;
    }
    for (; i < size; ++i) {
      double sum = to[i];
      for (std::size_t c = 0; c < kMemory; ++c) sum += u[c] * *change(c, i).data();
      sum *= gamma_;
      for (std::size_t c = 0; c < kMemory; ++c) sum -= top[c] * *step(c, i).data();
      to[i] = sum;
    }
  }

  /// Remembers `step` times `direction`, which has led to `gradient`, unless the slope along it has hardly
  /// changed. The slopes are those along `direction` before and there; the descents -M^-1 g likewise.
  void add(double step, const Points& direction, double slope_before, double slope, const Points& gradient,
           const Points& gradient_before, const Points& descent, const Points& descent_before) {
    constexpr double kCurvature = 1e-3;  // least change of the slope
    const double curvature = step * (slope - slope_before);
    const bool is_taken = curvature > kCurvature * step * -slope_before;
    const Numbers before = steps_gradient_, changes_before = changes_gradient_;
    const std::size_t newest = next_;
    double newest_before = 0;
    if (is_taken) {
      const auto column = static_cast<Eigen::Index>(newest);
      steps_.col(column) = step * direction.reshaped();
      changes_.col(column) = (descent_before - descent).reshaped();
      newest_before = changes_.col(column).dot(gradient_before.reshaped());
      next_ = (next_ + 1) % kMemory;
      used_ = std::max(used_, static_cast<int>(newest) + 1);
    }
    multiply(gradient);
    if (!is_taken) return;
    for (std::size_t i = 0; i < static_cast<std::size_t>(used_); ++i) {
      if (i == newest) continue;
      steps_changes_[i][newest] = steps_gradient_[i] - before[i];
      changes_changes_[i][newest] = changes_changes_[newest][i] = changes_gradient_[i] - changes_before[i];
    }
    steps_changes_[newest][newest] = curvature;
    inverse_curvatures_[newest] = 1 / curvature;
    const double square = changes_gradient_[newest] - newest_before;  // y . M^-1 y
    changes_changes_[newest][newest] = square;
    gamma_ = curvature / square;
    if (!(gamma_ > 0 && is_finite(gamma_))) clear(steps_.rows());
  }

 private:
  static constexpr std::size_t kMemory = 6;
  static constexpr int kWidth = 4;  // coordinates at a time
  using Pack = Eigen::Array<double, kWidth, 1>;
  using ConstPack = Eigen::Map<const Pack>;
  using Numbers = std::array<double, kMemory>;

  ConstPack step(std::size_t c, Eigen::Index i) const {
    return ConstPack(&steps_(i, static_cast<Eigen::Index>(c)));
  }
  ConstPack change(std::size_t c, Eigen::Index i) const {
    return ConstPack(&changes_(i, static_cast<Eigen::Index>(c)));
  }

  // The slot of the pair that is `age`-th oldest.
  std::size_t slot(int age) const {
    const auto at = static_cast<std::size_t>(age);
    if (used_ < static_cast<int>(kMemory)) return at;
    return next_ + at < kMemory ? next_ + at : next_ + at - kMemory;
  }

  // S^T g and W^T g; slots that are not in use are 0.
  void multiply(const Points& gradient) {
    const double* const g = gradient.data();
    const Eigen::Index size = gradient.size();
    std::array<Pack, kMemory> of_steps, of_changes;
    of_steps.fill(Pack::Zero());
    of_changes.fill(Pack::Zero());
    Eigen::Index i = 0;
    for (; i + kWidth <= size; i += kWidth) {
      const Pack at = ConstPack(g + i);
      for (std::size_t c = 0; c < kMemory; ++c) {
        of_steps[c] += step(c, i) * at;
        of_changes[c] += change(c, i) * at;
      }
    }
    for (std::size_t c = 0; c < kMemory; ++c) {
      steps_gradient_[c] = of_steps[c].sum();
      changes_gradient_[c] = of_changes[c].sum();
      for (Eigen::Index rest = i; rest < size; ++rest) {
        steps_gradient_[c] += *step(c, rest).data() * g[rest];
        changes_gradient_[c] += *change(c, rest).data() * g[rest];
      }
    }
  }

  Points steps_, changes_;                                            // S and W
  std::array<Numbers, kMemory> steps_changes_{}, changes_changes_{};  // S^T Y (upper triangle by age), Y^T W
  Numbers inverse_curvatures_{}, steps_gradient_{}, changes_gradient_{};
  double gamma_ = 1;
  int used_ = 0;          // pairs remembered
  std::size_t next_ = 0;  // slot of the next
};

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
      pairs_.direction(descent_, direction_);
      slope = run_.gradient().cwiseProduct(direction_).sum();
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
  LbfgsPairs pairs_;
  Eigen::MatrixXd descent_, descent_before_, direction_;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
