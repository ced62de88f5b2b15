#include "matrices.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

namespace asterism::testing {

Eigen::VectorXd eigenvalues(const Eigen::MatrixXd& A) {
  return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(A, Eigen::EigenvaluesOnly).eigenvalues();
}

Eigen::MatrixXd inverse(const Eigen::MatrixXd& A) { return A.fullPivLu().inverse(); }

Eigen::MatrixXd solve_definite(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B) {
  return A.ldlt().solve(B);
}

::testing::AssertionResult is_near(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b, double accuracy) {
  if (a.rows() != b.rows() || a.cols() != b.cols()) return ::testing::AssertionFailure() << "of other sizes";
  if ((a - b).norm() < accuracy * b.norm()) return ::testing::AssertionSuccess();
  return ::testing::AssertionFailure() << a << "\nis off by " << (a - b).norm() << " from\n" << b;
}

::testing::AssertionResult is_same(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  if (a.rows() == b.rows() && a.cols() == b.cols() && a == b) return ::testing::AssertionSuccess();
  return ::testing::AssertionFailure() << a << "\nis not\n" << b;
}

Eigen::MatrixXd differences(const std::function<Eigen::MatrixXd(const Eigen::MatrixXd&)>& F,
                            const Eigen::MatrixXd& x, double h) {
  Eigen::MatrixXd result;
  for (Eigen::Index c = 0; c < x.size(); ++c) {
    Eigen::MatrixXd ahead = x;
    Eigen::MatrixXd behind = x;
    ahead.data()[c] += h;
    behind.data()[c] -= h;
    const Eigen::MatrixXd slope = (F(ahead) - F(behind)) / (2 * h);
    if (c == 0) result.resize(slope.size(), x.size());
    result.col(c) = slope.reshaped();
  }
  return result;
}

}  // namespace asterism::testing
