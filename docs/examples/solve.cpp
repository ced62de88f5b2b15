#include <asterism/solver.hpp>
#include <iostream>

int main() {
  // Four parts in a square of 40 px, each linked to all others.
  asterism::SpringSystem<double, 2, 4> system(asterism::Topology<4>::full());
  system.anchors << 0, 40, 0, 40, /* x */ 0, 0, 40, 40; /* y */
  system.set_rest_lengths(system.anchors);
  system.link_stiffness.setConstant(1.0);
  system.anchor_stiffness << 0.5, 0.5, 0.5, 0.05;
  system.anchors.col(3) << 70, 55;  // the last part was seen far off, with little certainty
  auto x = system.anchors;          // the start, then the result: one column per part
  const asterism::Summary summary = asterism::solve(system, x);
  std::cout << x << "\n" << summary.status << ", energy " << summary.final_energy << "\n";
}
