#pragma once

#include <algorithm>
#include <asterism/solver/config.hpp>
#include <asterism/solver/energy.hpp>
#include <asterism/solver/finite.hpp>
#include <asterism/solver/spring_system.hpp>
#include <cmath>

namespace asterism::inline ASTERISM_ABI {

/// The length that a system's distances are measured in: the root mean square of its rest lengths and of its
/// anchors about their centroid, counting the springs of positive stiffness alone. Where all those are zero,
/// the root mean square of x about that centroid, or about its own where no anchor has stiffness [px].
template <typename System>
typename System::Scalar characteristic_length(const System& system, const typename System::Points& x) {
  using Scalar = typename System::Scalar;
  int count = 0;
  typename System::Point centroid = System::Point::Zero();
  for (int i = 0; i < system.nodes(); ++i) {
    if (!(system.anchor_stiffness[i] > 0)) continue;
    ++count;
    centroid += system.anchors.col(i);
  }
  if (count > 0)
    centroid /= static_cast<Scalar>(count);
  else if (system.nodes() > 0)
    centroid = x.rowwise().mean();
  Scalar sum = 0;
  for (int i = 0; i < system.nodes(); ++i) {
    if (system.anchor_stiffness[i] > 0) sum += (system.anchors.col(i) - centroid).squaredNorm();
  }
  for (int l = 0; l < system.link_count(); ++l) {
    if (!(system.link_stiffness[l] > 0)) continue;
    ++count;
    sum += system.rest_length[l] * system.rest_length[l];
  }
  if (sum > 0) return std::sqrt(sum / static_cast<Scalar>(count));
  return std::sqrt((x.colwise() - centroid).squaredNorm() / static_cast<Scalar>(std::max(1, system.nodes())));
}

namespace detail {

template <typename System>
void node_stiffness(const System& system, typename System::NodeVector& result) {
  using Scalar = typename System::Scalar;
  result = system.anchor_stiffness;
  // Links often come node by node, whose sum is then kept out of memory.
  int node = -1;
  Scalar sum = 0;
  int l = 0;
  for (const Link& link : system.links()) {
    if (link.i != node) {
      if (node >= 0) result[node] += sum;
      node = link.i;
      sum = 0;
    }
    sum += system.link_stiffness[l];
    result[link.j] += system.link_stiffness[l];
    ++l;
  }
  if (node >= 0) result[node] += sum;
}

/// Whether the anchors hold on to the nodes by less than a tenth of what the links hold.
template <typename System>
bool has_weak_anchors(const System& system) {
  return 10 * system.anchor_stiffness.sum() < system.link_stiffness.sum();
}

/// The one stopping rule: max_i |g_i| / (A_ii L) <= tolerance, with L the characteristic length at the start.
template <typename System>
class StoppingRule {
 public:
  using Scalar = typename System::Scalar;

  /// False where stiffness or lengths leave the range of the scalar.
  bool set(const System& system, const typename System::Points& x, double tolerance) {
    const Scalar length = characteristic_length(system, x);
    Scalar extent = x.cwiseAbs().maxCoeff();
    for (int i = 0; i < system.nodes(); ++i) {
      if (system.anchor_stiffness[i] > 0)
        extent = std::max(extent, system.anchors.col(i).cwiseAbs().maxCoeff());
    }
    detail::node_stiffness(system, stiffness_);
    weights_.setZero(system.nodes());
    if (!(length > 0)) {
      tolerance_ = static_cast<Scalar>(tolerance);
      return length == 0 && is_one_point(system, x);
    }
    bool in_range = true;
    for (int i = 0; i < system.nodes(); ++i) {
      if (!(stiffness_[i] > 0)) continue;
      weights_[i] = 1 / (stiffness_[i] * length);
      in_range &= weights_[i] > 0 && is_finite(weights_[i]);
    }
    // A coordinate is known to eps |x|, so g_i / A_ii cannot be resolved below a few times that.
    constexpr Scalar kRounding = 8 * std::numeric_limits<Scalar>::epsilon();
    tolerance_ = std::max(static_cast<Scalar>(tolerance), kRounding * (1 + extent / length));
    return in_range && is_finite(tolerance_);
  }

  Scalar tolerance() const { return tolerance_; }
  /// A_ii, see asterism::node_stiffness.
  const typename System::NodeVector& node_stiffness() const { return stiffness_; }
  Scalar stationarity(const typename System::Points& gradient) const { return std::sqrt(square(gradient)); }
  /// Also true for a gradient with NaN, which no further iteration can cure.
  bool reached(const typename System::Points& gradient) const {
    return !(square(gradient) > tolerance_ * tolerance_);
  }

 private:
  // Whether all of x is on the one point that anchors and springs want it at. Otherwise a characteristic
  // length of zero is of squares that underflow.
  static bool is_one_point(const System& system, const typename System::Points& x) {
    for (int i = 0; i < system.nodes(); ++i) {
      if (x.col(i) != x.col(0)) return false;
      if (system.anchor_stiffness[i] > 0 && system.anchors.col(i) != x.col(0)) return false;
    }
    return !(system.link_stiffness.array() > 0 && system.rest_length.array() > 0).any();
  }

  // NaN where the gradient has one.
  Scalar square(const typename System::Points& gradient) const {
    Scalar largest = 0;
    for (int i = 0; i < weights_.size(); ++i) {
      const Scalar value = (gradient.col(i) * weights_[i]).squaredNorm();
      if (!(value <= largest)) largest = value;
    }
    return largest;
  }

  typename System::NodeVector stiffness_;  // A_ii
  typename System::NodeVector weights_;    // 1 / (A_ii L)
  Scalar tolerance_ = 0;
};

}  // namespace detail

/// A_ii = k_i + sum_j k_ij, the diagonal of K_dyn: the stiffness that node i moves against when the others
/// stand still.
template <typename System>
typename System::NodeVector node_stiffness(const System& system) {
  typename System::NodeVector result;
  detail::node_stiffness(system, result);
  return result;
}

/// How far x is from a stationary point, without units: max_i |dE/dx_i| / (A_ii L), with A_ii the
/// node_stiffness and L the characteristic_length. It is the largest distance, in units of L, that a node
/// would move to if the others and the directions of its springs stood still. Nodes without stiffness are
/// skipped.
template <typename System>
double stationarity(const System& system, const typename System::Points& x) {
  detail::StoppingRule<System> rule;
  rule.set(system, x, 0);
  return static_cast<double>(rule.stationarity(gradient(system, x)));
}

}  // namespace asterism::inline ASTERISM_ABI
