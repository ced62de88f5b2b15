#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/full_links.hpp>
#include <asterism/solver/energy/spring_element.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <cmath>
#include <limits>
#include <type_traits>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// Whether a link of this potential has the minoriser of a spring, which needs phi to be convex as a function
/// of r^2: phi(s) >= phi(r) + phi'(r) / (2 r) (s^2 - r^2).
template <typename Potential>
constexpr bool has_minoriser() {
  if constexpr (requires { Potential::kConvexInSquare; }) return Potential::kConvexInSquare;
  return false;
}

/// The properties of a minoriser, besides its W, that a bound needs, for any type of system. W has `block`
/// unknowns for each node.
struct MinoriserView {
  int nodes;
  int block;
  int columns;             ///< right-hand sides of W
  int terms;               ///< as Minoriser's, from here on
  const double* gradient;  ///< `columns` values an unknown
  const double* scale;     ///< a value a node, and so has
  const double* gradient_scale;
};

/// The result of the factorisation of a minoriser's W.
struct MinoriserBound {
  bool is_definite = false;  ///< W is positive definite, whatever its rounding
  double excess = 0;         ///< then q(x) - min q is at most this
  /// Where W is definite, its least eigenvalue is at least this; elsewhere it is at most this.
  double least_eigenvalue = std::numeric_limits<double>::quiet_NaN();
};

/// The excess of a gradient that is the sum of two: one with the norm `norm` in the inverse of the matrix
/// factored, and a rounding of at most rounding(i) at node i. The latter is measured by W >= shift
/// diag(scale) or by W's least eigenvalue, whichever is better.
template <typename Rounding>
double excess_with_rounding(const MinoriserView& minoriser, double norm, double shift,
                            double least_eigenvalue, Rounding&& rounding) {
  double scaled = 0, plain = 0;
  for (int i = 0; i < minoriser.nodes; ++i) {
    const double force = rounding(i);
    if (!(force > 0)) continue;
    scaled += force / (shift * minoriser.scale[i]) * force;
    plain += force / least_eigenvalue * force;
  }
  const double total = norm + std::sqrt(std::min(scaled, plain));
  return total * total / 2;
}

/// The quadratic below the energy that touches it at x, q(y) = E(x) + g . (y - x) + 1/2 (y - x)^T W (y - x):
/// each link is replaced by 1/2 w |y_i - y_j - m_ij|^2 plus a constant, with w = phi'(r) / r, for a spring
/// k (1 - mu / r), its curvature across. So W has a row a node, for anisotropic anchors one a coordinate.
///
/// With `clamp`, links that push count for nothing (their energy is at least 0): W is then positive
/// semi-definite, and q is still below E, but does not touch it.
///
/// Everything is in double and has its rounding bounded, in units of epsilon: that of W by
/// v^T (computed - exact) v <= c sum_i scale_i v_i^2, and that of gradient and energy as below.
template <typename System>
class Minoriser {
 public:
  static_assert(std::is_same_v<typename System::Scalar, double>);
  static constexpr double kEpsilon = std::numeric_limits<double>::epsilon();
  static constexpr double kUnknown = std::numeric_limits<double>::infinity();
  static constexpr int kDim = System::kDim;
  /// Unknowns of a node in W, and columns of a right-hand side.
  static constexpr int kBlock = System::kAnisotropic ? kDim : 1;
  static constexpr int kColumns = kDim / kBlock;
  using Points = typename System::Points;
  using Point = typename System::Point;
  using NodeVector = typename System::NodeVector;

