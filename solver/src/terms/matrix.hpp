#pragma once

#include <Eigen/SparseCore>
#include <asterism/solver/terms/registry.hpp>
#include <asterism/solver/terms/system.hpp>
#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "multifrontal.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// Why the system's terms do not have this curvature, with the first such term; empty if they have.
std::string missing_curvature(const System& system, Curvature curvature);

/// The matrix of a system's second derivatives at x: its lower triangle, over the coordinates of the points,
/// node by node, and then the hidden unknowns. Rows of fixed nodes are those of the identity. Where entries
/// are stored is kept while the elements stay the same.
class SystemMatrix final : public CurvatureSink {
 public:
  using Sparse = Eigen::SparseMatrix<double>;
  enum class Storage {
    Sparse,
    /// Dense for small systems, and where a good part of the entries is not 0. A majoriser whose blocks are
    /// all multiples of the identity, as the paper's K is, has one row for all coordinates of a node.
    Best
  };

  explicit SystemMatrix(Storage storage) : storage_(storage) {}

  void assemble(const System& system, const Eigen::MatrixXd& x, Curvature curvature);
  int rows() const { return size_; }
  int nodes() const { return nodes_; }
  int per_node() const { return per_node_; }  ///< rows
  /// Whether one row stands for all coordinates of a node.
  bool is_shared() const { return is_shared_; }
  bool is_dense() const { return is_dense_; }
  /// The entries, where is_dense() and where not. The upper triangle of dense() has no meaning.
  const Eigen::MatrixXd& dense() const { return dense_; }
  const Sparse& sparse() const { return sparse_; }
  /// Changes at every change of the sparse pattern.
  int pattern() const { return pattern_; }
  double diagonal(int row) const;
  bool is_finite() const;
  Eigen::VectorXd operator*(const Eigen::VectorXd& v) const;
  /// Adds `share` of the stiffness to the diagonal of each node, and of the diagonal's own to hidden
  /// unknowns.
  void shift(const Eigen::VectorXd& node_stiffness, double share);

  void add(const int* nodes, int count, const double* matrix, int rows) override;
  void add_blocks(const int* nodes, int arity, int count, const double* c, const double* B, int dim) override;
  void add_multiples(const int* nodes, int arity, int count, const double* c, const double* k,
                     int dim) override;

 private:
  // What becomes of the elements that are added to a sparse matrix.
  enum class Adding {
    Recorded,  // to make a pattern of
    ToSlots,   // they are those that the pattern was made of, so far
    Ignored    // they were not
  };

  int unknowns(int node) const { return node < nodes_ ? per_node_ : 1; }
  int first_unknown(int node) const {
    return node < nodes_ ? node * per_node_ : nodes_ * (per_node_ - 1) + node;
  }
  // False where it turns out that coordinates cannot share rows.
  bool assemble_entries(const Eigen::MatrixXd& x, Curvature curvature);
  // Adds the entries of an element in the lower triangle; value(a, b, i, j) is that of the unknowns i and j
  // of its nodes a and b.
  template <typename Value>
  void add_element(const int* nodes, int count, Value&& value);
  // Calls to(row, column, value) for each entry.
  template <typename Value, typename To>
  void for_each_entry(const int* nodes, int count, Value&& value, To&& to) const;
  template <int D>
  void add_to_dense(const int* nodes, int arity, int count, const double* c, const double* B);
  void add_terms(const Eigen::MatrixXd& x, Curvature curvature);
  bool should_be_dense() const;
  bool are_known(const int* nodes, int count);
  void make_pattern();
  double& pivot(int row);

  Storage storage_;
  const System* system_ = nullptr;
  int nodes_ = 0, per_node_ = 1, size_ = 0, pattern_ = 0;
  bool is_dense_ = false, is_shared_ = false, has_own_rows_ = false, has_fixed_ = false;
  Eigen::MatrixXd dense_;
  Sparse sparse_;
  // The elements of the pattern: for each, how many nodes it has, and these; and where its entries are.
  std::vector<int> known_, slots_;
  std::vector<bool> known_fixed_;
  Adding adding_ = Adding::Recorded;
  std::size_t next_known_ = 0, next_slot_ = 0;
  // What is recorded.
  std::vector<int> rows_, columns_;
  std::vector<double> values_;
};

/// A factorisation of such a matrix: L L^T of dense ones, L D L^T of sparse ones, or that of another package.
class SystemFactor {
 public:
  explicit SystemFactor(std::unique_ptr<SparseFactorization> other = nullptr) : other_(std::move(other)) {}

  /// Whether all pivots are positive, and not mere rounding beside the diagonal.
  bool factorize(const SystemMatrix& matrix);
  /// The points' part of the solution for a right-hand side that is `points`, and 0 for hidden unknowns.
  Eigen::MatrixXd solve(const Eigen::MatrixXd& points) const;
  /// The same for a vector or several over all unknowns.
  Eigen::MatrixXd solve_all(Eigen::MatrixXd right) const;
  /// A direction of negative curvature of the matrix, over all unknowns, from a negative pivot; a vector
  /// without entries where there is none. There is no factor afterwards.
  Eigen::VectorXd negative_direction(const SystemMatrix& matrix);
  double log_determinant() const;
  /// The diagonal of the inverse of a dense matrix.
  Eigen::VectorXd diagonal_of_inverse() const;
  /// Of a sparse matrix, without another package.
  const MultifrontalFactor& sparse() const { return sparse_; }
  /// Whether the factor of the matrix has so few entries that a factorisation costs about as much as some
  /// evaluations: that of a chain.
  bool is_thin(const SystemMatrix& matrix);

 private:
  void analyze(const SystemMatrix& matrix);
  void solve_dense(Eigen::MatrixXd& right) const;

  int rows_ = 0;
  bool is_dense_ = false, is_shared_ = false;
  Eigen::MatrixXd factor_;          // of a dense matrix: L in the lower triangle
  Eigen::VectorXd inverse_pivots_;  // 1 / its diagonal
  MultifrontalFactor sparse_;
  std::unique_ptr<SparseFactorization> other_;  // in place of sparse_
  int pattern_ = -1;
  const SystemMatrix* analyzed_ = nullptr;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
