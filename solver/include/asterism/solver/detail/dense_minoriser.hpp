#pragma once

#include <Eigen/Cholesky>
#include <algorithm>
#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/memory.hpp>
#include <asterism/solver/detail/minoriser.hpp>
#include <cmath>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// The bound of a minoriser by the Cholesky factor of M = W - 2 s diag(scale), a dense matrix.
///
/// s diag(scale) is above the rounding of W and that of the factorisation, which is at most
/// epsilon (n + 1) |L| |L^T| and therefore epsilon n (n + 1) diag(M) (Rump 2006, Verification of positive
/// definiteness, here with a diagonal for the norm). So where M has a factor, W is above L L^T by another
/// s diag(scale), which measures the rounding of the gradient.
template <typename System>
class DenseMinoriser {
 public:
  using Quadratic = Minoriser<System>;

  MinoriserBound bound(const System& system, const Quadratic& minoriser) {
    constexpr double kEpsilon = Quadratic::kEpsilon;
    const int n = kBlock * system.nodes();
    if constexpr (Quadratic::kMaxSize == Eigen::Dynamic) {
      if (matrix_.rows() != n) require_memory(double(sizeof(double)) * n * n);
    }
    const double shift = kEpsilon * (n * (n + 3.0) + minoriser.terms + 16);
    assemble(system, minoriser, 2 * shift);
    MinoriserBound result;
    if (const int row = factorize(system, minoriser, 2 * shift); row >= 0) {
      result.least_eigenvalue = bend(row, minoriser, 3 * shift);
      return result;
    }
    result.is_definite = true;
    right_hand_side_.resize(n, Quadratic::kColumns);
    for (int i = 0; i < n; ++i) {
      for (int c = 0; c < Quadratic::kColumns; ++c)
        right_hand_side_(i, c) = minoriser.gradient(kBlock > 1 ? i % kBlock : c, i / kBlock);
    }
    matrix_.template triangularView<Eigen::Lower>().solveInPlace(right_hand_side_);
    // The residual of this substitution is in proportion to its result.
    const double norm = right_hand_side_.norm() * (1 + std::sqrt(n * kEpsilon));
    direction_.resize(n);
    result.least_eigenvalue = least_eigenvalue(minoriser, shift);
    result.gap = gap_with_rounding(minoriser, norm, shift, result.least_eigenvalue, [&](int i) {
      return kEpsilon * (8 + minoriser.terms) * minoriser.gradient_scale[i];
    });
    return result;
  }

 private:
  static constexpr int kBlock = Quadratic::kBlock;
  static constexpr int kSmall = 32;
  static constexpr int kInverseUpTo = 200;
  static constexpr double kLeastPivot = std::numeric_limits<double>::min() / Quadratic::kEpsilon;
  using Matrix = typename Quadratic::Matrix;
  // One unknown makes a row vector of it, which Eigen wants in row-major order.
  static constexpr int kOrder =
      Quadratic::kMaxSize == 1 && Quadratic::kColumns > 1 ? Eigen::RowMajor : Eigen::ColMajor;
  using RightHandSide = Eigen::Matrix<double, Matrix::RowsAtCompileTime, Quadratic::kColumns, kOrder,
                                      Quadratic::kMaxSize, Quadratic::kColumns>;
  using Vector = Eigen::Matrix<double, Matrix::RowsAtCompileTime, 1, Eigen::ColMajor, Quadratic::kMaxSize, 1>;

  // The lower triangle of M.
  void assemble(const System& system, const Quadratic& minoriser, double shift) {
    matrix_.setZero(kBlock * system.nodes(), kBlock * system.nodes());
    minoriser.for_each_block(
        system,
        [&](int i, const auto& block) {
          matrix_.template block<kBlock, kBlock>(kBlock * i, kBlock * i) += block;
        },
        [&](int i, int j, double weight) {
          const int row = kBlock * std::max(i, j), column = kBlock * std::min(i, j);
          for (int d = 0; d < kBlock; ++d) matrix_(row + d, column + d) -= weight;
        });
    for (int i = 0; i < matrix_.rows(); ++i) matrix_(i, i) -= shift * minoriser.scale[i / kBlock];
  }

  // The factor, in place. The first row whose pivot is not positive, or -1.
  int factorize(const System& system, const Quadratic& minoriser, double shift) {
    const int n = static_cast<int>(matrix_.rows());
    if (n > kSmall) {
      const bool is_definite = Eigen::LLT<Eigen::Ref<Matrix>>(matrix_).info() == Eigen::Success;
      if (is_definite && matrix_.diagonal().minCoeff() > std::sqrt(kLeastPivot)) return -1;
      assemble(system, minoriser, shift);  // for the loop below to find the row
    }
    for (int j = 0; j < n; ++j) {
      const double pivot = matrix_(j, j);
      if (!(pivot > kLeastPivot)) return j;
      const double root = std::sqrt(pivot);
      const int rest = n - j - 1;
      matrix_(j, j) = root;
      matrix_.col(j).tail(rest) *= 1 / root;
      for (int k = j + 1; k < n; ++k)
        matrix_.col(k).tail(n - k) -= matrix_(k, j) * matrix_.col(j).tail(n - k);
    }
    return -1;
  }

  // The Rayleigh quotient of W in the direction v that the factorisation stopped at, v^T M v being the pivot:
  // at most its value here, with `slack` times scale for the shift and all rounding.
  double bend(int row, const Quadratic& minoriser, double slack) {
    const double pivot = matrix_(row, row);
    direction_.setZero(matrix_.rows());
    direction_[row] = 1;
    for (int j = row - 1; j >= 0; --j) {
      double sum = matrix_(row, j);
      for (int i = j + 1; i < row; ++i) sum += matrix_(i, j) * direction_[i];
      direction_[j] = -sum / matrix_(j, j);
    }
    double rounding = 0;
    for (int i = 0; i < direction_.size(); ++i)
      rounding += slack * minoriser.scale[i / kBlock] * direction_[i] * direction_[i];
    return (pivot + rounding) / direction_.squaredNorm();
  }

  // 1 / |M^-1| is above 1 / |L^-1|_F^2; for large matrices what M lacks of W.
  double least_eigenvalue(const Quadratic& minoriser, double shift) {
    const int n = static_cast<int>(matrix_.rows());
    const double lack = shift * minoriser.scale.minCoeff();
    if (n > kInverseUpTo) return lack;
    double sum = 0;
    for (int c = 0; c < n; ++c) {  // column c of L^-1 is 0 above row c
      direction_.tail(n - c).setZero();
      direction_[c] = 1;
      for (int j = c; j < n; ++j) {
        direction_[j] /= matrix_(j, j);
        direction_.tail(n - j - 1) -= direction_[j] * matrix_.col(j).tail(n - j - 1);
      }
      sum += direction_.tail(n - c).squaredNorm();
    }
    return std::max(0.99 / sum, lack);
  }

  Matrix matrix_;  // M, then L
  RightHandSide right_hand_side_;
  Vector direction_;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
