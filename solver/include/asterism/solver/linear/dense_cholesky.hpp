#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/energy/newton_kernels.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/linear/vector_kernels.hpp>
#include <asterism/solver/matrix/dense_factor.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <cmath>
#include <limits>
#include <string_view>
#include <type_traits>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace detail {

/// Solves with a symmetric positive definite matrix K for a few right-hand sides, as K_dyn's: by its inverse
/// for up to 40 nodes, or 64 with wide vectors, which the paper suggests and which is several times faster
/// there than two triangular solves, by Cholesky's factors beyond.
///
/// A step M^-1 g lowers every energy that K majorises if M is above K / 2. An inverse may be off by
/// eps cond(K) of itself, which by cond(K) = eps^-1/2 makes M anything; Cholesky's factors are those of
/// M = K + O(eps) diag(K), whatever the condition. So beyond that they serve for few nodes too, and the
/// diagonal is raised by their rounding before: M is above K.
template <typename Scalar, int kDim, int kNodes, int kMaxNodes>
class SpdSolver {
 public:
  using Points =
      Eigen::Matrix<Scalar, kDim, kNodes, (kDim == 1 ? Eigen::RowMajor : Eigen::ColMajor), kDim, kMaxNodes>;
  using Matrix = Eigen::Matrix<Scalar, kNodes, kNodes, Eigen::ColMajor, kMaxNodes, kMaxNodes>;

  /// The matrix for this many nodes; its lower triangle has to be filled in before `factorize`.
  /// Throws LackOfMemory if it and its factor do not fit into memory.
  Matrix& matrix([[maybe_unused]] int nodes) {
    if constexpr (kMaxNodes == Eigen::Dynamic) {
      if (matrix_.rows() != nodes) require_memory(2.0 * sizeof(Scalar) * nodes * nodes);
    }
    return matrix_;
  }

  /// False where the matrix is not positive definite, or a pivot is not above `rounding` times its diagonal.
  /// `majorise`: with M above K / 2, otherwise as fast as possible.
  bool factorize(Scalar rounding, bool majorise) {
    const Scalar half_of_digits = std::sqrt(std::numeric_limits<Scalar>::epsilon());
    diagonal_ = matrix_.diagonal();
    is_inverse_ = matrix_.rows() <= kInverseUpTo && invert(rounding);
    // The trace is no less than the largest eigenvalue of the inverse of K scaled to a diagonal of 1.
    if (is_inverse_ && majorise) is_inverse_ = half_of_digits * diagonal_.dot(inverse_.diagonal()) < 1;
    if (is_inverse_) return true;
    if (!decompose()) return false;
    const Scalar least = (factor_.diagonal().array().square() / diagonal_.array()).minCoeff();
    if (!(least > rounding)) return false;
    if (majorise && least < half_of_digits) {
      matrix_.diagonal() += kRaise * static_cast<Scalar>(matrix_.rows()) * diagonal_;
      decompose();
    }
    diagonal_ = factor_.diagonal().cwiseInverse();
    return true;
  }

  /// x <- x - matrix^-1 b, both kDim x N.
  void descend(const Points& b, Points& x) {
    const int n = static_cast<int>(x.cols());
    if (!is_inverse_) [[unlikely]] {
      right_hand_side_ = b.transpose();
      DenseFactor<Scalar>::solve(factor_.data(), diagonal_.data(), factor_.rows(), right_hand_side_.data(),
                                 kDim);
      x -= right_hand_side_.transpose();
    } else if (has_kernels(n)) {
      if constexpr (kHasKernels)
        lanes_v0_1::subtract({inverse_.data(), inverse_.rows(), n, kDim, b.data(), x.data()});
    } else if (n <= kSmall) {
      x.noalias() -= b.lazyProduct(inverse_.topRows(n));  // which is symmetric
    } else {
      multiply_by_inverse(b, x);
    }
  }

  /// Whether vectors of the widest instructions serve so many nodes.
  static bool has_kernels(int nodes) {
    return kHasKernels && nodes <= lanes_v0_1::kMostInverted && kDim * nodes >= lanes_v0_1::kLeastKernelSize;
  }

 private:
  // The factor of the matrix; false where it is not positive definite.
  bool decompose() {
    factor_ = matrix_;
    return DenseFactor<Scalar>::factorize(factor_.data(), factor_.rows());
  }

