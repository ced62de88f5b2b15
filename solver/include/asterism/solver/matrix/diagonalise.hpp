#pragma once

#include <asterism/solver/base/config.hpp>
#include <cmath>
#include <limits>
#include <type_traits>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// Eigenvalues of the symmetric matrix whose lower triangle is A's, onto its diagonal, and eigenvectors, the
/// columns of V, by Jacobi's rotations (Golub & Van Loan, section 8.5). Some microseconds; Eigen's solver
/// takes seconds to compile for each size and scalar.
template <typename Matrix>
void diagonalise(Matrix& A, Matrix& V) {
  using Scalar = std::remove_cvref_t<decltype(A(0, 0))>;
  constexpr int kMaxSweeps = 30;  // five or six do: convergence is quadratic
  const Eigen::Index n = A.rows();
  V.setIdentity(n, n);
  for (int sweep = 0; sweep < kMaxSweeps; ++sweep) {
    bool is_diagonal = true;
    for (Eigen::Index q = 1; q < n; ++q) {
      for (Eigen::Index p = 0; p < q; ++p) {
        const Scalar off = A(q, p);
        const Scalar scale = std::abs(A(p, p)) + std::abs(A(q, q));
        A(q, p) = 0;
        if (!(std::abs(off) > std::numeric_limits<Scalar>::epsilon() / 4 * scale)) continue;
        is_diagonal = false;
        const Scalar cotangent = (A(q, q) - A(p, p)) / (2 * off);  // of twice the angle
        const Scalar tangent =
            std::copysign(1 / (std::abs(cotangent) + std::sqrt(1 + cotangent * cotangent)), cotangent);
        const Scalar cosine = 1 / std::sqrt(1 + tangent * tangent);
        const Scalar sine = tangent * cosine;
        A(p, p) -= tangent * off;
        A(q, q) += tangent * off;
        const auto turn = [cosine, sine](Scalar& a, Scalar& b) {
          const Scalar turned = cosine * a - sine * b;
          b = sine * a + cosine * b;
          a = turned;
        };
        for (Eigen::Index k = 0; k < n; ++k) {
          if (k != p && k != q) turn(k < p ? A(p, k) : A(k, p), k < q ? A(q, k) : A(k, q));
          turn(V(k, p), V(k, q));
        }
      }
    }
    if (is_diagonal) return;
  }
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
