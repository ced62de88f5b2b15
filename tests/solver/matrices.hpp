#pragma once

// What tests ask of matrices, in double and of any size, so that Eigen's larger functions are compiled once.

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <functional>

namespace asterism::testing {

/// Ascending, of the symmetric matrix whose lower triangle is A's.
Eigen::VectorXd eigenvalues(const Eigen::MatrixXd& A);
/// A^-1, by LU with full pivoting.
Eigen::MatrixXd inverse(const Eigen::MatrixXd& A);
/// Whether |a - b| is less than `accuracy` |b|, by the norm.
::testing::AssertionResult is_near(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b, double accuracy);
/// Whether all entries are the same.
::testing::AssertionResult is_same(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

/// dF/dx by central differences with step h, x being seen as a vector: a row an entry of F, a column an entry
/// of x.
Eigen::MatrixXd differences(const std::function<Eigen::MatrixXd(const Eigen::MatrixXd&)>& F,
                            const Eigen::MatrixXd& x, double h);

}  // namespace asterism::testing
