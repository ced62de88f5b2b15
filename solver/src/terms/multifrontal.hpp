#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/indexed.hpp>
#include <cstddef>
#include <limits>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// Of a pivot beside the diagonal from which it comes.
inline constexpr double kPivotRounding = 64 * std::numeric_limits<double>::epsilon();

/// Whether a pivot is positive, and not mere rounding.
inline bool is_pivot(double pivot, double diagonal) {
  return pivot > kPivotRounding * diagonal && pivot > 0 && is_finite(pivot);
}

/// L L^T of sparse symmetric matrices by the multifrontal method (Duff and Reid 1983; Liu 1992). Columns of L
/// that follow each other and have nearly the same pattern, a supernode, are stored as one dense block. The
/// front of a supernode is a dense matrix over these columns and the rows in which they have entries. It
/// takes entries of the matrix and what is left of the fronts of other supernodes, its children; the
/// supernode's columns are eliminated, and what is left is for its parent.
class MultifrontalFactor {
 public:
  using Sparse = Eigen::SparseMatrix<double>;

  /// Orders a new pattern, of a lower triangle with its diagonal (AMD: Amestoy, Davis and Duff 1996). Its
  /// first rows are those of `nodes`, `per_node` each, which stay together. Throws LackOfMemory where the
  /// factor would not fit into memory.
  void analyze(const Sparse& lower, int nodes, int per_node);
  /// Factors a matrix of that pattern. False, without a factor, where a pivot is not positive, or mere
  /// rounding beside the diagonal.
  bool factorize(const Sparse& lower);
  /// matrix^-1 right, for one or several right-hand sides.
  Eigen::MatrixXd solve(const Eigen::MatrixXd& right) const;
  /// v with v^T matrix v < 0 from the first negative pivot; without entries where there is none. There is no
  /// factor afterwards.
  Eigen::VectorXd negative_direction(Sparse lower);
  double log_determinant() const;
  /// Multiplications of a factorisation, after analyze.
  double multiplications() const { return multiplications_; }

 private:
  friend class MultifrontalInverse;
  class Elimination;
  struct Supernode {
    int first, columns;     // the first of its columns
    int size;               // of its front
    int children;           // as many of the fronts that are left, the last ones, are for it
    std::ptrdiff_t rows;    // where the front's rows begin in rows_
    std::ptrdiff_t values;  // and the columns of L, size x columns, in values_
    int entries;            // as many of entries_

    int below() const { return size - columns; }
  };
  // An entry of the matrix and its place in the front.
  struct Entry {
    int source;
    std::ptrdiff_t target;
  };

  void make_supernodes(const Elimination& elimination);
  void make_entries(const Sparse& lower);
  void make_room();
  // For one right-hand side, in the factor's order; backward: in the columns of the first `count` supernodes.
  void substitute_forward(double* x, std::vector<double>& part) const;
  void substitute_backward(double* x, std::size_t count, std::vector<double>& part) const;
  const int* rows_of(const Supernode& s) const { return rows_.data() + s.rows; }
  auto columns_of(const Supernode& s) const {
    return Eigen::Map<const Eigen::MatrixXd>(values_.data() + s.values, s.size, s.columns);
  }

  Indexed<int> place_;                 // row i of the matrix is row place_[i] of the factor
  Indexed<int> supernode_of_;          // a row of the factor
  std::vector<Supernode> supernodes_;  // children before their parents
  std::vector<int> rows_;              // in ascending order in each front
  std::vector<Entry> entries_;         // by supernodes
  double multiplications_ = 0;
  std::vector<double> values_, front_;
  std::vector<double> left_;  // of the fronts, the last one at the end
  Indexed<int> position_;     // of a row in the present front
  struct {
    std::size_t supernode;
    int column;
    bool is_negative;  // by more than rounding
  } refused_{};        // the pivot that ended the last factorisation, which front_ shows
};

/// The entries of the inverse in the pattern of a factor (Takahashi, Fagan and Chin 1973; Erisman and Tinney
/// 1975). From the last supernode to the first, with its own columns C and the rows R below them,
///   Z_RC = -Z_RR Y,  Z_CC = (L_CC L_CC^T)^-1 - Y^T Z_RC,  Y = L_RC L_CC^-1.
class MultifrontalInverse {
 public:
  /// `factor` has factored a matrix, and is to outlive this. Throws LackOfMemory.
  explicit MultifrontalInverse(const MultifrontalFactor& factor);
  /// The entry at two rows of one node.
  double operator()(int i, int j) const;

 private:
  void gather(const MultifrontalFactor::Supernode& s);

  const MultifrontalFactor& factor_;
  std::vector<double> values_;  // at the places of the factor's
  Eigen::MatrixXd gathered_;    // Z_RR
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
