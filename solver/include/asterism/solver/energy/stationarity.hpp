#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/numbers.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/full_links.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <cmath>
#include <limits>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace detail {

/// sum_j k_ij: what the links hold each node with.
template <typename System>
void link_stiffness_of_nodes(const System& system, typename System::NodeVector& result) {
  using Scalar = typename System::Scalar;
  using Links = FullLinks<System>;
  result.setZero(system.nodes());
  if constexpr (Links::kServes) {
    if (Links::serve(system)) {
      Links::for_each([&](auto i, auto j, auto l) {
        result[i] += system.link_stiffness[l];
        result[j] += system.link_stiffness[l];
      });
      return;
    }
  }
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

template <typename System>
void node_stiffness(const System& system, typename System::NodeVector& result) {
  link_stiffness_of_nodes(system, result);
  result += system.anchor_stiffness;
}

/// Whether the anchors hold on to the nodes by less than a tenth of what the links hold.
template <typename System>
bool has_weak_anchors(const System& system) {
  return 10 * system.anchor_stiffness.sum() < system.link_stiffness.sum();
}

/// The weight of a spring in the average of lengths: 1; for a spring weaker than a ten-thousandth of the
/// strongest, less, in proportion to its stiffness, so that a spring that holds hardly anything counts
/// hardly anything; 0 without stiffness.
template <typename Scalar>
class SpringWeight {
 public:
  explicit SpringWeight(Scalar strongest) : full_(Scalar(1e-4) * strongest) {}
  Scalar operator()(Scalar stiffness) const {
    if (!(stiffness > 0)) return 0;
    return stiffness >= full_ ? Scalar(1) : stiffness / full_;
  }

 private:
  Scalar full_;
};

/// The mean square of the rest lengths, with their offsets, and of the anchors about their centroid, by
/// SpringWeight, and the centroid. Counted are the anchors of nodes that move and that links hold, as
/// link_stiffness_of_nodes says, or, with `all`, every anchor.
template <typename System>
typename System::Scalar mean_square_length(const System& system,
                                           const typename System::NodeVector& held_by_links, bool all,
                                           typename System::Point& centroid) {
  using Scalar = typename System::Scalar;
  const auto anchor_stiffness = [&](int i) {
    const Scalar k = system.anchor_stiffness[i];
    return all || (held_by_links[i] > 0 && !system.is_fixed(i)) ? k : Scalar(0);
  };
  Scalar strongest = system.link_count() > 0 ? system.link_stiffness.maxCoeff() : Scalar(0);
  for (int i = 0; i < system.nodes(); ++i) strongest = std::max(strongest, anchor_stiffness(i));
  const SpringWeight<Scalar> weight_of(strongest);
  Scalar total = 0;
  centroid.setZero();
  for (int i = 0; i < system.nodes(); ++i) {
    const Scalar weight = weight_of(anchor_stiffness(i));
    if (!(weight > 0)) continue;
    total += weight;
    centroid += weight * system.anchors.col(i);
  }
  if (total > 0) centroid /= total;
  Scalar sum = 0;
  for (int i = 0; i < system.nodes(); ++i) {
    const Scalar weight = weight_of(anchor_stiffness(i));
    if (weight > 0) sum += weight * (system.anchors.col(i) - centroid).squaredNorm();
  }
  for (int l = 0; l < system.link_count(); ++l) {
    const Scalar weight = weight_of(system.link_stiffness[l]);
    if (!(weight > 0)) continue;
    total += weight;
    sum += weight * (system.rest_length[l] * system.rest_length[l]);
    if (system.has_offsets()) sum += weight * system.rest_offset.col(l).squaredNorm();
  }
  return sum > 0 ? sum / total : Scalar(0);
}

/// The same without `all` where every spring counts alike, as most often; 0 elsewhere.
template <typename System>
typename System::Scalar plain_mean_square_length(const System& system,
                                                 const typename System::NodeVector& held_by_links) {
  using Scalar = typename System::Scalar;
  if (system.link_count() == 0 || system.fixed_count() > 0) return 0;
  const auto& anchor_stiffness = system.anchor_stiffness;
  const Scalar weakest = std::min(anchor_stiffness.minCoeff(), system.link_stiffness.minCoeff());
  const Scalar strongest = std::max(anchor_stiffness.maxCoeff(), system.link_stiffness.maxCoeff());
  if (!(weakest > 0 && SpringWeight<Scalar>(strongest)(weakest) == 1)) return 0;
  for (int i = 0; i < system.nodes(); ++i) {
    if (!(held_by_links[i] > 0)) return 0;
  }
  typename System::Point centroid = System::Point::Zero();
  for (int i = 0; i < system.nodes(); ++i) centroid += system.anchors.col(i);
  centroid /= Scalar(system.nodes());
  Scalar sum = system.rest_length.squaredNorm();
  for (int i = 0; i < system.nodes(); ++i) sum += (system.anchors.col(i) - centroid).squaredNorm();
  if (system.has_offsets()) sum += system.rest_offset.squaredNorm();
  return sum / Scalar(system.nodes() + system.link_count());
}

/// The farthest that a load would move its node if the others stood still.
template <typename System>
typename System::Scalar load_reach(const System& system, const typename System::NodeVector& held_by_links) {
  typename System::Scalar reach = 0;
  if (!system.has_loads()) [[likely]]
    return reach;
  for (int i = 0; i < system.nodes(); ++i) {
    const typename System::Scalar stiffness = held_by_links[i] + system.anchor_stiffness[i];
    if (stiffness > 0 && !system.is_fixed(i)) reach = std::max(reach, system.loads.col(i).norm() / stiffness);
  }
  return reach;
}

/// characteristic_length, with the system's link_stiffness_of_nodes.
template <typename System>
typename System::Scalar characteristic_length(const System& system, const typename System::Points& x,
                                              const typename System::NodeVector& held_by_links) {
  using Scalar = typename System::Scalar;
  typename System::Point centroid;
  Scalar square = plain_mean_square_length(system, held_by_links);
  if (!(square > 0)) square = mean_square_length(system, held_by_links, false, centroid);
  if (!(square > 0)) square = mean_square_length(system, held_by_links, true, centroid);
  if (square > 0) return std::sqrt(square);
  if (const Scalar reach = load_reach(system, held_by_links); reach > 0) return reach;
  Scalar extent = 0;  // of the one point where the anchors are
  for (int i = 0; i < system.nodes(); ++i) {
    if (system.anchor_stiffness[i] > 0) extent = std::max(extent, largest_size(system.anchors.col(i)));
  }
  const auto nodes = static_cast<Scalar>(std::max(1, system.nodes()));
  if (system.nodes() > 0 && !(system.anchor_stiffness.maxCoeff() > 0)) {
    centroid.setZero();
    for (int i = 0; i < system.nodes(); ++i) centroid += x.col(i);
    centroid /= nodes;
  }
  square = 0;
  for (int i = 0; i < system.nodes(); ++i) square += (x.col(i) - centroid).squaredNorm();
  const Scalar spread = std::sqrt(square / nodes);
  return extent > 0 ? std::min(extent, spread) : spread;
}

/// The one stopping rule: max_i |g_i| / (A_ii L) <= tolerance, with L the characteristic length. Nothing of
/// the start is in it but that length where the system has none.
template <typename System>
class StoppingRule {
 public:
  using Scalar = typename System::Scalar;

  /// False where stiffness or lengths leave the range of the scalar.
  bool set(const System& system, const typename System::Points& x, double tolerance) {
    tolerance_ = std::max(static_cast<Scalar>(tolerance), kLeastTolerance);
    link_stiffness_of_nodes(system, stiffness_);
    length_ = characteristic_length(system, x, stiffness_);
    stiffness_ += system.anchor_stiffness;
    weights_.setZero(system.nodes());
    if (!(length_ > 0)) return length_ == 0 && is_one_point(system, x);
    bool in_range = true;
    for (int i = 0; i < system.nodes(); ++i) {
      if (!(stiffness_[i] > 0)) continue;
      weights_[i] = 1 / (stiffness_[i] * length_);
      in_range &= weights_[i] > 0 && is_finite(weights_[i]);
    }
    return in_range && is_finite(tolerance_);
  }

  /// The least tolerance that rounding allows for coordinates up to some tens of L.
  static constexpr Scalar kLeastTolerance = 64 * std::numeric_limits<Scalar>::epsilon();

  /// The tolerance asked for, or what the scalar resolves where that is more.
  Scalar tolerance() const { return tolerance_; }
  Scalar length() const { return length_; }
  /// A_ii, see asterism::node_stiffness.
  const typename System::NodeVector& node_stiffness() const { return stiffness_; }
  Scalar stationarity(const typename System::Points& gradient) const { return std::sqrt(square(gradient)); }
  /// Whether the tolerance is met, by all but nodes of which the gradient is NaN, which no further iteration
  /// can cure.
  bool reached(const typename System::Points& gradient) const {
    for (int i = 0; i < weights_.size(); ++i) {
      if (square_of(gradient, i) > tolerance_ * tolerance_) return false;
    }
    return true;
  }

  /// Whether each force would move its node by a few times the rounding of its coordinates at most, `share`
  /// of them: another iteration may gain nothing.
  bool is_rounding(const typename System::Points& x, const typename System::Points& gradient,
                   Scalar share = 8 * std::numeric_limits<Scalar>::epsilon()) const {
    for (int i = 0; i < weights_.size(); ++i) {
      const Scalar rounding = share * (length_ + largest_size(x.col(i)));
      if (!(std::sqrt(square_of(gradient, i)) * length_ <= rounding)) return false;
    }
    return true;
  }

 private:
  // Whether all of x is on the one point that anchors and springs want it at, without loads. Otherwise a
  // characteristic length of zero is of squares that underflow.
  static bool is_one_point(const System& system, const typename System::Points& x) {
    for (int i = 0; i < system.nodes(); ++i) {
      if (!is_equal(x.col(i), x.col(0))) return false;
      if (system.has_loads() && !system.is_fixed(i) && !is_zero(system.loads.col(i))) return false;
      if (system.anchor_stiffness[i] > 0 && !is_equal(system.anchors.col(i), x.col(0))) return false;
    }
    for (int l = 0; l < system.link_count(); ++l) {
      if (!(system.link_stiffness[l] > 0)) continue;
      if (system.rest_length[l] > 0 || (system.has_offsets() && !is_zero(system.rest_offset.col(l))))
        return false;
    }
    return true;
  }

  // Of one node's share of the stationarity.
  Scalar square_of(const typename System::Points& gradient, int i) const {
    return (gradient.col(i) * weights_[i]).squaredNorm();
  }

  // NaN where the gradient has one.
  Scalar square(const typename System::Points& gradient) const {
    Scalar largest = 0;
    for (int i = 0; i < weights_.size(); ++i) {
      const Scalar value = square_of(gradient, i);
      if (!(value <= largest)) largest = value;
    }
    return largest;
  }

  typename System::NodeVector stiffness_;  // A_ii
  typename System::NodeVector weights_;    // 1 / (A_ii L)
  Scalar length_ = 0;
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

/// The length L that a system's distances are measured in: the root mean square of its rest lengths and
/// offsets (each link's (mu^2 + |m|^2)^(1/2)), and of its anchors about their centroid [px], of what holds:
///   - springs without stiffness do not count, those weaker than a ten-thousandth of the strongest count in
///     proportion to their stiffness, all others alike;
///   - the anchor of a node without links, or of a fixed one, holds nothing else, and counts only where the
///     rest would give no length.
/// Where all those lengths are zero, the farthest that a load would move its node if the others stood still;
/// without loads, the root mean square of x about that centroid, or about its own where no
/// anchor has stiffness; or, for a start far off not to loosen the tolerance, the largest coordinate of the
/// anchors, if that is less and not 0. Invariant to translation, except in this last case.
template <typename System>
typename System::Scalar characteristic_length(const System& system, const typename System::Points& x) {
  typename System::NodeVector held_by_links;
  detail::link_stiffness_of_nodes(system, held_by_links);
  return detail::characteristic_length(system, x, held_by_links);
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

}  // namespace ASTERISM_ABI
}  // namespace asterism
