#pragma once

#include <Eigen/Cholesky>
#include <algorithm>
#include <asterism/solver/config.hpp>
#include <asterism/solver/spring_system.hpp>
#include <asterism/solver/stationarity.hpp>
#include <limits>
#include <string_view>

namespace asterism::inline ASTERISM_ABI {

/// Factorisation policy of Ida: dense Cholesky (LLT) of K_dyn. For up to 40 nodes the inverse is formed once,
/// as the paper suggests: one product an iteration, which for such sizes is several times faster than two
/// triangular solves. Ida's gradient form corrects the rounding of either.
template <typename System>
class DenseCholesky {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  static constexpr std::string_view kIdaName = "IDA, dense Cholesky";

  /// Assembles and factors K_dyn; false where it is not positive definite to the digits of the scalar.
  bool factorize(const System& system) {
    const int n = system.nodes();
    stiffness_.setZero(n, n);  // the lower triangle
    detail::node_stiffness(system, inverse_pivots_);
    stiffness_.diagonal() = inverse_pivots_;
    int l = 0;
    for (const Link& link : system.links()) {
      stiffness_(std::max(link.i, link.j), std::min(link.i, link.j)) -= system.link_stiffness[l++];
    }
    if (system.fixed_count() != 0) [[unlikely]]
      isolate_fixed(system);
    cholesky_.compute(stiffness_);
    if (cholesky_.info() != Eigen::Success) return false;
    // A pivot that is rounding alone: the anchors are too weak for the springs in this scalar.
    const auto pivots = cholesky_.matrixLLT().diagonal().array().square();
    constexpr Scalar kRounding = 8 * std::numeric_limits<Scalar>::epsilon();
    if (!(pivots > kRounding * stiffness_.diagonal().array()).all()) return false;
    if (n <= kInverseUpTo) {
      stiffness_.setIdentity();
      cholesky_.solveInPlace(stiffness_);
    } else {
      inverse_pivots_ = cholesky_.matrixLLT().diagonal().cwiseInverse();
    }
    return true;
  }

  /// x <- x - K_dyn^-1 g, all dimensions at once.
  void descend(const Points& gradient, Points& x) {
    if (x.cols() <= kSmall) {
      x.noalias() -= gradient.lazyProduct(stiffness_);  // the inverse is symmetric
    } else {
      right_hand_side_ = gradient.transpose();
      if (x.cols() <= kInverseUpTo) {
        step_.resizeLike(right_hand_side_);
        for (int c = 0; c < System::kDim; ++c) step_.col(c).noalias() = stiffness_ * right_hand_side_.col(c);
        x -= step_.transpose();
      } else {
        for (int c = 0; c < System::kDim; ++c) substitute(right_hand_side_.col(c));
        x -= right_hand_side_.transpose();
      }
    }
  }

 private:
  // The matrix of the other nodes alone; the gradient of a fixed one is zero, and so is its step.
  void isolate_fixed(const System& system) {
    for (int i = 0; i < system.nodes(); ++i) {
      if (!system.is_fixed(i)) continue;
      stiffness_.row(i).setZero();
      stiffness_.col(i).setZero();
      stiffness_(i, i) = 1;
    }
  }

  // b <- (L L^T)^-1 b, four columns of L at a time: for so few right-hand sides faster than Eigen's, which is
  // made for many.
  template <typename Column>
  void substitute(Column&& b) const {
    constexpr int kBlock = 4;
    const auto& L = cholesky_.matrixLLT();
    const int n = static_cast<int>(L.rows());
    const int blocks = n / kBlock;
    for (int j = 0; j < kBlock * blocks; j += kBlock) {
      for (int p = j; p < j + kBlock; ++p) {
        for (int q = j; q < p; ++q) b[p] -= L(p, q) * b[q];
        b[p] *= inverse_pivots_[p];
      }
      const int rest = n - j - kBlock;
      b.tail(rest) -= b[j] * L.col(j).tail(rest) + b[j + 1] * L.col(j + 1).tail(rest) +
                      b[j + 2] * L.col(j + 2).tail(rest) + b[j + 3] * L.col(j + 3).tail(rest);
    }
    for (int p = kBlock * blocks; p < n; ++p) {
      for (int q = kBlock * blocks; q < p; ++q) b[p] -= L(p, q) * b[q];
      b[p] *= inverse_pivots_[p];
    }
    for (int p = n - 1; p >= 0; --p) {
      if ((p + 1) % kBlock == 0) {  // the block's sums with what is solved
        const int rest = n - p - 1;
        for (int q = p; rest > 0 && q > p - kBlock; --q) b[q] -= L.col(q).tail(rest).dot(b.tail(rest));
      }
      const int solved = p < kBlock * blocks ? p - p % kBlock + kBlock : n;
      for (int q = p + 1; q < solved; ++q) b[p] -= L(q, p) * b[q];
      b[p] *= inverse_pivots_[p];
    }
  }

  static constexpr int kSmall = 16;
  static constexpr int kInverseUpTo = 40;
  using Matrix = Eigen::Matrix<Scalar, System::kNodes, System::kNodes, Eigen::ColMajor, System::kMaxNodes,
                               System::kMaxNodes>;
  // One node makes a row vector of it, which Eigen wants in row-major order.
  static constexpr int kOrder =
      System::kMaxNodes == 1 && System::kDim > 1 ? Eigen::RowMajor : Eigen::ColMajor;
  using RightHandSide =
      Eigen::Matrix<Scalar, System::kNodes, System::kDim, kOrder, System::kMaxNodes, System::kDim>;

  Matrix stiffness_;  // K_dyn, or its inverse
  Eigen::LLT<Matrix> cholesky_;
  RightHandSide right_hand_side_;
  RightHandSide step_;
  typename System::NodeVector inverse_pivots_;
};

}  // namespace asterism::inline ASTERISM_ABI
