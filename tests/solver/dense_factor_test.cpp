// Cholesky's factorisation in the machine's widest vectors, and what is solved with it, against Eigen's.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <asterism/solver/matrix/dense_factor.hpp>
#include <asterism/solver/terms/solution.hpp>
#include <asterism/solver/terms/solve.hpp>
#include <cmath>
#include <limits>
#include <string_view>

namespace asterism {
namespace {

template <typename T>
using Matrix = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;

// A positive definite matrix with eigenvalues down to a share of the largest.
template <typename T>
Matrix<T> random_definite(Eigen::Index n, T share) {
  const Eigen::HouseholderQR<Matrix<T>> random(Matrix<T>::Random(n, n));
  const Matrix<T> Q = random.householderQ();
  Eigen::Matrix<T, Eigen::Dynamic, 1> eigenvalues(n);
  for (Eigen::Index i = 0; i < n; ++i) eigenvalues[i] = i == 0 ? T(1) : std::pow(share, T(i) / T(n - 1));
  const Matrix<T> result = Q * eigenvalues.asDiagonal() * Q.transpose();
  return (result + result.transpose()) / 2;
}

template <typename T>
class DenseFactorTest : public testing::Test {};
using Scalars = testing::Types<double, float>;
TYPED_TEST_SUITE(DenseFactorTest, Scalars);

TYPED_TEST(DenseFactorTest, FactorsSolvesAndInverts) {
  using T = TypeParam;
  for (int n = 1; n <= 140; ++n) {
    const Matrix<T> a = random_definite<T>(n, n % 2 == 0 ? T(1e-3) : T(0.5));
    Matrix<T> factor = a;
    ASSERT_TRUE(detail::DenseFactor<T>::factorize(factor.data(), n)) << n;
    const Matrix<T> L = factor.template triangularView<Eigen::Lower>();
    const T error = (L * L.transpose() - a).norm();
    EXPECT_LE(error, 4 * std::numeric_limits<T>::epsilon() * std::sqrt(T(n)) * a.norm()) << n;
    Matrix<T> inverse(n, n), solved = Matrix<T>::Random(n, 5);
    const Matrix<T> right = solved;
    detail::DenseFactor<T>::invert(factor.data(), n, inverse.data());
    EXPECT_EQ(inverse, Matrix<T>(inverse.transpose())) << n;
    const T digits = 64 * std::numeric_limits<T>::epsilon() * std::sqrt(T(n));
    EXPECT_LE((a * inverse - Matrix<T>::Identity(n, n)).norm(), digits * a.norm() * inverse.norm()) << n;
    const Eigen::Matrix<T, Eigen::Dynamic, 1> inverse_pivots = factor.diagonal().cwiseInverse();
    detail::DenseFactor<T>::solve(factor.data(), inverse_pivots.data(), n, solved.data(), 5);
    EXPECT_LE((a * solved - right).norm(), digits * a.norm() * solved.norm()) << n;
    const Matrix<T> above = factor.template triangularView<Eigen::StrictlyUpper>();
    EXPECT_EQ(above, Matrix<T>(a.template triangularView<Eigen::StrictlyUpper>())) << n;
  }
}

TYPED_TEST(DenseFactorTest, RefusesWhatIsNotPositiveDefinite) {
  using T = TypeParam;
  for (const int n : {1, 3, 4, 7, 16, 30, 65, 130}) {
    for (int at = 0; at < n; at += 1 + n / 9) {
      for (const T pivot : {T(-0.1), T(0), std::numeric_limits<T>::quiet_NaN()}) {
        // L D L^T, one of whose pivots is not positive.
        Matrix<T> L = Matrix<T>::Random(n, n) / T(n);
        L = Matrix<T>(L.template triangularView<Eigen::StrictlyLower>()) + Matrix<T>::Identity(n, n);
        Eigen::Matrix<T, Eigen::Dynamic, 1> D = Eigen::Matrix<T, Eigen::Dynamic, 1>::Ones(n);
        if (pivot == 0) L.row(at).head(at).setZero();  // or rounding could make it positive
        D[at] = pivot;
        Matrix<T> a = L * D.asDiagonal() * L.transpose();
        EXPECT_FALSE(detail::DenseFactor<T>::factorize(a.data(), n)) << n << ", pivot " << at;
      }
    }
  }
}

// Anchors and offsets between all nodes: the minimum solves equations, here also by Eigen.
TEST(DenseSystem, IsSolvedForAnyNumberOfRightHandSides) {
  for (int dim = 2; dim <= 9; ++dim) {
    for (const int n : {2, 5, 6, 11, 24, 45}) {
      System system(n, dim);
      const Eigen::MatrixXd places = Eigen::MatrixXd::Random(dim, n);
      const Eigen::RowVectorXd strengths = Eigen::RowVectorXd::Random(n).array() + 1.5;
      system.add_anchors(places, strengths);
      Eigen::MatrixXd K = strengths.asDiagonal().toDenseMatrix();
      Eigen::MatrixXd right = K * places.transpose();
      Eigen::Matrix2Xi pairs(2, n * (n - 1) / 2);
      Eigen::MatrixXd offsets = Eigen::MatrixXd::Random(dim, pairs.cols());
      for (int i = 0, l = 0; i < n; ++i) {
        for (int j = i + 1; j < n; ++j, ++l) {
          pairs.col(l) << i, j;
          K(i, i) += 2, K(j, j) += 2, K(i, j) -= 2, K(j, i) -= 2;
          right.row(i) += 2 * offsets.col(l).transpose();
          right.row(j) -= 2 * offsets.col(l).transpose();
        }
      }
      system.add_offsets(pairs, offsets, System::all(2));
      const Eigen::MatrixXd expected = K.lu().solve(right).transpose();
      for (const std::string_view method : {"newton", "ida", "lbfgs"}) {
        Eigen::MatrixXd x = Eigen::MatrixXd::Random(dim, n);
        AlignedOptions options;
        options.tolerance = 1e-12;
        const Summary summary = solve(method, system, x, options);
        EXPECT_EQ(summary.status, Status::Converged) << method << " " << summary.message;
        EXPECT_LE((x - expected).cwiseAbs().maxCoeff(), 1e-11) << method << ", " << dim << " x " << n;
      }
      // Of the certificate, one over the trace of the inverse.
      const Certificate certificate = certify(system, expected);
      EXPECT_EQ(certificate.proof, Proof::UniqueGlobalMinimum) << dim << " x " << n;
      EXPECT_NEAR(certificate.least_eigenvalue * K.inverse().trace(), 1, 1e-5) << dim << " x " << n;
    }
  }
}

}  // namespace
}  // namespace asterism
