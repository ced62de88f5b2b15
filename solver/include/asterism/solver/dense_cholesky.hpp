#pragma once

#include <Eigen/Cholesky>
#include <algorithm>
#include <asterism/solver/config.hpp>
#include <asterism/solver/spring_system.hpp>
#include <asterism/solver/stationarity.hpp>
#include <limits>
#include <string_view>

namespace asterism::inline ASTERISM_ABI {

/// Factorisation policy of Ida: dense Cholesky (LLT) of K_dyn. For up to 40 nodes it is the inverse that is
/// formed once, as the paper suggests: one product an iteration, which for such sizes is several times faster
/// than two triangular solves. Ida's gradient form corrects the rounding of either.
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
    detail::node_stiffness(system, diagonal_);
    stiffness_.diagonal() = diagonal_;
    int l = 0;
    for (const Link& link : system.links()) {
      stiffness_(std::max(link.i, link.j), std::min(link.i, link.j)) -= system.link_stiffness[l++];
    }
    if (system.fixed_count() != 0) [[unlikely]]
      isolate_fixed(system);
    if (n <= kInverseUpTo) return invert();
    cholesky_.compute(stiffness_);
    if (cholesky_.info() != Eigen::Success) return false;
    const auto pivots = cholesky_.matrixLLT().diagonal().array().square();
    if (!(pivots > kRounding * diagonal_.array()).all()) return false;
    inverse_pivots_ = cholesky_.matrixLLT().diagonal().cwiseInverse();
    return true;
  }

  /// x <- x - K_dyn^-1 g, all dimensions at once.
  void descend(const Points& gradient, Points& x) {
    if (x.cols() <= kSmall) {
      x.noalias() -= gradient.lazyProduct(stiffness_);  // the inverse is symmetric
    } else if (x.cols() <= kInverseUpTo) {
      multiply_by_inverse(gradient, x);
    } else {
      right_hand_side_ = gradient.transpose();
      for (int c = 0; c < System::kDim; ++c) substitute(right_hand_side_.col(c));
      x -= right_hand_side_.transpose();
    }
  }

 private:
  // The matrix of the other nodes alone; the gradient of a fixed one is zero, and so is its step.
  void isolate_fixed(const System& system) {
    for (int i = 0; i < system.nodes(); ++i) {
      if (!system.is_fixed(i)) continue;
      stiffness_.row(i).setZero();
      stiffness_.col(i).setZero();
      stiffness_(i, i) = diagonal_[i] = 1;
    }
  }

  // stiffness_ <- its inverse by sweeps (Goodnight 1979), whose pivots are the squares of Cholesky's; for so
  // few nodes several times faster than Eigen's triangular solves.
  bool invert() {
    const int n = static_cast<int>(stiffness_.rows());
    right_hand_side_.resize(n, System::kDim);
    auto column = right_hand_side_.col(0);
    for (int p = 0; p < n; ++p) {
      const Scalar pivot = stiffness_(p, p);
      if (!(pivot > kRounding * diagonal_[p])) return false;
      column.head(p) = stiffness_.row(p).head(p).transpose();
      column.tail(n - p) = stiffness_.col(p).tail(n - p);
      for (int j = 0; j < n; ++j) {
        stiffness_.col(j).tail(n - j) -= column[j] / pivot * column.tail(n - j);
      }
      stiffness_.row(p).head(p) = column.head(p).transpose() / pivot;
      stiffness_.col(p).tail(n - p) = column.tail(n - p) / pivot;
      stiffness_(p, p) = -1 / pivot;
    }
    for (int j = 0; j < n; ++j) {
      stiffness_.col(j).tail(n - j) *= -1;
      stiffness_.row(j).tail(n - j) = stiffness_.col(j).tail(n - j).transpose();
    }
    return true;
  }

  // x <- x - g stiffness_, four nodes of x at a time.
  void multiply_by_inverse(const Points& gradient, Points& x) const {
    using Point = typename System::Point;
    const int n = static_cast<int>(x.cols());
    int j = 0;
    for (; j + 4 <= n; j += 4) {
      Point sums[4] = {x.col(j), x.col(j + 1), x.col(j + 2), x.col(j + 3)};
      for (int k = 0; k < n; ++k) {
        const Point g = gradient.col(k);
        const Scalar* const row = &stiffness_(j, k);  // the inverse is symmetric
        for (int c = 0; c < 4; ++c) sums[c] -= row[c] * g;
      }
      for (int c = 0; c < 4; ++c) x.col(j + c) = sums[c];
    }
    for (; j < n; ++j) {
      for (int k = 0; k < n; ++k) x.col(j) -= stiffness_(j, k) * gradient.col(k);
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

  // A pivot of this share of its diagonal is rounding alone: the anchors are too weak for the springs.
  static constexpr Scalar kRounding = 8 * std::numeric_limits<Scalar>::epsilon();
  static constexpr int kSmall = 6;
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
  typename System::NodeVector diagonal_;  // of K_dyn
  typename System::NodeVector inverse_pivots_;
};

}  // namespace asterism::inline ASTERISM_ABI
