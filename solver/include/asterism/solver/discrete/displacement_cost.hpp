#pragma once

#include <algorithm>
#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/finite.hpp>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

namespace asterism {
inline namespace ASTERISM_ABI {

/// How a cost grows along an axis.
enum class CostShape {
  Quadratic,  ///< weight (d - offset)^2
  Absolute    ///< weight |d - offset|
};

/// The cost of a displacement d of one part from another along one axis.
struct AxisCost {
  double weight = 1;  ///< per px^2 if quadratic, per px if absolute; from 0 up
  double offset = 0;  ///< the displacement that costs nothing [px]; need not be an integer
  CostShape shape = CostShape::Quadratic;                       ///< of the cost below the truncation
  double truncation = std::numeric_limits<double>::infinity();  ///< no displacement costs more; from 0 up

  /// weight (d - offset)^2.
  static constexpr AxisCost quadratic(double weight, double offset) {
    return {.weight = weight, .offset = offset, .shape = CostShape::Quadratic, .truncation = kInfinity};
  }
  /// weight |d - offset|.
  static constexpr AxisCost absolute(double weight, double offset) {
    return {.weight = weight, .offset = offset, .shape = CostShape::Absolute, .truncation = kInfinity};
  }
  /// a d^2 + b d + b^2 / (4 a), for a > 0: the deformable part model's a d^2 + b d, from its least value on.
  static constexpr AxisCost polynomial(double a, double b) { return quadratic(a, -b / (2 * a)); }

  /// The cost of the displacement d [px].
  double operator()(double d) const {
    const double excess = std::abs(d - offset);
    return std::min(weight * (shape == CostShape::Quadratic ? excess * excess : excess), truncation);
  }

  /// What is wrong with the cost, nullptr for nothing.
  const char* problem() const {
    if (!detail::is_finite(weight) || weight < 0 || weight > std::numeric_limits<float>::max())
      return "has a weight that is negative or not finite";
    if (!detail::is_finite(offset) || std::abs(offset) > kMostOffset)
      return "has an offset that is not finite or beyond 2^20 px";
    // By its bits, as in finite.hpp: NaN and numbers with a sign have larger ones than infinity.
    if (std::bit_cast<std::uint64_t>(truncation) > std::bit_cast<std::uint64_t>(kInfinity))
      return "has a truncation that is negative or NaN";
    return nullptr;
  }

  /// Whether all numbers are equal.
  friend bool operator==(const AxisCost&, const AxisCost&) = default;

 private:
  static constexpr double kInfinity = std::numeric_limits<double>::infinity();
  static constexpr double kMostOffset = 1 << 20;
};

/// The cost of the displacement (dx, dy): the sum of the costs along the axes.
struct DisplacementCost {
  AxisCost x;  ///< of the displacement to the right
  AxisCost y;  ///< of the displacement downwards

  /// The cost of the displacement (dx, dy) [px].
  double operator()(double dx, double dy) const { return x(dx) + y(dy); }

  /// What is wrong with the cost, nullptr for nothing.
  const char* problem() const {
    const char* const of_x = x.problem();
    return of_x ? of_x : y.problem();
  }

  /// Whether the costs along both axes are equal.
  friend bool operator==(const DisplacementCost&, const DisplacementCost&) = default;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
