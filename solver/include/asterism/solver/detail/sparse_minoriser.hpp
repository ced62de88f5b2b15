#pragma once

#include <Eigen/SparseCore>
#include <algorithm>
#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/memory.hpp>
#include <asterism/solver/detail/minoriser.hpp>
#include <asterism/solver/detail/sparse_factor.hpp>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// Eigen's sparse Cholesky for a SparseMinoriser.
class SparseProofFactor : public SparseFactor<double> {
 public:
  /// Entries in the longest column of the factor, after analyze.
  double longest_column() const { return 1 + this->m_nonZerosPerCol.cast<double>().maxCoeff(); }
  /// False where the matrix is not positive definite.
  bool factorize_definite(const Eigen::SparseMatrix<double>& lower) {
    this->factorize(lower);
    return this->info() == Eigen::Success && this->vectorD().minCoeff() > std::numeric_limits<double>::min();
  }
  /// A direction v of v^T matrix v < 0, after that; false where the factorisation has not got that far.
  bool negative_direction(Eigen::VectorXd& direction) const {
    if (this->info() != Eigen::Success) return false;
    Eigen::Index row = 0;
    const Eigen::VectorXd pivots = this->vectorD();
    pivots.minCoeff(&row);
    direction = Eigen::VectorXd::Unit(pivots.size(), row);
    this->matrixU().solveInPlace(direction);
    direction = this->permutationPinv() * direction;
    return true;
  }
};

/// The same as DenseMinoriser by a sparse factorisation, Eigen's or CHOLMOD's. Its rounding is bounded by the
/// number of entries in the factor's longest column and in its rows, of which there are at most n.
template <typename System, typename Factor>
class SparseMinoriser {
 public:
  using Quadratic = Minoriser<System>;

  MinoriserBound bound(const System& system, const Quadratic& minoriser) {
    constexpr double kEpsilon = Quadratic::kEpsilon;
    assemble(system, minoriser);
    const double n = static_cast<double>(matrix_.rows());
    // Columns are known once the matrix has been ordered, which takes its pattern alone.
    Factor factor;
    factor.analyze(matrix_);
    const double least_shift = kEpsilon * (factor.longest_column() * (n + 3) + minoriser.terms + 16);
    // A large shift, if W has room for it, is a better bound of the eigenvalue, and measures rounding better.
    double shift = std::max(kLargeShift, least_shift);
    shift_diagonal(minoriser, 2 * shift);
    MinoriserBound result;
    result.is_definite = factor.factorize_definite(matrix_);
    if (!result.is_definite && shift > least_shift) {
      assemble(system, minoriser);  // exact again
      shift_diagonal(minoriser, 2 * least_shift);
      shift = least_shift;
      result.is_definite = factor.factorize_definite(matrix_);
    }
    if (!result.is_definite) {
      if (factor.negative_direction(direction_)) result.least_eigenvalue = bend(minoriser, 3 * shift);
      return result;
    }
    right_hand_side_ = gradient(minoriser);
    step_ = factor.solve(right_hand_side_);
    // g^T M^-1 g = z^T M z + 2 z . r + r^T M^-1 r with the residual r = g - M z, which counts as rounding.
    product_ = matrix_.selfadjointView<Eigen::Lower>() * step_;
    const double largest = step_.cwiseAbs().maxCoeff();
    const double unit = kEpsilon * (8 + minoriser.terms);
    const auto product_rounding = [&](int i) {
      return unit * 2 * Quadratic::kDim * largest * minoriser.scale[i];
    };
    double square = (step_.array() * product_.array()).sum();
    square += n * kEpsilon * (step_.array() * product_.array()).abs().sum();
    for (int i = 0; i < system.nodes(); ++i)
      square += step_.template middleRows<kBlock>(kBlock * i).norm() * product_rounding(i);
    result.least_eigenvalue = shift * minoriser.scale.minCoeff();
    const double norm = std::sqrt(std::max(square, 0.0));
    result.gap = gap_with_rounding(minoriser, norm, shift, result.least_eigenvalue, [&](int i) {
      const double residual = (right_hand_side_ - product_).template middleRows<kBlock>(kBlock * i).norm();
      return residual + unit * minoriser.gradient_scale[i] + product_rounding(i);
    });
    return result;
  }

 private:
  static constexpr int kBlock = Quadratic::kBlock;
  static constexpr double kLargeShift = 1e-6;
  using Matrix = Eigen::SparseMatrix<double>;
  using RightHandSide = Eigen::Matrix<double, Eigen::Dynamic, Quadratic::kColumns, Eigen::ColMajor>;

  void assemble(const System& system, const Quadratic& minoriser) {
    const int n = kBlock * system.nodes();
    const auto couplings = static_cast<double>(kBlock) * system.link_count();
    require_entries(double{kBlock} * n + 3 * couplings, sizeof(double), 3);  // and their triplets
    std::vector<Eigen::Triplet<double>> entries;
    entries.reserve(static_cast<std::size_t>(double{kBlock} * n + 3 * couplings));
    minoriser.for_each_block(
        system,
        [&](int i, const auto& block) {
          for (int column = 0; column < kBlock; ++column) {
            for (int row = column; row < kBlock; ++row)
              entries.emplace_back(kBlock * i + row, kBlock * i + column, block(row, column));
          }
        },
        [&](int i, int j, double weight) {
          const int row = kBlock * std::max(i, j), column = kBlock * std::min(i, j);
          for (int d = 0; d < kBlock; ++d) entries.emplace_back(row + d, column + d, -weight);
        });
    matrix_.resize(n, n);
    matrix_.setFromTriplets(entries.begin(), entries.end());
  }

  void shift_diagonal(const Quadratic& minoriser, double shift) {
    for (int i = 0; i < matrix_.cols(); ++i)
      matrix_.valuePtr()[matrix_.outerIndexPtr()[i]] -= shift * minoriser.scale[i / kBlock];
  }

  static RightHandSide gradient(const Quadratic& minoriser) {
    if constexpr (kBlock == 1) {
      return minoriser.gradient.transpose();
    } else {
      return minoriser.gradient.reshaped();
    }
  }

  // As DenseMinoriser's.
  double bend(const Quadratic& minoriser, double slack) const {
    double value = direction_.dot(matrix_.template selfadjointView<Eigen::Lower>() * direction_);
    for (int i = 0; i < direction_.size(); ++i)
      value += slack * minoriser.scale[i / kBlock] * direction_[i] * direction_[i];
    return value / direction_.squaredNorm();
  }

  Matrix matrix_;  // W, then M, the lower triangle
  RightHandSide right_hand_side_;
  RightHandSide step_;     // M^-1 g
  RightHandSide product_;  // M step
  Eigen::VectorXd direction_;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
