#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/energy/minoriser.hpp>
#include <asterism/solver/matrix/dense_factor.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <cmath>
#include <limits>

// Loops over a fixed size are ten times as fast where the compiler unrolls all of them, and keeps the matrix
// in registers.
#if defined(__clang__)
#define ASTERISM_UNROLL _Pragma("clang loop unroll_count(4)")
#elif defined(__GNUC__)
#define ASTERISM_UNROLL _Pragma("GCC unroll 4")
#else
#define ASTERISM_UNROLL
#endif

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// The bound of a minoriser by the factors L D L^T of M = W - 2 s diag(scale), a dense matrix of kSize
/// unknowns, at most kMaxSize. Of no system's type, so that it is compiled once for all that are of a size.
///
/// s diag(scale) is above the rounding of W and that of the factorisation, which is at most
/// epsilon (n + 1) |L| D |L^T| and therefore epsilon n (n + 1) diag(M) (Rump 2006, Verification of positive
/// definiteness, here with a diagonal for the norm). So where M has a factor, W is above L D L^T by another
/// s diag(scale), which measures the rounding of the gradient.
template <int kSize, int kMaxSize>
class DenseBound {
 public:
  /// Uses the W of `system`, whose minoriser this is.
  template <typename System>
  MinoriserBound bound(const System& system, const Minoriser<System>& minoriser) {
    constexpr int kBlock = Minoriser<System>::kBlock;
    resize(kBlock * system.nodes());
    minoriser.for_each_entry(
        system,
        [this](int i, int row, int column, double value) {
          (*this)(kBlock * i + row, kBlock * i + column) += value;
        },
        [this](int, const Link& link, double weight) {
          const int high = kBlock * std::max(link.i, link.j), low = kBlock * std::min(link.i, link.j);
          for (int d = 0; d < kBlock; ++d) (*this)(high + d, low + d) -= weight;
        });
    return bound(minoriser.view());
  }

 private:
  static constexpr double kEpsilon = std::numeric_limits<double>::epsilon();
  static constexpr int kSmall = 32;
  static constexpr int kInverseUpTo = 200;
  static constexpr double kLeastPivot = std::numeric_limits<double>::min() / kEpsilon;

  int size() const { return kSize != Eigen::Dynamic ? kSize : static_cast<int>(vector_.size()); }
  double& operator()(int row, int column) { return matrix_[row + size() * column]; }

  void resize(int n) {
    if constexpr (kMaxSize == Eigen::Dynamic) {
      if (size() != n) require_memory(double(sizeof(double)) * n * n);
    }
    matrix_.setZero(Eigen::Index{n} * n);
    vector_.resize(n);
    inverse_.resize(n);
  }

  MinoriserBound bound(const MinoriserView& minoriser) {
    const int n = size();
    const double shift = kEpsilon * (n * (n + 3.0) + minoriser.terms + 16);
    ASTERISM_UNROLL
    for (int i = 0; i < n; ++i) (*this)(i, i) -= 2 * shift * minoriser.scale[i / minoriser.block];
    MinoriserBound result;
    if (const int row = factorize(); row >= 0) {
      result.least_eigenvalue = bend(row, minoriser, 3 * shift);
      return result;
    }
    result.is_definite = true;
    double square = 0;
    for (int c = 0; c < minoriser.columns; ++c) {
      ASTERISM_UNROLL
      for (int i = 0; i < n; ++i) vector_[i] = minoriser.gradient[i * minoriser.columns + c];
      square += substitute(0);
    }
    // The residual of this substitution is in proportion to its result.
    const double norm = std::sqrt(square) * (1 + std::sqrt(n * kEpsilon));
    result.least_eigenvalue = least_eigenvalue(minoriser, shift);
    result.excess = excess_with_rounding(minoriser, norm, shift, result.least_eigenvalue, [&](int i) {
      return kEpsilon * (8 + minoriser.terms) * minoriser.gradient_scale[i];
    });
    return result;
  }

