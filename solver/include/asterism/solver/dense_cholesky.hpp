#pragma once

#include <Eigen/Cholesky>
#include <asterism/solver/config.hpp>
#include <asterism/solver/spring_system.hpp>
#include <limits>
#include <string_view>

namespace asterism::inline ASTERISM_ABI {

/// Factorisation policy of Ida: dense Cholesky (LLT) of K_dyn. For up to 16 nodes the inverse is formed from
/// the factor once, as the paper suggests: one product an iteration, which for such sizes is several times
/// faster than two triangular solves. Ida's gradient form corrects the rounding of either.
template <typename System>
class DenseCholesky {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  static constexpr std::string_view kIdaName = "IDA, dense Cholesky";

  /// Assembles and factors K_dyn; false where it is not positive definite to the digits of the scalar.
  bool factorize(const System& system) {
    const int n = system.nodes();
    stiffness_.setZero(n, n);
    stiffness_.diagonal() = system.anchor_stiffness;
    int l = 0;
    for (const Link& link : system.links()) {
      const Scalar k = system.link_stiffness[l++];
      stiffness_(link.i, link.i) += k;
      stiffness_(link.j, link.j) += k;
      stiffness_(link.i, link.j) -= k;
      stiffness_(link.j, link.i) -= k;
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
    }
    return true;
  }

  /// x <- x - K_dyn^-1 g, all dimensions at once.
  void descend(const Points& gradient, Points& x) {
    if (x.cols() <= kInverseUpTo) {
      x.noalias() -= gradient.lazyProduct(stiffness_);  // the inverse is symmetric
    } else {
      right_hand_side_ = gradient.transpose();
      cholesky_.solveInPlace(right_hand_side_);
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
      stiffness_(i, i) = 1;
    }
  }

  static constexpr int kInverseUpTo = 16;
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
};

}  // namespace asterism::inline ASTERISM_ABI
