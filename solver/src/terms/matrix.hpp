#pragma once

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <asterism/solver/terms/system.hpp>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// Why the system's terms do not have this curvature, with the first such term; empty if they have.
std::string missing_curvature(const System& system, Curvature curvature);

/// The matrix of a system's second derivatives at x: its lower triangle, over the coordinates of the points,
/// node by node, and then the hidden unknowns. Rows of fixed nodes are those of the identity. The pattern is
/// kept while the elements stay the same.
class SystemMatrix final : public CurvatureSink {
 public:
  using Sparse = Eigen::SparseMatrix<double>;

  void assemble(const System& system, const Eigen::MatrixXd& x, Curvature curvature);
  const Sparse& matrix() const { return matrix_; }
  /// Changes at every change of the pattern.
  int pattern() const { return pattern_; }
  /// Adds `share` of the stiffness to the diagonal of each node, and of the diagonal's own to hidden
  /// unknowns.
  void shift(const Eigen::VectorXd& node_stiffness, double share);

  void add(const int* nodes, int count, const double* matrix, int rows) override;

 private:
  int unknowns(int node) const { return node < nodes_ ? dim_ : 1; }
  int first_unknown(int node) const { return node < nodes_ ? node * dim_ : nodes_ * (dim_ - 1) + node; }
  void make_pattern();

  int nodes_ = 0, dim_ = 1, size_ = 0, pattern_ = 0;
  const System* system_ = nullptr;
  std::vector<int> rows_, columns_, old_rows_, old_columns_, slots_;
  std::vector<double> values_;
  Sparse matrix_;
};

/// L D L^T of such a matrix.
class SystemFactor {
 public:
  /// How many entries L has.
  double entries(const SystemMatrix& matrix);
  /// Whether all pivots are positive, and not mere rounding beside the diagonal.
  bool factorize(const SystemMatrix& matrix);
  /// The points' part of the solution for a right-hand side that is `points`, and 0 for hidden unknowns.
  Eigen::MatrixXd solve(const Eigen::MatrixXd& points) const;
  /// The same for a vector or several over all unknowns.
  Eigen::MatrixXd solve_all(const Eigen::MatrixXd& right) const;
  /// A direction of negative curvature over all unknowns, from a negative pivot: a vector without entries
  /// where there is none, or the factorisation broke down.
  Eigen::VectorXd negative_direction() const;
  double log_determinant() const;
  const auto& cholesky() const { return cholesky_; }

 private:
  void analyse(const SystemMatrix& matrix);

  Eigen::SimplicialLDLT<SystemMatrix::Sparse, Eigen::Lower, Eigen::AMDOrdering<int>> cholesky_;
  int pattern_ = -1;
  const SystemMatrix* analysed_ = nullptr;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
