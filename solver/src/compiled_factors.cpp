#include "compiled.hpp"
#include "terms/kernels.hpp"

// Dense factors are those of the machine's widest vectors.

// NOLINTBEGIN(bugprone-macro-parentheses): types have none
#define ASTERISM_COMPILE_FACTORS(Scalar)                                                               \
  template <>                                                                                          \
  bool DenseFactor<Scalar>::factorize(Scalar* matrix, Eigen::Index n) {                                \
    return lanes_v0_1::factorize(lanes_v0_1::SymmetricMatrix<Scalar>{matrix, n, n}) == n;              \
  }                                                                                                    \
  template <>                                                                                          \
  void DenseFactor<Scalar>::solve(const Scalar* factor, const Scalar* inverse_pivots, Eigen::Index n,  \
                                  Scalar* right, int count) {                                          \
    lanes_v0_1::solve(lanes_v0_1::RightHandSides<Scalar>{factor, inverse_pivots, n, right, count});    \
  }                                                                                                    \
  template <>                                                                                          \
  void DenseFactor<Scalar>::invert(const Scalar* factor, Eigen::Index n, Scalar* inverse) {            \
    constexpr Eigen::Index kFew = 64, kLanes = lanes_v0_1::kMostBytes / sizeof(Scalar);                \
    Scalar few[kFew * kLanes]; /* so few rows need no heap */                                          \
    std::vector<Scalar> many(n > kFew ? static_cast<std::size_t>(n * kLanes) : 0);                     \
    lanes_v0_1::invert(lanes_v0_1::Inverse<Scalar>{factor, n, inverse, n > kFew ? many.data() : few}); \
  }                                                                                                    \
  template ASTERISM_API void SparseFactor<Scalar>::analyze(const Eigen::SparseMatrix<Scalar>&, int);   \
  template ASTERISM_API void SparseFactor<Scalar>::factorize(const Eigen::SparseMatrix<Scalar>&);      \
  template ASTERISM_API Scalar SparseFactor<Scalar>::negative_curvature(                               \
      Eigen::Matrix<Scalar, Eigen::Dynamic, 1>&) const;                                                \
  template ASTERISM_API SelectedInverse<Scalar>::SelectedInverse(const Sparse&, const Vector&);
// NOLINTEND(bugprone-macro-parentheses)

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

ASTERISM_COMPILE_FACTORS(double)
ASTERISM_COMPILE_FACTORS(float)

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
