#include <asterism/system.hpp>
#include <cmath>
#include <iostream>
#include <numbers>

// Two cameras see both ends of a bar of 3 m: the directions are known to 0.01 rad, the length to 2 cm.
int main() {
  const Eigen::RowVector4i end{0, 1, 0, 1};                     // each element has one node
  const Eigen::Matrix2Xd camera{{0, 0, 10, 10}, {0, 0, 0, 0}};  // [m]
  const Eigen::Vector4d seen{0.90, 0.62, 2.45, 2.10};           // [rad, from the x axis]
  const auto directions = [=](const Eigen::MatrixXd& points, const Eigen::MatrixXd&, bool,
                              asterism::ElementValues& values) {
    values.energy.resize(points.cols());
    values.gradient.resize(2, points.cols());
    for (int e = 0; e < points.cols(); ++e) {
      const Eigen::Vector2d d = points.col(e) - camera.col(e);
      const double error = std::remainder(std::atan2(d.y(), d.x()) - seen[e], 2 * std::numbers::pi) / 0.01;
      values.energy[e] = error * error / 2;
      values.gradient.col(e) << -d.y(), d.x();
      values.gradient.col(e) *= error / (0.01 * d.squaredNorm());
    }
  };

  asterism::System system(2, 2);
  system.add_elements(end, directions, false);  // without second derivatives
  system.add_links(asterism::all_pairs(2), asterism::System::all(3),
                   asterism::System::all(1 / (0.02 * 0.02)));
  Eigen::MatrixXd x{{4, 6}, {4, 4}};
  const asterism::Summary summary = asterism::solve(system, x);
  std::cout << summary.solver << " " << summary.status << ", cost " << summary.final_energy << "\n"
            << x << "\n";
  return summary.usable() ? 0 : 1;
}
