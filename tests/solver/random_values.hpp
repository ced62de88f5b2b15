#pragma once

// Random numbers for the columns of terms.

#include <Eigen/Core>
#include <asterism/testing/random_system.hpp>

namespace asterism::testing {

/// dim x n, between -size and size.
inline Eigen::MatrixXd random_points(Rng& rng, Eigen::Index dim, Eigen::Index n, double size = 10) {
  Eigen::MatrixXd x(dim, n);
  for (double& value : x.reshaped()) value = rng.uniform(-size, size);
  return x;
}

inline Eigen::VectorXd random_values(Rng& rng, Eigen::Index count, double low, double high) {
  Eigen::VectorXd values(count);
  for (double& value : values) value = rng.uniform(low, high);
  return values;
}

/// Information matrices as columns, of full rank or of rank 1.
inline Eigen::MatrixXd random_shapes(Rng& rng, Eigen::Index dim, Eigen::Index count, bool full) {
  Eigen::MatrixXd shapes(dim * dim, count);
  for (Eigen::Index e = 0; e < count; ++e) {
    const Eigen::MatrixXd root = random_points(rng, dim, full ? dim : 1, 1);
    const Eigen::MatrixXd shape = root * root.transpose();
    shapes.col(e) = shape.reshaped();
  }
  return shapes;
}

}  // namespace asterism::testing
