#include <asterism/solver.hpp>
#include <iostream>

int main() {
  // Measured distances of five points; the matrix is symmetric.
  Eigen::MatrixXd distances(5, 5);
  distances << 0, 380, 405, 240, 140, 380, 0, 435, 605, 370, 405, 435, 0, 545, 545, 240, 605, 545, 0, 380,
      140, 370, 545, 380, 0;

  asterism::SpringSystem<double, 2> system(asterism::Topology<>::full(5));
  for (int l = 0; const asterism::Link& link : system.topology().links()) {
    system.rest_length[l++] = distances(link.i, link.j);
  }
  system.link_stiffness.setOnes();  // the weights of the pairs; 0 for a missing distance
  system.anchor_stiffness.setZero();
  system.anchors.setZero();

  // No anchor holds the nodes: the first one stays where it is.
  auto solver =
      asterism::make_solver<decltype(system)>("multi-start", {{"starts", 32}, {"hold_floating", true}});
  Eigen::Matrix2Xd x(2, 5);
  x << 0, 300, -250, -100, 150, 0, 250, 250, -200, -50;
  const asterism::Summary summary = solver.solve(system, x);
  std::cout << summary.status << ", stress " << 2 * summary.final_energy << "\n";
  return summary.usable() ? 0 : 1;
}
