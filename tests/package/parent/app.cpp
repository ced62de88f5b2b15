#include <asterism/solver.hpp>
#include <iostream>

int main() {
  asterism::SpringSystem<float, 2, 2> system(asterism::Topology<2>::full());
  system.anchors << 0, 10, 0, 0;
  system.anchor_stiffness.setOnes();
  system.rest_length.setConstant(20);
  system.link_stiffness.setOnes();
  auto x = system.anchors;
  // By symmetry the nodes part by d with 2 k (20 - d) = d - 10, so d = 50 / 3.
  const bool ok = asterism::solve_ida(system, x).status == asterism::Status::Converged &&
                  std::abs(x(0, 1) - x(0, 0) - 50.0f / 3) < 1e-3f;
  if (ok) std::cout << "the parent is content\n";
  return ok ? 0 : 1;
}
