#include "compiled.hpp"
#include "terms/kernels.hpp"

// NOLINTBEGIN(bugprone-macro-parentheses): types have none
#define ASTERISM_COMPILE_FACTORS(Scalar)                                                             \
  template ASTERISM_API void DenseFactor<Scalar>::invert(const Scalar*, Eigen::Index, Scalar*);      \
  template ASTERISM_API void SparseFactor<Scalar>::analyze(const Eigen::SparseMatrix<Scalar>&, int); \
  template ASTERISM_API void SparseFactor<Scalar>::factorize(const Eigen::SparseMatrix<Scalar>&);    \
  template ASTERISM_API Scalar SparseFactor<Scalar>::negative_curvature(                             \
      Eigen::Matrix<Scalar, Eigen::Dynamic, 1>&) const;                                              \
  template ASTERISM_API SelectedInverse<Scalar>::SelectedInverse(const Sparse&, const Vector&);
// NOLINTEND(bugprone-macro-parentheses)

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

template <>
bool DenseFactor<double>::factorize(double* matrix, Eigen::Index n) {
  return lanes_v0_1::factorize(lanes_v0_1::SymmetricMatrix<double>{matrix, n});
}
template <>
bool DenseFactor<float>::factorize(float* matrix, Eigen::Index n) {
  return lanes_v0_1::factorize(lanes_v0_1::SymmetricMatrix<float>{matrix, n});
}
ASTERISM_COMPILE_FACTORS(double)
ASTERISM_COMPILE_FACTORS(float)

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
