#pragma once

// Matrix functions for tests, in double and of any size, so that Eigen's larger functions are compiled once.

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <functional>

namespace asterism::testing {

/// Ascending eigenvalues of the symmetric matrix with A's lower triangle.
Eigen::VectorXd eigenvalues(const Eigen::MatrixXd& A);
/// A^-1, by LU with full pivoting.
Eigen::MatrixXd inverse(const Eigen::MatrixXd& A);
/// A^-1 B, for a symmetric positive definite matrix with A's lower triangle.
Eigen::MatrixXd solve_definite(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);
/// Whether |a - b| is less than `accuracy` |b|, in the Frobenius norm.
::testing::AssertionResult is_near(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b, double accuracy);
/// Whether all entries are equal.
::testing::AssertionResult is_same(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

/// dF/dx by central differences with step h: a row per entry of F, a column per entry of x.
Eigen::MatrixXd differences(const std::function<Eigen::MatrixXd(const Eigen::MatrixXd&)>& F,
                            const Eigen::MatrixXd& x, double h);

}  // namespace asterism::testing
