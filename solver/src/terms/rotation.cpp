#include "rotation.hpp"

#include <algorithm>
#include <asterism/solver/matrix/diagonalise.hpp>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

namespace {

// Whether the determinant of an orthogonal matrix is negative, by elimination.
bool is_reflection(Eigen::MatrixXd R) {
  bool is_negative = false;
  for (Eigen::Index k = 0; k < R.rows(); ++k) {
    Eigen::Index pivot = k;
    for (Eigen::Index i = k; i < R.rows(); ++i) {
      if (std::abs(R(i, k)) > std::abs(R(pivot, k))) pivot = i;
    }
    if (pivot != k) R.row(k).swap(R.row(pivot));
    is_negative ^= (pivot != k) ^ (R(k, k) < 0);
    for (Eigen::Index i = k + 1; i < R.rows(); ++i) R.row(i) -= R(i, k) / R(k, k) * R.row(k);
  }
  return is_negative;
}

}  // namespace

// U V^T with the singular vectors of M: V are those of M^T M, and U what M makes of them.
Eigen::MatrixXd nearest_rotation(Eigen::MatrixXd M, bool allow_reflection) {
  const Eigen::Index dim = M.rows();
  const double scale = M.cwiseAbs().maxCoeff();
  if (scale > 0) M /= scale;
  Eigen::MatrixXd squares = M.transpose().lazyProduct(M), axes;
  diagonalise(squares, axes);
  std::vector<Eigen::Index> order(static_cast<std::size_t>(dim));
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](auto a, auto b) { return squares(a, a) > squares(b, b); });
  Eigen::MatrixXd U(dim, dim), V(dim, dim);
  for (Eigen::Index k = 0; k < dim; ++k) {
    V.col(k) = axes.col(order[static_cast<std::size_t>(k)]);
    const auto rest = [&](Eigen::VectorXd u) {  // what is orthogonal to the columns before
      for (int twice = 0; twice < 2; ++twice) {
        for (Eigen::Index j = 0; j < k; ++j) u -= U.col(j).dot(u) * U.col(j);
      }
      return u;
    };
    Eigen::VectorXd u = rest(M.lazyProduct(V.col(k)));
    for (Eigen::Index axis = 0; axis < dim && !(u.squaredNorm() > 1e-24); ++axis)  // any direction is as good
      u = 1e-6 * rest(Eigen::VectorXd::Unit(dim, axis));
    U.col(k) = u.normalized();
  }
  Eigen::MatrixXd R = U.lazyProduct(V.transpose());
  if (!allow_reflection && is_reflection(R)) {
    U.col(dim - 1) *= -1;
    R = U.lazyProduct(V.transpose());
  }
  return R;
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
