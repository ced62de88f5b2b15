#include <asterism/solver.hpp>
#include <iostream>

int main() {
  asterism::SpringSystem<double, 2> system(asterism::Topology<>::full(3));  // the residual blocks
  system.anchors << 0, 40, 25, /* x */ 0, 0, 35;                            /* y */
  system.anchor_stiffness << 1, 1, 0.1;
  system.rest_length.setConstant(40);
  system.link_stiffness.setConstant(2);
  auto x = system.anchors;  // the parameters: one column for each node
  const asterism::Summary summary = asterism::solve(system, x);
  std::cout << summary.status << ", cost " << summary.final_energy << ", third node " << x.col(2).transpose()
            << "\n";
  return summary.usable() ? 0 : 1;
}
