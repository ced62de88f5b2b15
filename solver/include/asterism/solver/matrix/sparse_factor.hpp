#pragma once

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/export.hpp>
#include <asterism/solver/base/memory.hpp>
#include <limits>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// Whether a sparse Cholesky factor is worthwhile for a matrix with the links' pattern.
template <typename System>
bool is_large_and_sparse(const System& system) {
  if constexpr (System::kMaxNodes != Eigen::Dynamic) return false;  // a bound is a promise not to allocate
  constexpr int kDenseUpTo = 64;
  return system.nodes() > kDenseUpTo && system.link_count() < system.nodes() * (system.nodes() / 16.0);
}

/// Eigen's SimplicialLDLT with AMD ordering; refused before it would need more memory than is available.
template <typename Scalar>
class SparseFactor : public Eigen::SimplicialLDLT<Eigen::SparseMatrix<Scalar>> {
 public:
  /// Orders a new pattern, of a lower triangle. `copies` of the factor are to fit into memory.
  void analyze(const Eigen::SparseMatrix<Scalar>& lower, int copies = 1);
  /// Entries in the longest column of the factor, after analyze.
  double longest_column() const { return 1 + this->m_nonZerosPerCol.template cast<double>().maxCoeff(); }
  /// Factors a matrix of that pattern; info() says whether it could.
  void factorize(const Eigen::SparseMatrix<Scalar>& lower);
  /// The same; false where the matrix is not positive definite.
  bool factorize_definite(const Eigen::SparseMatrix<Scalar>& lower) {
    factorize(lower);
    return this->info() == Eigen::Success && this->vectorD().minCoeff() > std::numeric_limits<Scalar>::min();
  }
  /// A direction v with v^T matrix v < 0 from the last factorisation: L^T v = e at the least pivot. Returns
  /// v^T matrix v, 0 where no pivot is negative.
  Scalar negative_curvature(Eigen::Matrix<Scalar, Eigen::Dynamic, 1>& v) const;
};

template <typename Scalar>
void SparseFactor<Scalar>::analyze(const Eigen::SparseMatrix<Scalar>& lower, int copies) {
  this->analyzePattern(lower);
  const double entries = this->m_nonZerosPerCol.template cast<double>().sum();
  require_entries(entries, sizeof(Scalar), copies);
}

template <typename Scalar>
void SparseFactor<Scalar>::factorize(const Eigen::SparseMatrix<Scalar>& lower) {
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<Scalar>>::factorize(lower);
}

template <typename Scalar>
Scalar SparseFactor<Scalar>::negative_curvature(Eigen::Matrix<Scalar, Eigen::Dynamic, 1>& v) const {
  if (this->info() != Eigen::Success) return 0;
  Eigen::Index least = 0;
  const Scalar pivot = this->vectorD().minCoeff(&least);
  if (!(pivot < 0)) return 0;
  v.setZero(this->rows());
  v[least] = 1;
  this->matrixU().solveInPlace(v);
  v = (this->permutationPinv() * v).eval();
  return pivot;
}

#ifdef ASTERISM_SOLVER_COMPILED
extern template ASTERISM_API void SparseFactor<double>::analyze(const Eigen::SparseMatrix<double>&, int);
extern template ASTERISM_API void SparseFactor<double>::factorize(const Eigen::SparseMatrix<double>&);
extern template ASTERISM_API double SparseFactor<double>::negative_curvature(
    Eigen::Matrix<double, Eigen::Dynamic, 1>&) const;
extern template ASTERISM_API void SparseFactor<float>::analyze(const Eigen::SparseMatrix<float>&, int);
extern template ASTERISM_API void SparseFactor<float>::factorize(const Eigen::SparseMatrix<float>&);
extern template ASTERISM_API float SparseFactor<float>::negative_curvature(
    Eigen::Matrix<float, Eigen::Dynamic, 1>&) const;
#endif

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
