#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/energy/minoriser.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// A set of directions in kDim dimensions: a box on a face of the cube around the origin.
template <int kDim>
struct DirectionCell {
  using Point = Eigen::Matrix<double, kDim, 1>;

  int axis = 0;  ///< the face is where this coordinate is `side`
  double side = 1;
  Point low = Point::Constant(-1), high = Point::Constant(1);  ///< of the others

  /// The middle direction, a unit vector, over the cosine of the widest angle from it: d of this cell has
  /// |d| <= d . reach().
  Point reach() const {
    Point middle = (low + high) / 2;
    middle[axis] = side;
    middle.normalize();
    double cosine = 1;
    for (int corner = 0; corner < (1 << kDim); ++corner) {
      Point direction;
      for (int d = 0; d < kDim; ++d) direction[d] = (corner >> d & 1) != 0 ? high[d] : low[d];
      direction[axis] = side;
      cosine = std::min(cosine, middle.dot(direction.normalized()));
    }
    return middle / (cosine * (1 - 8 * std::numeric_limits<double>::epsilon()));
  }

  /// The two halves, across the longest edge.
  std::array<DirectionCell, 2> halves() const {
    int longest = axis == 0 ? 1 : 0;
    for (int d = 0; d < kDim; ++d) {
      if (d != axis && high[d] - low[d] > high[longest] - low[longest]) longest = d;
    }
    std::array<DirectionCell, 2> result{*this, *this};
    const double middle = (low[longest] + high[longest]) / 2;
    result[0].high[longest] = result[1].low[longest] = middle;
    return result;
  }

  /// All directions.
  static std::vector<DirectionCell> faces() {
    std::vector<DirectionCell> result;
    for (int axis = 0; axis < kDim; ++axis) {
      for (const double side : {-1.0, 1.0}) result.push_back({axis, side});
    }
    return result;
  }
};

/// A system of springs in kExtra more dimensions, some of whose links have a direction, without these, in a
/// cell. In kDim dimensions the length r of such a link is at most |d| and at most d . reach; it counts for
/// k (|d|^2 - 2 mu (share |d| + (1 - share) d . reach) + mu^2) / 2 with any share in [0, 1]. The least energy
/// is a lower bound of that of placements in kDim dimensions with such directions.
template <int kDim_>
struct ConeSystem {
  static constexpr int kDim = kDim_;
  static constexpr int kExtra = 2;
  using Point = Eigen::Matrix<double, kDim + kExtra, 1>;
  using Points = Eigen::Matrix<double, kDim + kExtra, Eigen::Dynamic>;

  const SpringSystem<double, kDim>* system;
  std::vector<Point> reaches;  ///< of the links' cells
  std::vector<double> shares;  ///< 1 for a link without a cell

  int nodes() const { return system->nodes(); }
  /// d = x_i - x_j - m_ij of link l.
  Point difference(int l, const Link& link, const Points& x) const {
    Point d = x.col(link.i) - x.col(link.j);
    if (system->has_offsets()) d.template head<kDim>() -= system->rest_offset.col(l);
    return d;
  }
};

/// The quadratic below the energy of a ConeSystem: as that of a SpringSystem.
template <int kDim>
class Minoriser<ConeSystem<kDim>> {
 public:
  using System = ConeSystem<kDim>;
  using Points = typename System::Points;
  using Point = typename System::Point;
  static constexpr int kBlock = 1;
  static constexpr double kEpsilon = std::numeric_limits<double>::epsilon();

  /// At x, touching links without a cell at `stretch` times their length. False where one of these has none.
  bool set(const System& cones, const Points& x, double stretch) {
    const auto& system = *cones.system;
    const int n = system.nodes();
    energy = rounding_ = 0;
    gradient.setZero(x.rows(), n);
    stiffness_ = scale = system.anchor_stiffness;
    gradient_scale.setZero(n);
    weights_.resize(system.link_count());
    for (int i = 0; i < n; ++i) {
      if (!(system.anchor_stiffness[i] > 0)) continue;
      Point offset = x.col(i);
      offset.template head<kDim>() -= system.anchors.col(i);
      gradient.col(i) = system.anchor_stiffness[i] * offset;
      gradient_scale[i] = system.anchor_stiffness[i] * offset.cwiseAbs().sum();
      add(gradient.col(i).dot(offset) / 2);
    }
    bool is_known = true;
    int l = 0;
    for (const Link& link : system.links()) {
      const double k = system.link_stiffness[l];
      const double mu = k > 0 ? system.rest_length[l] : 0;
      const Point d = cones.difference(l, link, x);
      const double offset = system.has_offsets() ? system.rest_offset.col(l).norm() : 0;
      const double square = d.squaredNorm(), length = std::sqrt(square), touched = stretch * length;
      const double share = cones.shares[static_cast<std::size_t>(l)];
      is_known &= touched > 0 || !(share * mu > 0);
      const double w = touched > 0 ? k * (1 - share * mu / touched) : k;
      Point pull = w * d;
      add(k * (touched * touched / 2 - share * mu * touched)), add(k * mu * mu / 2);
      add(w * (square - touched * touched) / 2);
      if (share < 1) {
        const Point towards = (1 - share) * k * mu * cones.reaches[static_cast<std::size_t>(l)];
        pull -= towards;
        add(-d.dot(towards));
      }
      rounding_ += (k * (length + mu) + std::abs(w) * length) * offset;
      weights_[l] = w;
      gradient.col(link.i) += pull;
      gradient.col(link.j) -= pull;
      for (const int i : {link.i, link.j}) {
        stiffness_[i] += w;
        scale[i] += k + std::abs(w - k) * (offset > 0 ? 1 + offset / length : 1);
        gradient_scale[i] += k * (length + 2 * mu + 2 * offset) + std::abs(w) * (length + 2 * offset);
      }
      ++l;
    }
    for (int i = 0; i < n; ++i) {
      if (!system.is_fixed(i)) continue;
      gradient.col(i).setZero();
      gradient_scale[i] = 0;
      scale[i] = 1;
    }
    return is_known;
  }

  template <typename Diagonal, typename Couple>
  void for_each_entry(const System& cones, Diagonal&& diagonal, Couple&& couple) const {
    const auto& system = *cones.system;
    for (int i = 0; i < system.nodes(); ++i) diagonal(i, 0, 0, system.is_fixed(i) ? 1.0 : stiffness_[i]);
    int l = 0;
    for (const Link& link : system.links()) {
      if (!system.is_fixed(link.i) && !system.is_fixed(link.j)) couple(l, link, weights_[l]);
      ++l;
    }
  }

  MinoriserView view() const {
    const int n = static_cast<int>(scale.size());
    return {n,
            1,
            static_cast<int>(gradient.rows()),
            2 * static_cast<int>(weights_.size()) + 2,
            gradient.data(),
            scale.data(),
            gradient_scale.data()};
  }

  /// The least value of the quadratic, given its bound.
  double lowest(const MinoriserBound& bound) const {
    return energy - bound.excess - kEpsilon * (16 + static_cast<double>(weights_.size())) * rounding_;
  }

  double energy = 0;
  Points gradient;
  Eigen::VectorXd scale, gradient_scale;

 private:
  void add(double term) {
    energy += term;
    rounding_ += std::abs(term);
  }

  double rounding_ = 0;  // of the terms
  Eigen::VectorXd stiffness_, weights_;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
