#include <asterism/solver.hpp>
#include <asterism/solver/energy/sensitivity.hpp>
#include <cmath>
#include <iostream>

int main() {
  // Four parts in a square of 40 px, the last of which was found 12 px off. The true places are known.
  using System = asterism::SpringSystem<double, 2, 4>;
  System system(System::TopologyType::full(4));
  System::Points truth;
  truth << 0, 40, 0, 40, /* x */ 0, 0, 40, 40; /* y */
  system.anchors = truth;
  system.anchors(0, 3) += 12;
  system.set_rest_lengths(truth);
  system.link_stiffness.setConstant(1);
  system.anchor_stiffness.setConstant(0.5);

  asterism::Newton<System> newton;
  asterism::Sensitivity<System> sensitivity;
  System::Points x = system.anchors;
  double loss = 0;
  for (int step = 0; step < 50; ++step) {
    newton.solve(system, x);
    const System::Points error = x - truth;  // dL/dx of L = 1/2 sum |error|^2
    loss = error.squaredNorm() / 2;
    if (step == 0) std::cout << "loss " << loss << '\n';
    const auto gradient = sensitivity.backward(system, x, error);
    if (!gradient) {
      std::cout << gradient.message << '\n';
      return 1;
    }
    // Descent on log k_i, which keeps k_i positive: dL/d(log k) = k dL/dk.
    for (int i = 0; i < 4; ++i) {
      double& k = system.anchor_stiffness[i];
      k *= std::exp(-0.1 * k * gradient.anchor_stiffness[i]);
    }
  }
  std::cout << "loss " << loss << ", stiffness " << system.anchor_stiffness.transpose() << '\n';
}