  // The inverse by sweeps (Goodnight 1979), whose pivots are the squares of Cholesky's; for so few nodes
  // several times faster than Eigen's triangular solves. False where a pivot is not above `rounding` times
  // its diagonal.
  bool invert(Scalar rounding) {
    using Four = Eigen::Array<Scalar, 4, 1>;
    const int n = static_cast<int>(matrix_.rows());
    inverse_.setZero(rows(n), n);
    for (int j = 0; j < n; ++j) {
      for (int i = 0; i < j; ++i) inverse_(i, j) = matrix_(j, i);
      for (int i = j; i < n; ++i) inverse_(i, j) = matrix_(i, j);
    }
    if constexpr (kHasKernels) {
      if (has_kernels(n))
        return lanes_v0_1::invert({inverse_.data(), inverse_.rows(), n, rounding, diagonal_.data()});
    }
    const Eigen::Index stride = inverse_.rows();
    right_hand_side_.resize(n, kDim);
    const Scalar* const column = right_hand_side_.col(0).data();
    for (int p = 0; p < n; ++p) {
      const Scalar pivot = inverse_(p, p);
      if (!(pivot > rounding * diagonal_[p])) return false;
      const Scalar inverse = 1 / pivot;
      right_hand_side_.col(0) = inverse_.col(p).head(n);
      Scalar* to = inverse_.data();
      for (int j = 0; j < n; ++j, to += stride) {
        const Scalar factor = column[j] * inverse;
        int i = 0;
        for (; i + 4 <= n; i += 4) {
          Eigen::Map<Four>(to + i) -= factor * Eigen::Map<const Four>(column + i);
        }
        for (; i < n; ++i) to[i] -= factor * column[i];
      }
      inverse_.col(p).head(n) = right_hand_side_.col(0) * inverse;
      to = inverse_.data() + p;
      for (int i = 0; i < n; ++i, to += stride) *to = column[i] * inverse;
      inverse_(p, p) = -inverse;
    }
    inverse_ = -inverse_;
    return true;
  }

  // x <- x - b inverse_, four nodes of x at a time.
  void multiply_by_inverse(const Points& b, Points& x) const {
    using Four = Eigen::Array<Scalar, 4, 1>;
    const int n = static_cast<int>(x.cols());
    int j = 0;
    for (; j + 4 <= n; j += 4) {
      Four sums[kDim];
      for (int c = 0; c < kDim; ++c) sums[c].setZero();
      for (int k = 0; k < n; ++k) {
        const Four row = Eigen::Map<const Four>(&inverse_(j, k));  // which is symmetric
        for (int c = 0; c < kDim; ++c) sums[c] += row * b(c, k);
      }
      for (int r = 0; r < 4; ++r) {
        for (int c = 0; c < kDim; ++c) x(c, j + r) -= sums[c][r];
      }
    }
    for (; j < n; ++j) {
      for (int k = 0; k < n; ++k) x.col(j) -= inverse_(j, k) * b.col(k);
    }
  }

  static constexpr bool kHasKernels =
      kIsCompiled && std::is_same_v<Scalar, double> && kDim <= 3 &&
      (kMaxNodes == Eigen::Dynamic || kDim * kMaxNodes >= lanes_v0_1::kLeastKernelSize);
  static constexpr int kSmall = 6;
  // Rows of the inverse, as the kernels want them. One layout for all, whether or not there are kernels.
  static constexpr bool kIsPadded = kMaxNodes == Eigen::Dynamic || kMaxNodes > kSmall;
  static constexpr int rows(int nodes) {
    if (nodes == Eigen::Dynamic || !kIsPadded) return nodes;
    return static_cast<int>(lanes_v0_1::aligned_rows(nodes));
  }
  using Inverse = Eigen::Matrix<Scalar, rows(kNodes), kNodes, Eigen::ColMajor, rows(kMaxNodes), kMaxNodes>;

  static constexpr Scalar kRaise = 4 * std::numeric_limits<Scalar>::epsilon();
  static constexpr int kInverseUpTo = kHasKernels ? lanes_v0_1::kMostInverted : 40;
  // One node makes a row vector of it, which Eigen wants in row-major order.
  static constexpr int kOrder = kMaxNodes == 1 && kDim > 1 ? Eigen::RowMajor : Eigen::ColMajor;
  using RightHandSide = Eigen::Matrix<Scalar, kNodes, kDim, kOrder, kMaxNodes, kDim>;
  using Vector = Eigen::Matrix<Scalar, kNodes, 1, Eigen::ColMajor, kMaxNodes, 1>;

  Matrix matrix_;
  Inverse inverse_;
  bool is_inverse_ = false;  // whether that serves, or Cholesky's factor
  Matrix factor_;            // L, in the lower triangle
  RightHandSide right_hand_side_;
  Vector diagonal_;  // of the matrix, then one over that of the factor
};

