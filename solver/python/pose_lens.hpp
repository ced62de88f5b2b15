#pragma once

// OpenCV's lens, for asterism.pose.
#include <algorithm>
#include <cmath>
#include <limits>

namespace asterism::python::pose {

/// What a camera makes of a point in normalised coordinates.
class Lens {
 public:
  /// matrix (3, 3) [px], by rows; distortions k1, k2, p1, p2, k3.
  Lens(const double* matrix, const double* distortions) {
    for (int r = 0; r < 2; ++r) {
      middle_[r] = matrix[r * 3 + 2];
      for (int c = 0; c < 2; ++c) scale_[r][c] = matrix[r * 3 + c];
    }
    std::copy_n(distortions, 5, k_);
  }

  /// sight (6): the normalised coordinates of a pixel, NaN where the distortion has no inverse, and the
  /// pixels for a unit of them (2, 2).
  void undistort(const double* pixel, double* sight) const {
    const double off[2] = {pixel[0] - middle_[0], pixel[1] - middle_[1]};
    double goal[2], error[2], slope[2][2];
    solve(scale_, off, goal);
    double* image = sight;
    std::copy_n(goal, 2, image);
    distort(image, goal, error, slope);
    for (int step = 0; step < 12 && size(error) > 1e-13; ++step) {  // Newton's method
      double way[2];
      solve(slope, error, way);
      for (int r = 0; r < 2; ++r) image[r] += way[r];
      distort(image, goal, error, slope);
    }
    const bool is_found = size(error) < 1e-9 && slope[0][0] * slope[1][1] - slope[0][1] * slope[1][0] > 0;
    if (!is_found) std::fill_n(image, 2, std::numeric_limits<double>::quiet_NaN());
    for (int r = 0; r < 2; ++r) {
      for (int c = 0; c < 2; ++c)
        sight[2 + r * 2 + c] = scale_[r][0] * slope[0][c] + scale_[r][1] * slope[1][c];
    }
  }

 private:
  /// error: goal less what is seen of `at`; slope: the derivative of that.
  void distort(const double* at, const double* goal, double* error, double (&slope)[2][2]) const {
    const auto [k1, k2, p1, p2, k3] = k_;
    const double x = at[0], y = at[1], r = x * x + y * y;
    const double radial = 1 + r * (k1 + r * (k2 + r * k3)), rise = k1 + r * (2 * k2 + 3 * k3 * r);
    slope[0][0] = radial + 2 * x * x * rise + 2 * p1 * y + 6 * p2 * x;
    slope[0][1] = slope[1][0] = 2 * (x * y * rise + p1 * x + p2 * y);
    slope[1][1] = radial + 2 * y * y * rise + 6 * p1 * y + 2 * p2 * x;
    error[0] = goal[0] - (x * radial + 2 * p1 * x * y + p2 * (r + 2 * x * x));
    error[1] = goal[1] - (y * radial + p1 * (r + 2 * y * y) + 2 * p2 * x * y);
  }

  static void solve(const double (&matrix)[2][2], const double* right, double* x) {
    const double scale = 1 / (matrix[0][0] * matrix[1][1] - matrix[0][1] * matrix[1][0]);
    x[0] = (matrix[1][1] * right[0] - matrix[0][1] * right[1]) * scale;
    x[1] = (matrix[0][0] * right[1] - matrix[1][0] * right[0]) * scale;
  }

  static double size(const double* error) { return std::max(std::abs(error[0]), std::abs(error[1])); }

  double scale_[2][2], middle_[2], k_[5];
};

}  // namespace asterism::python::pose
