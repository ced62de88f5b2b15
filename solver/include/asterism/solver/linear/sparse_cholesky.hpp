#pragma once

#include <Eigen/SparseCore>
#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/matrix/sparse_factor.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <cmath>
#include <limits>
#include <memory>
#include <string_view>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace detail {

/// The lower triangle of K_dyn as a sparse matrix, whose pattern is made once per topology and refilled
/// after that. Fixed nodes are not coupled to others.
template <typename Scalar>
class SparseStiffness {
 public:
  using Matrix = Eigen::SparseMatrix<Scalar>;

  /// Fills in the values of `system`, after analyze(matrix) where the pattern is new. Where that throws, it
  /// is new to the next call, too.
  template <typename System, typename Analyze>
  void assemble(const System& system, Analyze&& analyze) {
    const auto links = system.links();
    if (!is_ready_ || matrix_->rows() != system.nodes() ||
        !std::equal(links.begin(), links.end(), links_.begin(), links_.end())) {
      is_ready_ = false;
      make_pattern(system.nodes(), links);
      analyze(*matrix_);
      is_ready_ = true;
    }
    auto* values = matrix_->valuePtr();
    matrix_->coeffs().setZero();
    for (int i = 0; i < system.nodes(); ++i)
      values[diagonal_[i]] = static_cast<Scalar>(system.anchor_stiffness[i]);
    int l = 0;
    for (const Link& link : links) {
      const auto k = static_cast<Scalar>(system.link_stiffness[l]);
      values[diagonal_[link.i]] += k;
      values[diagonal_[link.j]] += k;
      if (!system.is_fixed(link.i) && !system.is_fixed(link.j)) values[off_diagonal_[l]] -= k;
      ++l;
    }
    for (int i = 0; i < system.nodes(); ++i) {
      if (system.is_fixed(i)) values[diagonal_[i]] = 1;
    }
  }

  /// Factors the matrix by Eigen's or CHOLMOD's Cholesky, with the diagonal raised where rounding could make
  /// the factors' product less than K_dyn (SpdSolver has why): the factors' rows are about sqrt(N) long where
  /// links are local. False where K_dyn is not positive definite to the digits of the scalar.
  template <typename Cholesky>
  bool factorize(Cholesky& cholesky) {
    using Vector = Eigen::Matrix<Scalar, Eigen::Dynamic, 1>;
    constexpr Scalar kEpsilon = std::numeric_limits<Scalar>::epsilon();
    cholesky.factorize(*matrix_);
    if (cholesky.info() != Eigen::Success) return false;
    const Vector diagonal = diagonal_.unaryExpr([this](int at) { return matrix_->valuePtr()[at]; });
    // |K_dyn^-1| |K_dyn| 1 up to a factor of 2, no entry of the inverse being negative (Skeel 1979).
    const Vector condition = cholesky.solve(diagonal);
    if (!(condition.array() > 0 && kEpsilon * condition.array() < 1).all()) return false;
    if (std::sqrt(kEpsilon) * condition.maxCoeff() < 1) return true;
    const Scalar raise = 4 * kEpsilon * std::sqrt(static_cast<Scalar>(diagonal.size()));
    for (const int at : diagonal_) matrix_->valuePtr()[at] *= 1 + raise;
    cholesky.factorize(*matrix_);
    return cholesky.info() == Eigen::Success;
  }

 private:
  void make_pattern(int n, std::span<const Link> links) {
    require_entries(n + static_cast<double>(links.size()), sizeof(Scalar), 3);  // and their triplets
    std::vector<Eigen::Triplet<Scalar>> entries;
    entries.reserve(static_cast<std::size_t>(n) + links.size());
    for (int i = 0; i < n; ++i) entries.emplace_back(i, i, Scalar(0));
    for (const Link& link : links)
      entries.emplace_back(std::max(link.i, link.j), std::min(link.i, link.j), Scalar(0));
    matrix_ = std::make_unique<Matrix>(n, n);
    matrix_->setFromTriplets(entries.begin(), entries.end());

    const auto position = [this](int row, int column) {
      const int* rows = matrix_->innerIndexPtr();
      const int* first = rows + matrix_->outerIndexPtr()[column];
      const int* last = rows + matrix_->outerIndexPtr()[column + 1];
      return static_cast<int>(std::lower_bound(first, last, row) - rows);
    };
    diagonal_.resize(n);
    for (int i = 0; i < n; ++i) diagonal_[i] = position(i, i);
    off_diagonal_.resize(static_cast<Eigen::Index>(links.size()));
    int l = 0;
    for (const Link& link : links) {
      off_diagonal_[l++] = position(std::max(link.i, link.j), std::min(link.i, link.j));
    }
    links_.assign(links.begin(), links.end());
  }

  std::unique_ptr<Matrix> matrix_;  // Eigen's allocates as it is moved
  std::vector<Link> links_;         // of the pattern
  Eigen::VectorXi diagonal_;        // place of entry (i, i) among the values
  Eigen::VectorXi off_diagonal_;    // place of a link's entry
  bool is_ready_ = false;
};

}  // namespace detail

/// Factorisation policy of Ida: sparse Cholesky (Eigen's SimplicialLDLT with AMD ordering) of K_dyn, for many
/// nodes and few links per node. The ordering is computed once per topology. Uses the heap.
template <typename System>
class SparseCholesky {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  static constexpr std::string_view kIdaName = "IDA, sparse Cholesky";

  /// Assembles and factors K_dyn; false where it is not positive definite to the digits of the scalar.
  bool factorize(const System& system) {
    stiffness_.assemble(system, [this](const auto& pattern) {
      cholesky_ = std::make_unique<Cholesky>();
      cholesky_->analyze(pattern);
    });
    return stiffness_.factorize(*cholesky_);
  }

  /// x <- x - K_dyn^-1 g, all dimensions at once.
  void descend(const Points& gradient, Points& x) {
    right_hand_side_ = gradient.transpose();
    step_ = cholesky_->solve(right_hand_side_);
    x -= step_.transpose();
  }

 private:
  using RightHandSide = Eigen::Matrix<Scalar, Eigen::Dynamic, System::kDim, Eigen::ColMajor>;
  using Cholesky = detail::SparseFactor<Scalar>;

  detail::SparseStiffness<Scalar> stiffness_;
  std::unique_ptr<Cholesky> cholesky_;  // Eigen's cannot be moved
  RightHandSide right_hand_side_;
  RightHandSide step_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