  /// The minoriser of `system` at x. The nodes of `held` and the fixed nodes do not move.
  template <typename Held>
  void set(const System& system, const Points& x, bool clamp, const Held& held) {
    const int n = system.nodes();
    energy = energy_rounding = stored = coordinate_rounding = 0;
    loads_size_ = springs_size_ = 0;
    has_loads_ = system.has_loads();
    shortest = kUnknown;
    peaked_link = -1;
    gradient.resize(kDim, n);
    stiffness_.resize(n);
    weights_.resize(system.link_count());
    scale.resize(n);
    gradient_scale.resize(n);
    is_free_.resize(n);
    bend_.setZero(n);
    degree_.setOnes(n);
    for (int i = 0; i < n; ++i) is_free_[i] = !system.is_fixed(i) && !held(i);
    if (!set_full(system, x, clamp)) {
      for_each_spring(
          system, x,
          [&](int i, const Point& offset) {
            add_anchor(system, i, offset);
            if (system.has_loads()) [[unlikely]]
              add_load(system, i, x);
          },
          [&](int l, const Link& link, const auto& force, const auto& spring) {
            add_link(system, l, link, force, spring, clamp);
          });
    }
    for (int i = 0; i < n; ++i) {
      if (!is_free_[i]) gradient.col(i).setZero(), gradient_scale[i] = 0, scale[i] = 1;
    }
    for (int i = 0; i < n; ++i) coordinate_rounding += scale[i] * x.col(i).squaredNorm();
    coordinate_rounding *= 4 * kEpsilon * kEpsilon;
    terms = degree_.maxCoeff() + 1;
    const double count = n + static_cast<double>(system.link_count());
    // Squares of what is much smaller are 0.
    constexpr double kLeast = std::numeric_limits<double>::min() / kEpsilon;
    energy_rounding += count * (energy + loads_size_ + kLeast);
  }

  /// W without the rows and columns of nodes that do not move, on whose diagonal is 1: calls
  /// diagonal(i, row, column, value) for entries of node i's block, the lower triangle, and
  /// couple(l, link, weight) for links between nodes that move, whose block is -weight times the identity.
  /// Values for one entry are to be summed.
  template <typename Diagonal, typename Couple>
  void for_each_entry(const System& system, Diagonal&& diagonal, Couple&& couple) const {
    for (int i = 0; i < system.nodes(); ++i) {
      for (int c = 0; c < kBlock; ++c) {
        for (int r = c; r < kBlock; ++r) diagonal(i, r, c, anchor_entry(system, i, r, c));
      }
    }
    int l = 0;
    for (const Link& link : system.links()) {
      const double w = weights_[l];
      for (int d = 0; d < kBlock; ++d) {
        if (is_free_[link.i]) diagonal(link.i, d, d, w);
        if (is_free_[link.j]) diagonal(link.j, d, d, w);
      }
      if (is_free_[link.i] && is_free_[link.j]) couple(l, link, w);
      ++l;
    }
  }

  /// The properties, besides W, that a bound needs.
  MinoriserView view() const {
    return {static_cast<int>(scale.size()), kBlock, kColumns, terms, gradient.data(), scale.data(),
            gradient_scale.data()};
  }

  /// Whether W(y) is positive definite at all y none of whose nodes is farther from x than `distance`, given
  /// a lower bound of W's least eigenvalue at x: E is strictly convex there, as W is below its Hessian.
  bool stays_definite(double distance, double least_eigenvalue) const {
    // A length changes by 2 distance at most, its w by less than twice 2 distance k mu / r^2, and W by less
    // than twice the sum of these at a node.
    return 4 * distance < shortest && 8 * distance * bend_.maxCoeff() < least_eigenvalue;
  }

  /// detail::energy_scale of q's energy at x.
  double energy_scale() const { return has_loads_ ? springs_size_ : energy; }

  double energy = 0;               ///< of q at x
  double energy_rounding = 0;      ///< what it may be off by [epsilon]
  double stored = 0;               ///< sum of k (r + mu)^2 / 2 over the links
  double coordinate_rounding = 0;  ///< energy that an epsilon of the coordinates stores
  Points gradient;                 ///< of q at x, 0 for nodes that do not move
  NodeVector gradient_scale;       ///< column i is off by up to (8 + terms) of it [epsilon]
  NodeVector scale;                ///< of W's rounding, no less than its diagonal
  int terms = 0;                   ///< springs of the node that has most
  double shortest = kUnknown;      ///< length of a link
  int peaked_link = -1;            ///< the first link that pushes its coincident ends apart, or -1

 private:
  double anchor_entry(const System& system, int i, int row, int column) const {
    if (!is_free_[i]) return row == column;
    if constexpr (System::kAnisotropic) {
      return stiffness_[i] / 2 *
             (system.anchor_shape(row, kDim * i + column) + system.anchor_shape(column, kDim * i + row));
    } else {
      return stiffness_[i];
    }
  }

