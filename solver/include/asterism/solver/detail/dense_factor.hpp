#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/export.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// Eigen's Cholesky factorisation L L^T of symmetric positive definite matrices, of no size's type: it takes
/// a compiler seconds for each. Matrices are n x n in memory, column after column.
template <typename Scalar>
struct DenseFactor {
  /// The lower triangle of `matrix` becomes L. False where it is not positive definite.
  static bool factorize(Scalar* matrix, Eigen::Index n);

  /// The inverse of L L^T.
  static void invert(const Scalar* factor, Eigen::Index n, Scalar* inverse);

 private:
  using Matrix = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor>;
};

template <typename Scalar>
bool DenseFactor<Scalar>::factorize(Scalar* matrix, Eigen::Index n) {
  Eigen::Map<Matrix> factor(matrix, n, n);
  return Eigen::LLT<Eigen::Ref<Matrix>>(factor).info() == Eigen::Success;
}

template <typename Scalar>
void DenseFactor<Scalar>::invert(const Scalar* factor, Eigen::Index n, Scalar* inverse) {
  const auto L = Eigen::Map<const Matrix>(factor, n, n).template triangularView<Eigen::Lower>();
  Eigen::Map<Matrix> result(inverse, n, n);
  result.setIdentity();
  L.solveInPlace(result);
  L.transpose().solveInPlace(result);
}

#ifdef ASTERISM_SOLVER_COMPILED
extern template ASTERISM_API bool DenseFactor<double>::factorize(double*, Eigen::Index);
extern template ASTERISM_API bool DenseFactor<float>::factorize(float*, Eigen::Index);
extern template ASTERISM_API void DenseFactor<double>::invert(const double*, Eigen::Index, double*);
extern template ASTERISM_API void DenseFactor<float>::invert(const float*, Eigen::Index, float*);
#endif

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
