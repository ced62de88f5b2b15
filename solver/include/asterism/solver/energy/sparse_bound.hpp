#pragma once

#include <Eigen/SparseCore>
#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/energy/minoriser.hpp>
#include <asterism/solver/energy/sparse_blocks.hpp>
#include <cmath>
#include <limits>
#include <optional>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// The same as DenseBound by a sparse factorisation, Eigen's or CHOLMOD's, with kBlock unknowns a node. Its
/// rounding is bounded by the number of entries in the factor's longest column and in its rows, of which
/// there are at most n. The ordering is computed once a topology.
template <typename Factor, int kBlock>
class SparseBound {
 public:
  /// Uses the W of `system`, whose minoriser it is. `is_clamped`: W is definite up to rounding, and its
  /// least eigenvalue is not wanted.
  template <typename System>
  MinoriserBound bound(const System& system, const Minoriser<System>& minoriser, bool is_clamped) {
    matrix_.prepare(system.nodes(), system.links(), [this](const auto& pattern) {
      factor_.emplace();
      factor_->analyze(pattern);
    });
    return bound(minoriser.view(), is_clamped, [&] {
      matrix_.set_zero();
      minoriser.for_each_entry(
          system, [this](int i, int row, int column, double value) { matrix_.at(i, row, column) += value; },
          [this](int l, const Link&, double weight) {
            for (int d = 0; d < kBlock; ++d) matrix_.at_link(l, d, d) -= weight;
          });
    });
  }

 private:
  static constexpr double kEpsilon = std::numeric_limits<double>::epsilon();
  static constexpr double kLargeShift = 1e-6;

  template <typename Fill>
  MinoriserBound bound(const MinoriserView& minoriser, bool is_clamped, Fill&& fill) {
    const auto n = static_cast<double>(matrix_.matrix().rows());
    // Columns are known once the matrix has been ordered, which takes its pattern alone.
    const double least_shift = kEpsilon * (factor_->longest_column() * (n + 3) + minoriser.terms + 16);
    // A large shift, if W has room for it, is a better bound of the eigenvalue, and measures rounding better.
    double shift = is_clamped ? least_shift : std::max(kLargeShift, least_shift);
    fill();
    shift_diagonal(minoriser, 2 * shift);
    MinoriserBound result;
    result.is_definite = factor_->factorize_definite(matrix_.matrix());
    if (!result.is_definite && is_bent(minoriser, shift, result)) return result;
    if (!result.is_definite && shift > least_shift) {
      fill();  // exact again
      shift_diagonal(minoriser, 2 * least_shift);
      shift = least_shift;
      result.is_definite = factor_->factorize_definite(matrix_.matrix());
    }
    if (!result.is_definite) {
      is_bent(minoriser, shift, result);
      return result;
    }
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    right_hand_side_ =
        Eigen::Map<const RowMajor>(minoriser.gradient, matrix_.matrix().rows(), minoriser.columns);
    step_ = factor_->solve(right_hand_side_);
    // g^T M^-1 g = z^T M z + 2 z . r + r^T M^-1 r with the residual r = g - M z, which counts as rounding.
    product_ = matrix_.matrix().template selfadjointView<Eigen::Lower>() * step_;
    const double unit = kEpsilon * (8 + minoriser.terms);
    const double largest = kBlock * minoriser.columns * step_.cwiseAbs().maxCoeff();
    const auto product_rounding = [&](int i) { return unit * 2 * largest * minoriser.scale[i]; };
    double square = (step_.array() * product_.array()).sum();
    square += n * kEpsilon * (step_.array() * product_.array()).abs().sum();
    for (int i = 0; i < minoriser.nodes; ++i)
      square += step_.template middleRows<kBlock>(kBlock * i).norm() * product_rounding(i);
    result.least_eigenvalue = shift * *std::min_element(minoriser.scale, minoriser.scale + minoriser.nodes);
    const double norm = std::sqrt(std::max(square, 0.0));
    product_ = right_hand_side_ - product_;  // the residual
    result.excess = excess_with_rounding(minoriser, norm, shift, result.least_eigenvalue, [&](int i) {
      const double residual = product_.template middleRows<kBlock>(kBlock * i).norm();
      return residual + unit * minoriser.gradient_scale[i] + product_rounding(i);
    });
    return result;
  }

  void shift_diagonal(const MinoriserView& minoriser, double shift) {
    for (int i = 0; i < matrix_.matrix().cols(); ++i)
      *matrix_.diagonal(i) -= shift * minoriser.scale[i / kBlock];
  }

  // Whether the last factorisation shows that W, not M alone, has a negative eigenvalue.
  bool is_bent(const MinoriserView& minoriser, double shift, MinoriserBound& result) {
    if (factor_->negative_curvature(direction_) < 0) result.least_eigenvalue = bend(minoriser, 3 * shift);
    return result.least_eigenvalue < 0;
  }

  // As DenseBound's.
  double bend(const MinoriserView& minoriser, double slack) const {
    double value = direction_.dot(matrix_.matrix().template selfadjointView<Eigen::Lower>() * direction_);
    for (int i = 0; i < direction_.size(); ++i)
      value += slack * minoriser.scale[i / kBlock] * direction_[i] * direction_[i];
    return value / direction_.squaredNorm();
  }

  SparseBlocks<double, kBlock> matrix_;  // W, then M, the lower triangle
  std::optional<Factor> factor_;
  Eigen::MatrixXd right_hand_side_;
  Eigen::MatrixXd step_;     // M^-1 g
  Eigen::MatrixXd product_;  // M step
  Eigen::VectorXd direction_;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