  // L D L^T in place. The first row whose pivot is not positive, or -1.
  int factorize() {
    const int n = size();
    if constexpr (kMaxSize == Eigen::Dynamic || kMaxSize > kSmall) {
      if (n > kSmall && factorize_blocks()) return -1;
    }
    ASTERISM_UNROLL
    for (int j = 0; j < n; ++j) {
      double* const column = &(*this)(0, j);
      if (!(column[j] > kLeastPivot)) return j;
      inverse_[j] = 1 / column[j];
      ASTERISM_UNROLL
      for (int k = j + 1; k < n; ++k) {
        double* const to = &(*this)(0, k);
        const double factor = column[k] * inverse_[j];
        ASTERISM_UNROLL
        for (int i = k; i < n; ++i) to[i] -= factor * column[i];
      }
      ASTERISM_UNROLL
      for (int i = j + 1; i < n; ++i) column[i] *= inverse_[j];
    }
    return -1;
  }

  // The same by Eigen's L L^T in blocks; false, with the matrix as it was, where it is not positive definite.
  bool factorize_blocks() {
    const int n = size();
    for (int j = 0; j < n; ++j) {  // the upper triangle keeps the lower one, inverse_ the diagonal
      inverse_[j] = (*this)(j, j);
      for (int i = j + 1; i < n; ++i) (*this)(j, i) = (*this)(i, j);
    }
    const Eigen::Map<const Eigen::MatrixXd> all(matrix_.data(), n, n);
    const bool is_definite = DenseFactor<double>::factorize(matrix_.data(), n) &&
                             all.diagonal().minCoeff() > std::sqrt(kLeastPivot);
    for (int j = 0; j < n; ++j) {
      double* const column = &(*this)(0, j);
      if (is_definite) {
        const double inverse = 1 / column[j];
        inverse_[j] = inverse * inverse;
        for (int i = j + 1; i < n; ++i) column[i] *= inverse;
      } else {
        column[j] = inverse_[j];
        for (int i = j + 1; i < n; ++i) column[i] = (*this)(j, i);
      }
    }
    return is_definite;
  }

  // vector_ <- L^-1 vector_, whose entries before `first` are 0. The square of its norm in D^-1.
  double substitute(int first) {
    const int n = size();
    double square = 0;
    ASTERISM_UNROLL
    for (int j = first; j < n; ++j) {
      const double* const column = &(*this)(0, j);
      const double value = vector_[j];
      square += value * inverse_[j] * value;
      ASTERISM_UNROLL
      for (int i = j + 1; i < n; ++i) vector_[i] -= value * column[i];
    }
    return square;
  }

  // The Rayleigh quotient of W in the direction v that the factorisation stopped at, v^T M v being the pivot:
  // at most its value here, with `slack` times scale for the shift and all rounding.
  double bend(int row, const MinoriserView& minoriser, double slack) {
    vector_.setZero();
    vector_[row] = 1;
    double rounding = 0, square = 0;
    for (int j = row; j >= 0; --j) {
      if (j < row) {
        double sum = (*this)(row, j);
        for (int i = j + 1; i < row; ++i) sum += (*this)(i, j) * vector_[i];
        vector_[j] = -sum;
      }
      square += vector_[j] * vector_[j];
      rounding += slack * minoriser.scale[j / minoriser.block] * vector_[j] * vector_[j];
    }
    return ((*this)(row, row) + rounding) / square;
  }

  // 1 / |M^-1| is above 1 / trace(M^-1); for large matrices what M lacks of W.
  double least_eigenvalue(const MinoriserView& minoriser, double shift) {
    const int n = size();
    const double lack = shift * *std::min_element(minoriser.scale, minoriser.scale + minoriser.nodes);
    if (n > kInverseUpTo) return lack;
    double square = 0;
    ASTERISM_UNROLL
    for (int c = 0; c < n; ++c) {  // column c of L^-1
      vector_[c] = 1;
      ASTERISM_UNROLL
      for (int i = c + 1; i < n; ++i) vector_[i] = 0;
      square += substitute(c);
    }
    return std::max(0.99 / square, lack);
  }

  // M, then D and L below it, column by column, in the lower triangle.
  Eigen::Matrix<double, times<kSize>(kSize), 1, Eigen::ColMajor, times<kMaxSize>(kMaxSize), 1> matrix_;
  Eigen::Matrix<double, kSize, 1, Eigen::ColMajor, kMaxSize, 1> vector_;
  Eigen::Matrix<double, kSize, 1, Eigen::ColMajor, kMaxSize, 1> inverse_;  // of D
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism

#undef ASTERISM_UNROLL
