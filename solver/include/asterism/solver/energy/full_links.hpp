#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/energy/spring_element.hpp>
#include <asterism/solver/problem/model.hpp>
#include <cmath>
#include <limits>
#include <type_traits>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// f(integral_constant<int, kFrom>), ..., f(integral_constant<int, kTo - 1>).
template <int kFrom, int kTo, typename F>
[[gnu::always_inline]] constexpr void unroll(F&& f) {
  if constexpr (kFrom < kTo) {
    f(std::integral_constant<int, kFrom>());
    unroll<kFrom + 1, kTo>(f);
  }
}

/// All links of a few nodes, a number fixed by the type, that are fully linked: the compiler knows their
/// ends, and roots, divisions and forces are computed in vectors, each number of all links at once. The
/// results are those of for_each_spring, by the same operations in the same order, which tests hold it to.
template <typename System>
class FullLinks {
 public:
  using Scalar = typename System::Scalar;
  using Point = typename System::Point;
  using Points = typename System::Points;

  static constexpr int kNodes = System::kNodes;
  static constexpr int kDim = System::kDim;
  /// Whether systems of this type can be served; code is made for each link.
  static constexpr bool kServes = kNodes != Eigen::Dynamic && kNodes >= 2 && kNodes * kDim <= 12;
  static constexpr int kLinks = kServes ? kNodes * (kNodes - 1) / 2 : 1;
  using Values = Eigen::Array<Scalar, kLinks, 1>;

  /// Whether the system can be served.
  static bool serve(const System& system) {
    return kServes && system.topology().is_full() && !system.has_offsets() && !system.has_loads();
  }

  /// Calls visit(i, j, l), of integral constants, for every link l from node i to j.
  template <typename Visit>
  [[gnu::always_inline]] static void for_each(Visit&& visit) {
    unroll<0, kNodes>([&](auto i) {
      unroll<i + 1, kNodes>([&](auto j) {
        visit(i, j, std::integral_constant<int, i*(2 * kNodes - i - 1) / 2 + j - i - 1>());
      });
    });
  }

  /// Lengths, directions, energies and tensions at x. False where the ends of a link are so near that
  /// coincident_spring has to take over.
  [[gnu::always_inline]] bool set(const System& system, const Points& x) {
    Values square;
    for_each([&](auto i, auto j, auto l) {
      const Point d = x.col(i) - x.col(j);
      for (int c = 0; c < kDim; ++c) direction_[c][l] = d[c];
      if constexpr (kDim != 2) square[l] = d.squaredNorm();  // in the order of its sum
    });
    if constexpr (kDim == 2) square = direction_[0].square() + direction_[1].square();
    if (!(square.minCoeff() >= kLeastSquare<Scalar>)) [[unlikely]]
      return false;
    if constexpr (std::is_same_v<Scalar, float>) {  // Eigen's own roots of it are approximate
      for (int l = 0; l < kLinks; ++l) length_[l] = std::sqrt(square[l]);
    } else {
      length_ = square.sqrt();
    }
    inverse_ = 1 / length_;
    for (int c = 0; c < kDim; ++c) direction_[c] *= inverse_;

    if (!set_hooke(system)) {
      for (int l = 0; l < kLinks; ++l) {
        const LinkForce<Scalar> force = link_force(system, l, length_[l], inverse_[l]);
        energy_[l] = force.energy;
        tension_[l] = force.tension;
        along_[l] = force.along;
      }
    }
    for (int c = 0; c < kDim; ++c) pull_[c] = tension_ * direction_[c];
    return true;
  }

  /// Entry (row, column) of the links' curvatures, see link_curvature.
  struct Curvatures {
    Values values[kDim * (kDim + 1) / 2];
    const Values& operator()(int row, int column) const {
      const int low = row < column ? row : column, high = row < column ? column : row;
      return values[high * (high + 1) / 2 + low];
    }
  };
  /// The curvatures at the x of `set`, with `clamp` without negative ones.
  [[gnu::always_inline]] Curvatures curvatures(bool clamp) const {
    const Scalar least = clamp ? Scalar(0) : -std::numeric_limits<Scalar>::infinity();
    const Values across = (tension_ * inverse_).max(least);
    const Values difference = along_.max(least) - across;
    Curvatures result;
    for (int column = 0; column < kDim; ++column) {
      const Values bend = difference * direction_[column];
      for (int row = 0; row <= column; ++row) {
        Values& entry = result.values[column * (column + 1) / 2 + row];
        entry = direction_[row] * bend;
        if (row == column) entry += across;
      }
    }
    return result;
  }

  Scalar energy(int l) const { return energy_[l]; }
  /// As link_force and spring have them.
  [[gnu::always_inline]] LinkForce<Scalar> force(int l) const {
    return {energy_[l], tension_[l], along_[l], tension_[l] * inverse_[l]};
  }
  [[gnu::always_inline]] Spring<System> spring(int l) const {
    Spring<System> result;
    result.length = length_[l];
    result.inverse = inverse_[l];
    for (int c = 0; c < kDim; ++c) result.direction[c] = direction_[c][l];
    return result;
  }
  /// The force of link l on node i; that on node j is its negative.
  [[gnu::always_inline]] Point pull(int l) const {
    Point result;
    for (int c = 0; c < kDim; ++c) result[c] = pull_[c][l];
    return result;
  }

 private:
  // The forces, if all links are springs that have stiffness.
  [[gnu::always_inline]] bool set_hooke(const System& system) {
    if constexpr (std::is_same_v<decltype(system.link_potential), Hooke>) {
      const auto stiffness = system.link_stiffness.template head<kLinks>().array();
      if (!(stiffness.minCoeff() > 0)) [[unlikely]]
        return false;
      const Values stretch = length_ - system.rest_length.template head<kLinks>().array();
      energy_ = stiffness * (stretch * stretch / 2);
      tension_ = stiffness * stretch;
      along_ = stiffness;
      return true;
    } else {
      return false;
    }
  }

  Values direction_[kDim], pull_[kDim];  // coordinate by coordinate
  Values length_, inverse_, energy_, tension_, along_;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
