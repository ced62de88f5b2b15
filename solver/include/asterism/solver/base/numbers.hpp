#pragma once

#include <asterism/solver/base/config.hpp>
#include <cmath>
#include <limits>

// Plain loops over the numbers of a matrix, vector or column that has them side by side in memory. Eigen's
// expressions say the same, but a compiler takes ten milliseconds and a megabyte for each of their types.

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// The largest absolute value, 0 if there are no numbers; NaN does not count.
template <typename Derived>
typename Derived::Scalar largest_size(const Eigen::DenseBase<Derived>& numbers) {
  const auto* const data = numbers.derived().data();
  typename Derived::Scalar largest = 0;
  for (Eigen::Index k = 0; k < numbers.size(); ++k) {
    const auto size = std::abs(data[k]);
    if (size > largest) largest = size;
  }
  return largest;
}

/// Whether all numbers are 0.
template <typename Derived>
bool is_zero(const Eigen::DenseBase<Derived>& numbers) {
  const auto* const data = numbers.derived().data();
  for (Eigen::Index k = 0; k < numbers.size(); ++k) {
    if (data[k] != 0) return false;
  }
  return true;
}

/// Whether both have equal numbers.
template <typename Derived, typename Other>
bool is_equal(const Eigen::DenseBase<Derived>& numbers, const Eigen::DenseBase<Other>& others) {
  const auto* const data = numbers.derived().data();
  const auto* const other = others.derived().data();
  for (Eigen::Index k = 0; k < numbers.size(); ++k) {
    if (data[k] != other[k]) return false;
  }
  return true;
}

/// Whether all numbers are above 0.
template <typename Derived>
bool is_positive(const Eigen::DenseBase<Derived>& numbers) {
  const auto* const data = numbers.derived().data();
  for (Eigen::Index k = 0; k < numbers.size(); ++k) {
    if (!(data[k] > 0)) return false;
  }
  return true;
}

/// result = x + t step, all of one size.
template <typename Matrix>
void step_from(const Matrix& x, typename Matrix::Scalar t, const Matrix& step, Matrix& result) {
  result.resize(x.rows(), x.cols());
  for (Eigen::Index k = 0; k < x.size(); ++k) result.data()[k] = x.data()[k] + t * step.data()[k];
}

/// sum_k a_k b_k.
template <typename Matrix>
typename Matrix::Scalar dot(const Matrix& a, const Matrix& b) {
  typename Matrix::Scalar sum = 0;
  for (Eigen::Index k = 0; k < a.size(); ++k) sum += a.data()[k] * b.data()[k];
  return sum;
}

/// No entries, or NaN where the size is fixed.
template <typename Values>
void clear_numbers(Values& values) {
  constexpr int kRows = Values::RowsAtCompileTime;
  constexpr int kColumns = Values::ColsAtCompileTime;
  values.resize(kRows == Eigen::Dynamic ? 0 : kRows, kColumns == Eigen::Dynamic ? 0 : kColumns);
  values.setConstant(std::numeric_limits<typename Values::Scalar>::quiet_NaN());
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
