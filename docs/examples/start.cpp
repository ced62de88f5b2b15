#include <asterism/solver.hpp>
#include <iostream>

int main() {
  // Three parts, 30 px apart on a line; the last one was seen 25 px off it,
  // with little certainty.
  asterism::SpringSystem<double, 2> system(asterism::Topology<>::full(3));
  system.anchors << 0, 30, 60, /* x */ 0, 0, 0; /* y */
  system.set_rest_lengths(system.anchors);
  system.link_stiffness.setConstant(1);
  system.anchor_stiffness << 1, 1, 0.01;
  system.anchors(1, 2) = 25;
  auto x = system.anchors;
  const asterism::Summary summary = asterism::solve(system, x);
  std::cout << summary.status << "; the last part is at " << x.col(2).transpose() << "\n";
  return summary.usable() ? 0 : 1;
}