  // The springs of a small full topology; false where it does not serve.
  bool set_full(const System& system, const Points& x, bool clamp) {
    using Links = FullLinks<System>;
    if constexpr (Links::kServes) {
      Links links;
      if (!Links::serve(system) || !links.set(system, x)) return false;
      for (int i = 0; i < system.nodes(); ++i) add_anchor(system, i, anchor_offset(system, i, x));
      Links::for_each([&](auto i, auto j, auto l) {
        add_link(system, l, Link{i, j}, links.force(l), links.spring(l), clamp);
      });
      return true;
    } else {
      return false;
    }
  }

  void add_anchor(const System& system, int i, const Point& offset) {
    const AnchorForce<System> force = anchor_force(system, i, offset);
    double k = system.anchor_stiffness[i];
    double value = force.energy;
    if constexpr (!System::kPlainAnchors) {
      const Point shaped = anchor_shaped(system, i, offset);
      k *= system.anchor_loss(offset.dot(shaped)).first;  // of the reweighted spring
      value = k * offset.dot(shaped) / 2;
    }
    energy += value;
    springs_size_ += value;
    energy_rounding += 4 * std::abs(value);
    if constexpr (System::kAnisotropic) {  // d^T S d is rounded by more than its value where S d is nearly 0
      const double size = offset.cwiseAbs().sum();
      energy_rounding += 8 * k * size * size;
    }
    gradient.col(i) = force.gradient;
    stiffness_[i] = scale[i] = k;
    gradient_scale[i] = k * offset.cwiseAbs().sum();
  }

  void add_load(const System& system, int i, const Points& x) {
    const Point f = system.loads.col(i);
    const double work = f.dot(x.col(i));
    energy -= work;
    energy_rounding += 4 * f.cwiseAbs().dot(x.col(i).cwiseAbs());
    loads_size_ += work + std::abs(work);
    gradient.col(i) -= f;
    gradient_scale[i] += f.cwiseAbs().sum();
  }

  [[gnu::always_inline]] void add_link(const System& system, int l, const Link& link,
                                       const LinkForce<double>& force, const Spring<System>& spring,
                                       bool clamp) {
    const bool moves = is_free_[link.i] || is_free_[link.j];
    const double k = system.link_stiffness[l];
    if (force.tension < 0 && spring.length == 0 && moves && peaked_link < 0) peaked_link = l;
    if (moves && clamp && force.tension < 0) {
      weights_[l] = 0;
      return;
    }
    const double offset = system.has_offsets() ? system.rest_offset.col(l).norm() : 0;
    const double rest = system.rest_length[l] + 2 * offset;  // in proportion to which the length is rounded
    const double reach = k * (spring.length + rest);
    double size = std::abs(force.across - k);
    if (offset > 0) size *= 1 + offset * spring.inverse;
    size += k;  // k (1 + mu / r) of a spring
    weights_[l] = force.across;
    energy += force.energy;
    springs_size_ += force.energy + std::abs(force.tension) * spring.length;
    energy_rounding += 8 * (std::abs(force.tension) + kEpsilon * reach) * (spring.length + rest);
    stored += reach * (spring.length + rest) / 2;
    const Point pull = force.tension * spring.direction;
    gradient.col(link.i) += pull;
    gradient.col(link.j) -= pull;
    // Of a spring, |dw / dr| = k mu / r^2.
    const double bend = std::is_same_v<typename System::Model::LinkPotential, Hooke> && spring.length > 0
                            ? (k - force.across) * spring.inverse
                            : kUnknown;
    if (spring.length > 0 || system.rest_length[l] > 0) shortest = std::min(shortest, spring.length);
    for (const int i : {link.i, link.j}) {
      scale[i] += size;
      bend_[i] += bend;
      gradient_scale[i] += reach;
      ++degree_[i];
    }
  }

  bool has_loads_ = false;
  double loads_size_ = 0;    // what loads add to the scale of rounding
  double springs_size_ = 0;  // the energy's scale with loads
  NodeVector stiffness_;     // k_i, of the reweighted anchor
  typename System::LinkVector weights_;
  NodeVector bend_;  // how much w changes with the lengths, of all links of a node
  Eigen::Array<bool, System::kNodes, 1, Eigen::ColMajor, System::kMaxNodes, 1> is_free_;
  Eigen::Matrix<int, System::kNodes, 1, Eigen::ColMajor, System::kMaxNodes, 1> degree_;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
