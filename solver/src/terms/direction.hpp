#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <cmath>
#include <cstdint>
#include <limits>

#include "loss.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// A unit vector that depends on the two node numbers alone and changes sign when they are swapped; the same
/// as that of SpringSystem. For nodes that coincide, and whose direction is therefore unknown.
template <typename Point>
void set_fixed_direction(int i, int j, Point& direction) {
  const auto low = static_cast<std::uint32_t>(std::min(i, j));
  const auto high = static_cast<std::uint32_t>(std::max(i, j));
  std::uint32_t state = low * 0x9e3779b9U ^ (high * 0x85ebca6bU + 0x27d4eb2fU);
  for (Eigen::Index d = 0; d < direction.size(); ++d) {
    state ^= state >> 15;
    state *= 0x2c1b3c6dU;
    state ^= state >> 12;
    const int odd = 2 * static_cast<int>(state >> 17) + 1 - (1 << 15);  // never zero
    direction[d] = i < j ? odd : -odd;
  }
  direction /= direction.norm();
}

/// |v| and v / |v| without overflow or underflow; the fixed direction of the nodes where v = 0.
template <typename Point>
double length_and_direction(int i, int j, const Point& v, Point& direction) {
  constexpr double kLeastSquare = std::numeric_limits<double>::min() / std::numeric_limits<double>::epsilon();
  const double square = v.squaredNorm();
  if (square >= kLeastSquare && square <= std::numeric_limits<double>::max()) [[likely]] {
    const double length = std::sqrt(square);
    direction = v * (1 / length);
    return length;
  }
  const double largest = v.cwiseAbs().maxCoeff();
  if (!(largest > 0)) {
    set_fixed_direction(i, j, direction);
    return 0;
  }
  direction = v / largest;
  const double norm = direction.norm();
  direction /= norm;
  return largest * norm;
}

/// The same for |v|_S = (v^T S v)^(1/2) and S v / |v|_S.
template <typename Point, typename Shape>
double length_and_direction(int i, int j, const Point& v, Point& direction, const Shape& shape) {
  const double largest = v.cwiseAbs().maxCoeff();
  Point unit = v;
  if (largest > 0) {
    unit /= largest;
  } else {
    set_fixed_direction(i, j, unit);
  }
  const Point shaped = shape * unit;
  const double root = std::sqrt(std::max(unit.dot(shaped), 0.0));
  direction = shaped;
  if (root > 0) direction /= root;
  return largest * root;
}

/// |v| where |v|^2 is out of range, or v is not finite.
double norm_out_of_range(const double* v, Eigen::Index size);

/// |v| without overflow or underflow. Eigen's stableNorm takes some tenths of a second to compile for each
/// type of vector.
inline double stable_norm(const double* v, Eigen::Index size) {
  constexpr double kLeastSquare = std::numeric_limits<double>::min() / std::numeric_limits<double>::epsilon();
  double square = 0;
  for (Eigen::Index i = 0; i < size; ++i) square += v[i] * v[i];
  return square >= kLeastSquare && is_finite(square) ? std::sqrt(square) : norm_out_of_range(v, size);
}
template <typename Vector>
double stable_norm(const Vector& v) {
  static_assert(Vector::InnerStrideAtCompileTime == 1);
  return stable_norm(v.data(), v.size());
}

/// Whether a matrix is symmetric and positive semi-definite, up to rounding.
bool is_semidefinite(const Eigen::Ref<const Eigen::MatrixXd>& matrix);
/// The largest eigenvalue of a symmetric matrix.
double largest_eigenvalue(const Eigen::Ref<const Eigen::MatrixXd>& matrix);

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
