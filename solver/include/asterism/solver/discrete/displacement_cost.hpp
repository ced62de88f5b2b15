#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The law by which a cost grows along an axis.
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

  /// The cost in other units: of the displacement d, that of d / scale, for a scale > 0.
  constexpr AxisCost scaled(double scale) const {
    AxisCost cost = *this;
    cost.weight /= shape == CostShape::Quadratic ? scale * scale : scale;
    cost.offset *= scale;
    return cost;
  }

  /// The problem of the cost, or nullptr if there is none.
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

/// The cost of the length of a displacement d, weight (|d| - length)^2, as that of a spring. A sum of costs
/// along the axes cannot express it, so that it is computed for each displacement of a window, which is
/// around the offsets of the axes; others are forbidden. The maps of both parts have to begin at the same
/// place of the image, as an offset cannot make up for it.
struct LengthCost {
  double weight = 0;  ///< per px^2, half the stiffness of a spring; from 0 up; 0: only the window counts
  double length = 0;  ///< the length that costs nothing [px]; from 0 to 2^20
  /// Displacements within reach of the rounded offset, on each axis, are allowed [px]; 0 to 255. -1, for a
  /// weight of 0: there is no window, and every displacement is allowed.
  int reach = -1;

  /// The cost of the displacement (dx, dy) [px], without the window.
  double operator()(double dx, double dy) const {
    const double excess = std::sqrt(dx * dx + dy * dy) - length;
    return weight * (excess * excess);
  }

  /// The problem of the cost, or nullptr if there is none.
  const char* problem() const {
    if (!detail::is_finite(weight) || weight < 0 || weight > std::numeric_limits<float>::max())
      return "has a weight of its length that is negative or not finite";
    if (!detail::is_finite(length) || length < 0 || length > 1 << 20)
      return "has a length that is negative, not finite or beyond 2^20 px";
    const bool is_none = reach == -1 && !(weight > 0);
    return !is_none && (reach < 0 || reach > 255) ? "has a reach below 0 or above 255 px" : nullptr;
  }

  /// Whether all numbers are equal.
  friend bool operator==(const LengthCost&, const LengthCost&) = default;
};

/// The cost of the displacement (dx, dy): the sum of the costs along the axes, and of that of its length, if
/// that has a reach.
struct DisplacementCost {
  AxisCost x;         ///< of the displacement to the right
  AxisCost y;         ///< of the displacement downwards
  LengthCost length;  ///< of the distance; none by default

  DisplacementCost() = default;
  /// The sum of these costs.
  constexpr DisplacementCost(const AxisCost& of_x, const AxisCost& of_y, const LengthCost& of_length = {})
      : x(of_x), y(of_y), length(of_length) {}

  /// weight (|d| - length)^2 for displacements d within reach of the rounded (x, y) on each axis; others are
  /// forbidden.
  static constexpr DisplacementCost spring(double weight, double length, double x, double y, int reach) {
    return {AxisCost::quadratic(0, x), AxisCost::quadratic(0, y), {weight, length, reach}};
  }

  /// The cost of the displacement (dx, dy) [px]; infinity if it is not in the window.
  double operator()(double dx, double dy) const {
    const double of_axes = x(dx) + y(dy);
    if (!has_window()) return of_axes;
    const bool is_inside =
        std::max(std::abs(dx - std::round(x.offset)), std::abs(dy - std::round(y.offset))) <= length.reach;
    return is_inside ? of_axes + length(dx, dy) : std::numeric_limits<double>::infinity();
  }

  /// The cost in other units: of the displacement d, that of d / scale, for a scale from 1e-3 to 1e3; the
  /// window's reach is rounded up.
  DisplacementCost scaled(double scale) const {
    return {x.scaled(scale),
            y.scaled(scale),
            {length.weight / (scale * scale), length.length * scale,
             has_window() ? static_cast<int>(std::ceil(length.reach * scale)) : -1}};
  }

  /// The cost of the same displacement seen from its other end.
  DisplacementCost reversed() const {
    DisplacementCost cost = *this;
    cost.x.offset = -cost.x.offset;
    cost.y.offset = -cost.y.offset;
    return cost;
  }

  /// The most that a displacement costs that is at most (dx, dy) long on the axes [px], up to a window.
  double most(double dx, double dy) const {
    const double farthest = std::max(std::sqrt(dx * dx + dy * dy), 2 * length.length) - length.length;
    return std::max(x(dx), x(-dx)) + std::max(y(dy), y(-dy)) + length.weight * (farthest * farthest);
  }

  /// Whether there are forbidden displacements.
  bool has_window() const { return length.reach >= 0; }
  /// The least displacement of the window, if there is one, on each axis.
  Eigen::Vector2i first_displacement() const {
    return {static_cast<int>(std::round(x.offset)) - length.reach,
            static_cast<int>(std::round(y.offset)) - length.reach};
  }

  /// The problem of the cost, or nullptr if there is none.
  const char* problem() const {
    if (const char* const of_x = x.problem()) return of_x;
    if (const char* const of_y = y.problem()) return of_y;
    return length.problem();
  }

  /// Whether all costs are equal.
  friend bool operator==(const DisplacementCost&, const DisplacementCost&) = default;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