/// The lower triangle of K_dyn / unit, for nodes of the given stiffness. Fixed nodes are coupled to none:
/// their gradient is zero, and so is their step.
template <typename System, typename Matrix>
void assemble_k_dyn(const System& system, const typename System::NodeVector& node_stiffness,
                    typename System::Scalar unit, Matrix& matrix) {
  using Scalar = typename Matrix::Scalar;
  const int n = system.nodes();
  const typename System::Scalar per_unit = 1 / unit;
  matrix.setZero(n, n);
  for (int i = 0; i < n; ++i) matrix(i, i) = static_cast<Scalar>(node_stiffness[i] * per_unit);
  int l = 0;
  for (const Link& link : system.links()) {
    matrix(std::max(link.i, link.j), std::min(link.i, link.j)) -=
        static_cast<Scalar>(system.link_stiffness[l++] * per_unit);
  }
  if (system.fixed_count() == 0) [[likely]]
    return;
  for (int i = 0; i < n; ++i) {
    if (!system.is_fixed(i)) continue;
    matrix.row(i).setZero();
    matrix.col(i).setZero();
    matrix(i, i) = 1;
  }
}

}  // namespace detail

/// Factorisation policy of Ida: dense Cholesky (LLT) of K_dyn, for up to 40 or 64 nodes its inverse where it
/// is well enough conditioned. Ida's gradient form corrects the rounding of either.
template <typename System>
class DenseCholesky {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  static constexpr std::string_view kIdaName = "IDA, dense Cholesky";

  /// Assembles and factors K_dyn; false where it is not positive definite to the digits of the scalar.
  bool factorize(const System& system) {
    detail::node_stiffness(system, node_stiffness_);
    detail::assemble_k_dyn(system, node_stiffness_, Scalar(1), solver_.matrix(system.nodes()));
    // A pivot of so small a share of its diagonal is rounding alone: the anchors are too weak for the
    // springs.
    return solver_.factorize(8 * std::numeric_limits<Scalar>::epsilon(), true);
  }
  /// Whether vectors of the widest instructions serve so many nodes.
  static bool has_kernels(int nodes) { return Solver::has_kernels(nodes); }

  /// x <- x - K_dyn^-1 g, all dimensions at once.
  void descend(const Points& gradient, Points& x) { solver_.descend(gradient, x); }

 private:
  using Solver = detail::SpdSolver<Scalar, System::kDim, System::kNodes, System::kMaxNodes>;

  Solver solver_;
  typename System::NodeVector node_stiffness_;
};

/// Metric of Lbfgs, which a rounded step serves as well as an exact one: DenseCholesky in single precision,
/// which is twice as fast, or in that of the system where the anchors are too weak for it or wide vectors
/// make up for it.
template <typename System>
class SingleCholesky {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  static constexpr std::string_view kName = "dense Cholesky";

  /// As DenseCholesky's.
  bool factorize(const System& system) {
    is_single_ = false;
    if (DenseCholesky<System>::has_kernels(system.nodes())) return exact_.factorize(system);
    detail::node_stiffness(system, node_stiffness_);
    // Stiffness and gradients in units that keep them in the range of single precision.
    unit_ = node_stiffness_.maxCoeff();
    detail::assemble_k_dyn(system, node_stiffness_, unit_, single_.matrix(system.nodes()));
    is_single_ = single_.factorize(
        8 * std::numeric_limits<float>::epsilon() * static_cast<float>(system.nodes()), false);
    return is_single_ || exact_.factorize(system);
  }

  /// x <- x - K_dyn^-1 g to the digits of single precision.
  void descend(const Points& gradient, Points& x) {
    if (!is_single_) return exact_.descend(gradient, x);
    const Scalar largest = gradient.cwiseAbs().maxCoeff();
    if (!(largest > 0)) return;
    gradient_ = (gradient * (1 / largest)).template cast<float>();
    step_.setZero(System::kDim, gradient.cols());
    single_.descend(gradient_, step_);
    x += (largest / unit_) * step_.template cast<Scalar>();
  }

 private:
  using Single = detail::SpdSolver<float, System::kDim, System::kNodes, System::kMaxNodes>;

  Single single_;
  DenseCholesky<System> exact_;
  bool is_single_ = false;
  Scalar unit_ = 1;
  typename System::NodeVector node_stiffness_;
  typename Single::Points gradient_;
  typename Single::Points step_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
