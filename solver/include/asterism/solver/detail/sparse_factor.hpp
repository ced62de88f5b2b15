#pragma once

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/memory.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// Eigen's SimplicialLDLT with AMD ordering, which is refused before it takes more memory than there is.
template <typename Scalar>
class SparseFactor : public Eigen::SimplicialLDLT<Eigen::SparseMatrix<Scalar>> {
 public:
  /// Orders a new pattern, of a lower triangle. `copies` of the factor are to fit into memory.
  void analyze(const Eigen::SparseMatrix<Scalar>& lower, int copies = 1) {
    this->analyzePattern(lower);
    const double entries = this->m_nonZerosPerCol.template cast<double>().sum();
    require_entries(entries, sizeof(Scalar), copies);
  }
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
